//! Parts that are moved within their instances.

use glam::{DQuat, DVec3};
use lodestream_scene::parts::PartTransform;

use super::headless;
use super::shapes::{Mesh, at, cube, quad, sphere};
use crate::resources::vertex::pack_normal;
use crate::{
    Alpha, AntiAliasing, AssetGpu, DebugView, Drawable, Frame, Headless, InstanceStates, Material,
    PackedVertex, PartState, PartStates, Placement, Pose, Settings,
};

const SIZE: u32 = 160;
/// Where the assets' origin is, far from zero.
const ORIGIN: DVec3 = DVec3::new(3e5, -2e5, 1e5);

/// The same mesh as a part elsewhere.
fn placed((vertices, faces): Mesh, place: impl Fn(DVec3) -> DVec3, turn: DQuat, part: u32) -> Mesh {
    let vertex = |v: &PackedVertex| {
        let position = place(DVec3::from(v.position.map(f64::from))).as_vec3().to_array();
        let [x, y, z, smooth] = v.normal;
        let normal = turn * DVec3::from([x, y, z].map(|n| f64::from(n) / 32767.0));
        let [x, y, z, _] = pack_normal(normal.as_vec3().to_array());
        PackedVertex { position, morph_from: position, normal: [x, y, z, smooth], ..*v }.of_part(part)
    };
    (vertices.iter().map(vertex).collect(), faces)
}

/// A floor, a cube, a transparent sphere and an alpha-tested one, each a part and a material of one asset. One of them
/// stands where it is moved to, about the asset's zero.
fn asset(h: &Headless, moved: Option<(u32, PartTransform)>) -> AssetGpu {
    let floor = quad([-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0);
    let parts = [
        (floor, DVec3::ZERO),
        (cube(), DVec3::new(-0.9, 0.5, 0.0)),
        (sphere(12), DVec3::new(0.9, 0.5, 0.4)),
        (sphere(12), DVec3::new(0.2, 0.5, -0.9)),
    ];
    let of = |base_color, alpha| Material { base_color, alpha, ..Material::default() };
    let materials = [
        of([0.6, 0.6, 0.6, 1.0], Alpha::Opaque),
        of([0.8, 0.5, 0.3, 1.0], Alpha::Opaque),
        of([0.3, 0.5, 0.8, 0.6], Alpha::Blend),
        of([0.5, 0.8, 0.3, 1.0], Alpha::Mask(0.5)),
    ];
    let mut asset = h.renderer().create_asset(h.gpu(), ORIGIN, &materials, &[]);
    let mut first = 0;
    for (number, (mesh, by)) in (0..).zip(parts) {
        let to = moved.filter(|(part, _)| *part == number).map(|(_, to)| to);
        let place = |at: DVec3| to.map_or(at + by, |to| to.apply(ORIGIN + at + by) - ORIGIN);
        let turn = to.map_or(DQuat::IDENTITY, |to| to.rotation());
        let (vertices, faces) = placed(mesh, place, turn, number);
        asset.update_vertices(h.gpu(), first as usize, &vertices).unwrap();
        let faces: Vec<_> = faces.iter().map(|face| face.map(|slot| slot + first)).collect();
        asset.update_indices(h.gpu(), number as usize, 0, &faces).unwrap();
        first += vertices.len() as u32;
    }
    asset
}

/// A turn and a scale about a place of the asset, then a move.
fn about(pivot: DVec3, turn: DQuat, scale: f64, by: DVec3) -> PartTransform {
    let pivot = ORIGIN + pivot;
    PartTransform::new(pivot + by - turn * (scale * pivot), turn, scale).unwrap()
}

fn moves() -> [PartTransform; 2] {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 3.0, -1.0).normalize(), 0.9);
    [
        about(DVec3::ZERO, DQuat::IDENTITY, 1.0, DVec3::new(0.4, 0.6, 0.5)),
        about(DVec3::new(0.2, 0.5, 0.0), turn, 0.8, DVec3::new(-0.2, 0.3, 0.1)),
    ]
}

/// States of parts of the first instance.
fn states(parts: &[(u32, PartTransform)]) -> PartStates {
    let state = |to: &PartTransform| PartState { transform: Some(*to), ..Default::default() };
    let parts = parts.iter().map(|(part, to)| (*part, state(to))).collect();
    PartStates {
        instances: [(0, InstanceStates { parts, ..Default::default() })].into(),
        ..Default::default()
    }
}

fn draw(h: &mut Headless, asset: &AssetGpu, place: Placement, settings: Settings) -> Vec<[u8; 4]> {
    let camera = Pose::look_at(DVec3::new(0.8, 2.1, 3.4), DVec3::new(0.0, 0.3, 0.0), DVec3::Y, 0.8);
    // Placed by the asset's origin.
    let from_origin = place.to_world(ORIGIN) - DVec3::from(place.translation);
    let place = Placement { translation: (DVec3::from(place.translation) - from_origin).to_array(), ..place };
    let drawables = [Drawable { asset, instances: &[place] }];
    h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
    h.picture().unwrap().pixels().map(|p| p.0).collect()
}

