//! Vertices that follow joints are drawn where a clip's pose takes them.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, Vertex};
use lodestream_geometry::mesh::skin::Skin;
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::animation::{
    AnimatedModel, AnimatedNode, AnimatedSkin, Channel, Clip, Interpolation, Moment, Property, Rest,
    SkinJoint, SkinPose,
};
use lodestream_scene::description::Instance;
use lodestream_scene::parts::ScenePart;

use super::headless;
use crate::{Headless, Material, PartState, Pose, SceneView, Settings, Tint};

/// Where the asset's origin is, far from zero.
const ORIGIN: [f64; 3] = [1e5, -2e5, 3e5];
/// Rings of a tube along y, and its sides.
const RINGS: usize = 12;
const SIDES: usize = 10;

/// A place of the tube, its normal and its skin: the lower half follows one joint, the upper end another.
fn place(ring: usize, side: usize) -> (DVec3, DVec3, Skin) {
    let along = ring as f64 / (RINGS - 1) as f64;
    let turn = std::f64::consts::TAU * side as f64 / SIDES as f64;
    let normal = DVec3::new(turn.cos(), 0.0, turn.sin());
    let share = (2.0 * along - 0.5).clamp(0.0, 1.0);
    (0.3 * normal + DVec3::Y * 2.0 * along, normal, Skin::new([(0, 1.0 - share), (1, share)]))
}

/// The tube, each vertex where `moved` takes it, with the skins or without.
fn tube(skinned: bool, moved: impl Fn(DVec3, DVec3, Skin) -> (DVec3, DVec3)) -> Vec<Change> {
    let vertex = |number: usize| {
        let (at, normal, skin) = place(number / SIDES, number % SIDES);
        let (at, normal) = moved(at, normal, skin);
        let position = at.as_vec3().to_array();
        let data = RenderVertex {
            position,
            normal: normal.as_vec3().to_array(),
            uv: [0.0; 2],
            color: [200, 90, 60, 255],
            morph_from: position,
            smooth: true,
            part: 0,
            skin: if skinned { skin } else { Skin::default() },
            second_uv: [0.0; 2],
        };
        Vertex { data, birth_s: 0.0, level: 0 }
    };
    let at = |ring: usize, side: usize| (ring * SIDES + side % SIDES) as u32;
    let quads = (0..RINGS - 1).flat_map(|ring| (0..SIDES).map(move |side| (ring, side)));
    let faces: Vec<[u32; 3]> = quads
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let vertices: Vec<Vertex> = (0..RINGS * SIDES).map(vertex).collect();
    vec![
        Change::Asset(NewAsset {
            asset: 0,
            origin: ORIGIN,
            center: [0.0, 1.0, 0.0],
            radius: 1.2,
            materials: vec![Material::default()],
            textures: Vec::new(),
            shared: Vec::new(),
        }),
        Change::Mesh(MeshChange {
            asset: 0,
            vertex_slots: vertices.len() as u32,
            index_slots: vec![faces.len() as u32],
            vertices: vec![(0, vertices)],
            indices: vec![IndexRun { material: 0, first: 0, faces }],
        }),
    ]
}

/// The second joint turns about z at the tube's middle, by a right angle in two seconds; the first one moves.
fn model() -> AnimatedModel {
    let middle = DAffine3::from_translation(DVec3::from(ORIGIN) + DVec3::Y);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let channel = |node, property, values: &[f32]| Channel {
        node,
        property,
        interpolation: Interpolation::Linear,
        timeline: 0,
        values: values.to_vec(),
    };
    let channels = vec![
        channel(0, Property::Translation, &[0.0, 0.0, 0.0, 0.0, -0.5, 0.0]),
        channel(1, Property::Rotation, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half]),
    ];
    let node = |parent, to_parent| AnimatedNode { parent, to_parent, rest: Rest::default() };
    AnimatedModel {
        nodes: vec![node(None, DAffine3::IDENTITY), node(Some(0), middle)],
        skins: vec![AnimatedSkin {
            joints: vec![
                SkinJoint { node: Some(0), to_node: DAffine3::IDENTITY },
                SkinJoint { node: Some(1), to_node: middle.inverse() },
            ],
        }],
        places: vec![vec![0]],
        timelines: vec![vec![0.0, 2.0]],
        clips: vec![Clip { name: "bend".into(), channels }],
        ..AnimatedModel::default()
    }
}

fn at(time_s: f64) -> Moment {
    Moment { clip: "bend".into(), time_s }
}

/// The twin of the shader: blended maps, normals by their cofactors.
fn posed(pose: &SkinPose, place: DVec3, normal: DVec3, skin: Skin) -> (DVec3, DVec3) {
    let origin = DVec3::from(ORIGIN);
    let moved = pose.apply(skin.influences(), origin + place) - origin;
    let linear = skin.influences().fold(DMat3::ZERO, |sum, (joint, weight)| {
        sum + pose.joints()[usize::from(joint)].matrix3 * (f64::from(weight) / 255.0)
    });
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = linear;
    (moved, (DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * normal).normalize())
}

