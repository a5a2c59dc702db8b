//! Instances that a clip moves are drawn where it has them.

use glam::{DAffine3, DQuat, DVec3};
use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, Vertex};
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::animation::{
    AnimatedModel, AnimatedNode, AnimatedPart, Channel, Clip, Interpolation, Moment, Property, Rest,
};
use lodestream_scene::description::Instance;
use lodestream_scene::placement::Placement;

use super::headless;
use crate::{Headless, Material, Pose, SceneView, Settings};

/// Where the asset's origin is, far from zero.
const ORIGIN: [f64; 3] = [1e5, -2e5, 3e5];

fn pyramid() -> Vec<Change> {
    let corners = [[0.0_f32, 0.0, 0.0], [0.8, 0.0, 0.0], [0.0, 0.8, 0.0], [0.0, 0.0, 0.8]];
    let faces: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let vertex = |position: [f32; 3], normal: [f32; 3]| {
        let color = [200, 90, 60, 255];
        let data = RenderVertex {
            position,
            normal,
            uv: [0.0; 2],
            color,
            morph_from: position,
            smooth: false,
            part: 0,
            skin: Default::default(),
            second_uv: [0.0; 2],
        };
        Vertex { data, birth_s: 0.0, level: 0 }
    };
    let vertices = faces.iter().flat_map(|face| {
        let [a, b, c] = face.map(|corner| glam::Vec3::from(corners[corner]));
        let normal = (b - a).cross(c - a).normalize().to_array();
        face.map(|corner| vertex(corners[corner], normal))
    });
    let vertices: Vec<Vertex> = vertices.collect();
    vec![
        Change::Asset(NewAsset {
            asset: 0,
            origin: ORIGIN,
            center: [0.3; 3],
            radius: 0.9,
            materials: vec![Material::default()],
            textures: Vec::new(),
            shared: Vec::new(),
        }),
        Change::Mesh(MeshChange {
            asset: 0,
            vertices: vec![(0, vertices)],
            vertex_slots: 12,
            index_slots: vec![4],
            indices: vec![IndexRun {
                material: 0,
                first: 0,
                faces: (0..4).map(|face| [0, 1, 2].map(|corner| 3 * face + corner)).collect(),
            }],
        }),
    ]
}

/// The asset at a place, by its origin.
fn placed(at: DVec3) -> Instance {
    Instance::at(0, (at - DVec3::from(ORIGIN)).to_array())
}

/// The second instance moves by 4 and turns by 90° about its own origin in two seconds.
fn model() -> AnimatedModel {
    let about = DAffine3::from_translation(DVec3::from(ORIGIN));
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let channel = |property, values: &[f32]| Channel {
        node: 0,
        property,
        interpolation: Interpolation::Linear,
        timeline: 0,
        values: values.to_vec(),
    };
    let channels = vec![
        channel(Property::Translation, &[0.0, 0.0, 0.0, -4.0, 1.0, 0.0]),
        channel(Property::Rotation, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half]),
    ];
    AnimatedModel {
        nodes: vec![AnimatedNode { parent: None, to_parent: DAffine3::IDENTITY, rest: Rest::default() }],
        parts: vec![AnimatedPart { node: 0, to_node: about.inverse(), from_model: about }],
        skins: Vec::new(),
        places: vec![vec![1]],
        timelines: vec![vec![0.0, 2.0]],
        clips: vec![Clip { name: "go".into(), channels }],
    }
}

fn arrive(h: &Headless, view: &mut SceneView, step: Vec<Change>) {
    view.push(step);
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
}

fn picture(h: &mut Headless, scene: &SceneView) -> Vec<u8> {
    let camera = Pose::look_at(DVec3::new(-0.5, 0.8, 5.0), DVec3::new(-0.5, 0.0, 0.0), DVec3::Y, 0.8);
    scene.with_frame(camera, Settings::default(), f32::MAX, |frame| h.frame(frame)).unwrap();
    h.picture().unwrap().into_raw()
}

fn at(time_s: f64) -> Option<Moment> {
    Some(Moment { clip: "go".into(), time_s })
}

#[test]
fn an_instance_is_drawn_where_its_clip_has_it_at_a_time() {
    let Some(mut h) = headless(96, 64) else { return };
    // Out of view at first, so that culling by where it was would hide it.
    let (still, start) = (placed(DVec3::new(-1.5, -0.5, 0.0)), placed(DVec3::new(6.0, -0.5, 0.0)));
    let scene = |h: &Headless, second: Instance| {
        let mut view = SceneView::new();
        arrive(h, &mut view, [vec![Change::Instances(vec![still, second])], pyramid()].concat());
        view
    };
    let mut view = scene(&h, start);
    let rest = picture(&mut h, &view);
    // The clip may come before or after what it moves, and before it is chosen.
    view.animate(h.gpu(), at(1.5)).unwrap();
    assert_eq!(picture(&mut h, &view), rest);
    arrive(&h, &mut view, vec![Change::Animation { number: 0, model: model().into() }]);
    let turn = DQuat::from_rotation_z(1.5 / 2.0 * std::f64::consts::FRAC_PI_2);
    let to = DVec3::new(6.0 - 3.0, -0.5 + 0.75, 0.0) - turn * DVec3::from(ORIGIN);
    let moved = Instance { asset: 0, placement: Placement::new(to, turn, 1.0) };
    let there = scene(&h, moved);
    let (found, expected) = (picture(&mut h, &view), picture(&mut h, &there));
    assert_ne!(found, rest);
    let differ = found.iter().zip(&expected).filter(|(a, b)| a.abs_diff(**b) > 6).count();
    assert!(differ < found.len() / 200, "{differ} of {} values differ", found.len());
    // One after the other, and back.
    view.animate(h.gpu(), at(0.0)).unwrap();
    assert_eq!(picture(&mut h, &view), rest);
    view.animate(h.gpu(), at(1.5)).unwrap();
    assert_eq!(picture(&mut h, &view), found);
    view.animate(h.gpu(), None).unwrap();
    assert_eq!(picture(&mut h, &view), rest);
    let mut late = SceneView::new();
    late.animate(h.gpu(), at(1.5)).unwrap();
    arrive(&h, &mut late, vec![Change::Animation { number: 0, model: model().into() }]);
    arrive(&h, &mut late, [vec![Change::Instances(vec![still, start])], pyramid()].concat());
    assert_eq!(picture(&mut h, &late), found);
}
