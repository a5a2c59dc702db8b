//! Parts of a scene, hidden, tinted and isolated.

use glam::DVec3;
use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, Vertex};
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::description::{
    Camera, DEFAULT_AMBIENT, DEFAULT_BACKGROUND, Instance, SceneHeader, SceneLighting,
};
use lodestream_scene::parts::{PartTransform, ScenePart};
use lodestream_scene::proxy::{Cut, PartialProxy, Proxy};

use super::headless;
use crate::{Headless, MAX_PARTS, Material, PartState, Pose, RenderError, SceneView, Settings, Tint};

/// An asset of two squares side by side, parts 0 and 1.
fn asset(number: u32, color: [u8; 4]) -> Vec<Change> {
    let vertex = |x: f32, y: f32, part| {
        let data = RenderVertex {
            position: [x, y, 0.0],
            normal: [0.0, 0.0, 1.0],
            uv: [0.0; 2],
            color,
            morph_from: [x, y, 0.0],
            smooth: false,
            part,
            skin: Default::default(),
            second_uv: [0.0; 2],
        };
        Vertex { data, birth_s: 0.0, level: 0 }
    };
    let square =
        |x: f32, part| [(0.0, 0.0), (0.8, 0.0), (0.8, 0.8), (0.0, 0.8)].map(|(u, v)| vertex(x + u, v, part));
    let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    vec![
        Change::Asset(NewAsset {
            asset: number,
            origin: [0.0; 3],
            center: [1.0, 0.5, 0.0],
            radius: 1.5,
            materials: vec![Material::default()],
            textures: Vec::new(),
            shared: Vec::new(),
        }),
        Change::Mesh(MeshChange {
            asset: number,
            vertices: vec![(0, [square(0.0, 0), square(1.0, 1)].concat())],
            vertex_slots: 8,
            index_slots: vec![faces.len() as u32],
            indices: vec![IndexRun { material: 0, first: 0, faces }],
        }),
    ]
}

fn instances(of: &[(u32, [f64; 3])]) -> Change {
    Change::Instances(of.iter().map(|(asset, at)| Instance::at(*asset, *at)).collect())
}

const PLACES: [(u32, [f64; 3]); 3] = [(0, [-2.0, 0.2, 0.0]), (1, [0.2, 0.2, 0.0]), (0, [-1.0, -1.0, 0.0])];

fn arrive(h: &Headless, view: &mut SceneView, step: Vec<Change>) {
    view.push(step);
    view.upload(h.gpu(), h.renderer(), usize::MAX, 0.0).unwrap();
}

fn scene(h: &Headless) -> SceneView {
    let mut view = SceneView::new();
    arrive(
        h,
        &mut view,
        [vec![instances(&PLACES)], asset(0, [200, 60, 60, 255]), asset(1, [60, 60, 200, 255])].concat(),
    );
    view
}

fn picture(h: &mut Headless, scene: &SceneView) -> Vec<u8> {
    let camera = Pose::look_at(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, 0.8);
    scene.with_frame(camera, Settings::default(), f32::MAX, |frame| h.frame(frame)).unwrap();
    h.picture().unwrap().into_raw()
}

const fn part(instance: u32, part: u32) -> ScenePart {
    ScenePart { instance, part }
}

#[test]
fn isolating_parts_hides_all_others_and_clearing_restores_the_picture() {
    let Some(mut h) = headless(128, 128) else { return };
    let mut view = scene(&h);
    let whole = picture(&mut h, &view);
    let kept = [part(0, 1), part(1, 0)];
    view.isolate_parts(h.gpu(), Some(&kept)).unwrap();
    let isolated = picture(&mut h, &view);
    assert!(isolated != whole);
    let hidden = view.hidden_parts();
    assert!(hidden.contains(part(2, 0)) && !hidden.contains(kept[0]));
    assert!(view.part_state(part(2, 0)).hidden && !view.part_state(kept[0]).hidden);
    view.isolate_parts(h.gpu(), None).unwrap();
    assert!(picture(&mut h, &view) == whole);

    let hidden = [part(0, 0), part(1, 1), part(2, 0), part(2, 1)].map(|part| (part, PartState::HIDDEN));
    view.set_parts(h.gpu(), &hidden).unwrap();
    assert!(picture(&mut h, &view) == isolated);
    let tint = PartState { tint: Some(Tint { colour: [0, 255, 0], strength: 0.8 }), ..Default::default() };
    view.set_parts(h.gpu(), &[(kept[0], tint)]).unwrap();
    assert!(picture(&mut h, &view) != isolated);
    // Isolation keeps what is hidden, and tints.
    view.isolate_parts(h.gpu(), Some(&[part(0, 0), kept[0]])).unwrap();
    assert!(view.part_state(part(0, 0)).hidden && view.part_state(kept[0]) == tint);
    view.clear_parts(h.gpu()).unwrap();
    assert!(picture(&mut h, &view) == whole);

    let refused = view.set_parts(h.gpu(), &[(kept[0], tint), (part(0, MAX_PARTS), PartState::HIDDEN)]);
    assert!(matches!(refused, Err(RenderError::NoSuch { what: "part", .. })), "{refused:?}");
    assert!(picture(&mut h, &view) == whole);
}