fn scene(h: &Headless, mesh: Vec<Change>) -> SceneView {
    let mut view = SceneView::new();
    let instance = Instance::at(0, (-DVec3::from(ORIGIN)).to_array());
    view.push([vec![Change::Instances(vec![instance])], mesh].concat());
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    view
}

fn picture(h: &mut Headless, scene: &SceneView) -> Vec<u8> {
    let camera = Pose::look_at(DVec3::new(-0.5, 1.2, 4.0), DVec3::new(-0.5, 0.8, 0.0), DVec3::Y, 0.8);
    scene.with_frame(camera, Settings::default(), f32::MAX, |frame| h.frame(frame)).unwrap();
    h.picture().unwrap().into_raw()
}

/// Share of values that differ by more than rounding.
fn differing(a: &[u8], b: &[u8]) -> f64 {
    let differ = a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 6).count();
    differ as f64 / a.len() as f64
}

#[test]
fn a_skinned_mesh_is_drawn_as_one_whose_vertices_were_moved() {
    let Some(mut h) = headless(96, 96) else { return };
    let unmoved = |place, normal, _| (place, normal);
    let mut view = scene(&h, tube(true, unmoved));
    let rest = picture(&mut h, &view);
    let plain = scene(&h, tube(false, unmoved));
    assert_eq!(picture(&mut h, &plain), rest, "a skin without a pose changes nothing");
    // Nothing moves before the clip has arrived, or without one.
    view.animate(h.gpu(), Some(at(1.2))).unwrap();
    assert_eq!(picture(&mut h, &view), rest);
    view.push(vec![Change::Animation { number: 0, model: model().into() }]);
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    let model = model();
    for time_s in [1.2, 2.0, 0.4] {
        view.animate(h.gpu(), Some(at(time_s))).unwrap();
        let found = picture(&mut h, &view);
        let pose = model.poses_at(model.clips.first(), time_s).remove(0);
        let there = scene(&h, tube(false, |place, normal, skin| posed(&pose, place, normal, skin)));
        let expected = picture(&mut h, &there);
        assert!(differing(&found, &rest) > 0.03, "{time_s}: nothing moved");
        let differ = differing(&found, &expected);
        assert!(differ < 0.005, "{time_s}: {differ} of the values differ");
    }
    view.animate(h.gpu(), None).unwrap();
    assert_eq!(picture(&mut h, &view), rest);
}

#[test]
fn the_one_part_of_a_skinned_mesh_takes_states_with_and_without_a_pose() {
    let Some(mut h) = headless(96, 96) else { return };
    let mut view = scene(&h, tube(true, |place, normal, _| (place, normal)));
    view.push(vec![Change::Animation { number: 0, model: model().into() }]);
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    let empty = {
        let mut gone = SceneView::new();
        gone.push(vec![Change::Instances(Vec::new())]);
        gone.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
        picture(&mut h, &gone)
    };
    let part = ScenePart { instance: 0, part: 0 };
    let tint = Some(Tint { colour: [0, 0, 255], strength: 1.0 });
    for moment in [None, Some(at(1.0))] {
        view.animate(h.gpu(), moment).unwrap();
        let shown = picture(&mut h, &view);
        view.set_parts(h.gpu(), &[(part, PartState { tint, ..PartState::default() })]).unwrap();
        assert!(differing(&picture(&mut h, &view), &shown) > 0.02, "the tint is seen");
        view.set_parts(h.gpu(), &[(part, PartState::HIDDEN)]).unwrap();
        assert!(differing(&picture(&mut h, &view), &empty) < 0.001, "nothing is left");
        view.set_parts(h.gpu(), &[(part, PartState::default())]).unwrap();
        assert_eq!(picture(&mut h, &view), shown);
    }
}

#[test]
fn a_pose_that_leaves_the_view_by_its_bounds_alone_is_not_culled() {
    let Some(mut h) = headless(64, 64) else { return };
    // The asset stands far away; its joints bring it into view.
    let far = DVec3::new(50.0, 0.0, 0.0);
    let mut view = SceneView::new();
    let instance = Instance::at(0, (far - DVec3::from(ORIGIN)).to_array());
    let mesh = tube(true, |place, normal, _| (place, normal));
    let back = DAffine3::from_rotation_translation(DQuat::IDENTITY, -far);
    let joint = SkinJoint { node: None, to_node: back };
    let model = AnimatedModel {
        skins: vec![AnimatedSkin { joints: vec![joint; 2] }],
        nodes: Vec::new(),
        clips: Vec::new(),
        ..model()
    };
    view.push([vec![Change::Instances(vec![instance])], mesh].concat());
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    let away = picture(&mut h, &view);
    // Joints that rest elsewhere count without a clip.
    view.push(vec![Change::Animation { number: 0, model: model.into() }]);
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
    assert!(differing(&picture(&mut h, &view), &away) > 0.03);
}