/// Settings under which a surface changes no pixel but its own.
fn alone() -> Settings {
    Settings { shadows: None, occlusion: None, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

/// Number of pixels that differ by more than `most`.
fn differing(a: &[[u8; 4]], b: &[[u8; 4]], most: u8) -> usize {
    let far = |(a, b): (&[u8; 4], &[u8; 4])| (0..4).any(|i| a[i].abs_diff(b[i]) > most);
    a.iter().zip(b).filter(|pair| far(*pair)).count()
}

#[test]
fn a_moved_part_is_drawn_as_if_it_stood_there() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let shaded = Settings { anti_aliasing: AntiAliasing::None, ..Settings::default() };
    let wireframe = Settings { wireframe: true, ..alone() };
    let place = at(0.1, 0.05, -0.1, 0.9);
    for settings in [alone(), shaded, wireframe] {
        let mut whole = asset(&h, None);
        let unmoved = draw(&mut h, &whole, place, settings);
        for (part, to) in (0..4).flat_map(|part| moves().map(|to| (part, to))) {
            whole.set_part_states(h.gpu(), states(&[(part, to)])).unwrap();
            let got = draw(&mut h, &whole, place, settings);
            let there = asset(&h, Some((part, to)));
            let want = draw(&mut h, &there, place, settings);
            let (off, changed) = (differing(&got, &want, 8), differing(&got, &unmoved, 8));
            // Rounding moves edges; shadow maps reach farther, since bounds hold the whole asset there too.
            let most = if settings.shadows.is_some() { changed / 5 } else { 40 };
            assert!(changed > 300 && off <= most, "part {part} {to:?} {settings:?}: {off} of {changed}");
        }
        whole.set_part_states(h.gpu(), PartStates::default()).unwrap();
        assert!(unmoved == draw(&mut h, &whole, place, settings), "moved back");
    }
}

#[test]
fn moving_a_part_changes_nothing_else() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let mut whole = asset(&h, None);
    let place = Placement::default();
    let unmoved = draw(&mut h, &whole, place, alone());
    let hidden = |part| {
        let parts = [(part, PartState::HIDDEN)].into();
        let instances = [(0, InstanceStates { parts, ..Default::default() })].into();
        PartStates { instances, ..Default::default() }
    };
    for (part, to) in [1, 3].into_iter().flat_map(|part| moves().map(|to| (part, to))) {
        whole.set_part_states(h.gpu(), states(&[(part, to)])).unwrap();
        let moved = draw(&mut h, &whole, place, alone());
        // What the part covers, before and after, differs from the picture without it.
        whole.set_part_states(h.gpu(), hidden(part)).unwrap();
        let without = draw(&mut h, &whole, place, alone());
        let pixels = unmoved.iter().zip(&moved).zip(&without);
        assert!(pixels.clone().all(|((was, is), without)| was == is || was != without || is != without));
        assert!(pixels.filter(|((was, is), without)| was == without && is != without).count() > 50);
    }
}

/// As the same object that moves as an instance.
#[test]
fn motion_vectors_follow_a_moved_part() {
    let cubes = |h: &Headless| {
        let mut asset = h.renderer().create_asset(h.gpu(), ORIGIN, &[Material::default()], &[]);
        let (vertices, faces) = placed(cube(), |at| at, DQuat::IDENTITY, 5);
        asset.update_vertices(h.gpu(), 0, &vertices).unwrap();
        asset.update_indices(h.gpu(), 0, 0, &faces).unwrap();
        asset
    };
    let step = |frame: i32| DVec3::new(0.15, 0.05, 0.1) * f64::from(frame);
    // It stands at first, moves twice, one step of them in two parts, and stops.
    let steps = [0, 0, 1, 2, 2, 2];
    for settings in [
        Settings { debug_view: DebugView::Motion, ..alone() },
        Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() },
    ] {
        let (Some(mut by_part), Some(mut by_place)) = (headless(SIZE, SIZE), headless(SIZE, SIZE)) else {
            return;
        };
        let (mut moved, still) = (cubes(&by_part), cubes(&by_place));
        let mut most = 0;
        for (frame, step_of) in steps.into_iter().enumerate() {
            if frame > 0 {
                for to in [0.5 * (step(steps[frame - 1]) + step(step_of)), step(step_of)] {
                    let to = PartTransform::by(to).unwrap();
                    moved.set_part_states(by_part.gpu(), states(&[(5, to)])).unwrap();
                }
            }
            let got = draw(&mut by_part, &moved, Placement::default(), settings);
            let place = Placement::at(step(step_of).to_array());
            let want = draw(&mut by_place, &still, place, settings);
            let off = differing(&got, &want, 6);
            assert!(off < 60, "frame {frame}: {off} pixels, {settings:?}");
            most = most.max(differing(&want, &vec![want[0]; want.len()], 6));
        }
        assert!(most > 500, "{most}");
    }
}

/// The asset's own bounds are behind the eye.
#[test]
fn a_part_is_drawn_where_only_it_is_in_view() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let mut whole = asset(&h, None);
    whole.set_bounds(DVec3::ZERO, 5.0);
    let place = Placement::at([0.0, 0.0, 40.0]);
    let empty = draw(&mut h, &whole, place, alone());
    let to = PartTransform::by(DVec3::new(0.9, 0.0, -40.0)).unwrap();
    whole.set_part_states(h.gpu(), states(&[(1, to)])).unwrap();
    let moved = draw(&mut h, &whole, place, alone());
    assert!(differing(&moved, &empty, 8) > 300);
    whole.set_part_states(h.gpu(), PartStates::default()).unwrap();
    assert!(empty == draw(&mut h, &whole, place, alone()));
}