/// The client is told which parts are moved, and for which instances no proxy may stand.
#[test]
fn a_moved_part_keeps_its_other_states_and_is_told_to_the_client() {
    let Some(mut h) = headless(128, 128) else { return };
    let mut view = scene(&h);
    let whole = picture(&mut h, &view);
    // The second square of one instance onto the place of the first, which is hidden.
    let back = PartTransform::by(DVec3::new(-1.0, 0.0, 0.0)).unwrap();
    let moved = PartState { transform: Some(back), ..Default::default() };
    view.set_parts(h.gpu(), &[(part(0, 0), PartState::HIDDEN), (part(0, 1), moved)]).unwrap();
    assert_eq!(view.moved_parts(), [(part(0, 1), back)].into());
    assert_eq!(view.pinned_instances(), [0]);
    let onto = picture(&mut h, &view);
    view.set_parts(h.gpu(), &[(part(0, 0), PartState::default()), (part(0, 1), PartState::HIDDEN)]).unwrap();
    assert!(picture(&mut h, &view) == onto && onto != whole, "the squares are equal");
    view.set_parts(h.gpu(), &[(part(0, 1), moved)]).unwrap();
    view.isolate_parts(h.gpu(), Some(&[part(0, 1)])).unwrap();
    assert_eq!(view.part_state(part(0, 1)), moved);
    view.clear_parts(h.gpu()).unwrap();
    assert!(view.moved_parts().is_empty() && picture(&mut h, &view) == whole);
}

/// States are those of the same parts, whether they were set before or after instances and assets arrived.
#[test]
fn parts_that_arrive_later_take_their_state() {
    let Some(mut h) = headless(128, 128) else { return };
    let hidden = [(part(1, 1), PartState::HIDDEN), (part(2, 0), PartState::HIDDEN)];
    let mut later = scene(&h);
    later.set_parts(h.gpu(), &hidden).unwrap();
    let mut want = vec![picture(&mut h, &later)];
    later.isolate_parts(h.gpu(), Some(&[part(2, 1), part(0, 0)])).unwrap();
    want.push(picture(&mut h, &later));

    for (isolated, want) in [None, Some(&[part(2, 1), part(0, 0)][..])].into_iter().zip(&want) {
        let mut view = SceneView::new();
        view.set_parts(h.gpu(), &hidden).unwrap();
        view.isolate_parts(h.gpu(), isolated).unwrap();
        arrive(&h, &mut view, vec![instances(&PLACES[..1])]);
        arrive(&h, &mut view, asset(0, [200, 60, 60, 255]));
        arrive(&h, &mut view, vec![instances(&PLACES[1..2])]);
        arrive(&h, &mut view, vec![instances(&PLACES[2..])]);
        arrive(&h, &mut view, asset(1, [60, 60, 200, 255]));
        assert!(picture(&mut h, &view) == *want, "{isolated:?}");
    }
}

/// A viewer whose device was lost names the parts before the scene is given again.
#[test]
fn states_from_before_the_first_scene_are_kept_and_those_of_another_scene_are_not() {
    let Some(h) = headless(16, 16) else { return };
    let header = SceneHeader {
        name: "squares".into(),
        fingerprint: [7; 16],
        asset_count: 2,
        instance_count: 3,
        page_count: 1,
        light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: DEFAULT_AMBIENT },
        background: DEFAULT_BACKGROUND,
        terrain: None,
        camera: Camera { eye: [0.0, 0.0, 5.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 0.9 },
        root_slope: 0.0,
    };
    let begins = || vec![Change::Scene(Box::new(header.clone())), instances(&PLACES)];
    let mut view = SceneView::new();
    view.set_parts(h.gpu(), &[(part(1, 1), PartState::HIDDEN)]).unwrap();
    arrive(&h, &mut view, begins());
    assert!(view.part_state(part(1, 1)).hidden);
    arrive(&h, &mut view, begins());
    assert!(!view.part_state(part(1, 1)).hidden);
}

/// A renderer draws the cut: a proxy or its instances, and nothing before the first cut.
#[test]
fn a_proxy_is_drawn_instead_of_its_instances_and_they_instead_of_it() {
    let Some(mut h) = headless(128, 128) else { return };
    let proxy = Proxy { asset: 2, instance_count: 2, error: 1.0, ..Proxy::default() };
    let colours = [[200, 60, 60, 255], [60, 60, 200, 255], [60, 200, 60, 255]];
    let assets = || (0..).zip(colours).flat_map(|(number, color)| asset(number, color));
    let of = |placed: &[(u32, [f64; 3])], h: &mut Headless| {
        let mut view = SceneView::new();
        arrive(h, &mut view, [instances(placed)].into_iter().chain(assets()).collect());
        picture(h, &view)
    };
    let empty = of(&[], &mut h);
    let [apart, stand_in] = [&PLACES[..], &[PLACES[2], (2, [0.0; 3])]].map(|placed| of(placed, &mut h));

    let mut view = SceneView::new();
    let cut = |proxies: &[u32], covered: &[[u32; 2]]| {
        let (proxies, covered) = (proxies.to_vec(), covered.to_vec());
        vec![Change::Cut(Cut { proxies, instances: 3, covered, partial: Vec::new() })]
    };
    arrive(&h, &mut view, vec![Change::Proxies(vec![proxy]), instances(&PLACES[..1])]);
    arrive(&h, &mut view, assets().collect());
    arrive(&h, &mut view, vec![instances(&PLACES[1..])]);
    assert!(picture(&mut h, &view) == empty, "nothing before the first cut");
    arrive(&h, &mut view, cut(&[0], &[[0, 2]]));
    assert!(picture(&mut h, &view) == stand_in);
    arrive(&h, &mut view, cut(&[], &[]));
    assert!(picture(&mut h, &view) == apart);
    // The second instance is there, the proxy is drawn without its second part.
    let mut want = SceneView::new();
    arrive(&h, &mut want, vec![instances(&[PLACES[1], PLACES[2], (2, [0.0; 3])])]);
    arrive(&h, &mut want, assets().collect());
    want.set_parts(h.gpu(), &[(part(2, 1), PartState::HIDDEN)]).unwrap();
    let partial = vec![PartialProxy { proxy: 0, hidden: vec![[1, 2]] }];
    let cut_in_part = Cut { proxies: vec![0], instances: 3, covered: vec![[0, 1]], partial };
    arrive(&h, &mut view, vec![Change::Cut(cut_in_part)]);
    let in_part = picture(&mut h, &view);
    assert!(in_part == picture(&mut h, &want) && in_part != stand_in && in_part != apart);
    // States of other parts do not show it again.
    view.set_parts(h.gpu(), &[(part(2, 0), PartState::HIDDEN)]).unwrap();
    want.set_parts(h.gpu(), &[(part(1, 0), PartState::HIDDEN)]).unwrap();
    assert!(picture(&mut h, &view) == picture(&mut h, &want));
    view.clear_parts(h.gpu()).unwrap();
    want.set_parts(h.gpu(), &[(part(1, 0), PartState::default())]).unwrap();
    assert!(picture(&mut h, &view) == picture(&mut h, &want));
    arrive(&h, &mut view, cut(&[0], &[[0, 2]]));
    assert!(picture(&mut h, &view) == stand_in);
    // Of isolated parts, proxies have none.
    view.isolate_parts(h.gpu(), Some(&[part(2, 0), part(2, 1)])).unwrap();
    assert!(picture(&mut h, &view) == of(&PLACES[2..], &mut h));
}
