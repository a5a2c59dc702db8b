//! Parts of an asset, hidden and tinted.

use glam::DVec3;

use super::headless;
use super::shapes::{Mesh, at, cube, quad, sphere};
use crate::{
    Alpha, AntiAliasing, AssetGpu, DebugView, Drawable, Frame, Headless, InstanceStates, MAX_PARTS, Material,
    PackedVertex, PartState, PartStates, Placement, Pose, RenderError, Settings, Tint,
};

const SIZE: u32 = 160;

/// A floor, a cube, a transparent sphere and an alpha-tested one, each a part and a material of one asset.
fn parts() -> Vec<Mesh> {
    let moved = |(vertices, faces): Mesh, by: [f32; 3], part| {
        let place = |v: &PackedVertex| {
            let position = std::array::from_fn(|i| v.position[i] + by[i]);
            PackedVertex { position, morph_from: position, ..*v }.of_part(part).at_level(part)
        };
        (vertices.iter().map(place).collect(), faces)
    };
    let floor = quad([-3.0, 0.0, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0], 1.0);
    vec![
        moved(floor, [0.0; 3], 0),
        moved(cube(), [-0.9, 0.5, 0.0], 1),
        moved(sphere(12), [0.9, 0.5, 0.4], 2),
        moved(sphere(12), [0.2, 0.5, -0.9], 3),
    ]
}

/// The asset with the faces of all parts but one.
fn without(h: &Headless, left_out: Option<usize>) -> AssetGpu {
    let of = |base_color, alpha| Material { base_color, alpha, ..Material::default() };
    let materials = [
        of([0.6, 0.6, 0.6, 1.0], Alpha::Opaque),
        of([0.8, 0.5, 0.3, 1.0], Alpha::Opaque),
        of([0.3, 0.5, 0.8, 0.6], Alpha::Blend),
        of([0.5, 0.8, 0.3, 1.0], Alpha::Mask(0.5)),
    ];
    let mut asset = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &materials, &[]);
    let mut first = 0;
    for (number, (vertices, faces)) in parts().into_iter().enumerate() {
        asset.update_vertices(h.gpu(), first as usize, &vertices).unwrap();
        if left_out != Some(number) {
            let faces: Vec<_> = faces.iter().map(|face| face.map(|slot| slot + first)).collect();
            asset.update_indices(h.gpu(), number, 0, &faces).unwrap();
        }
        first += vertices.len() as u32;
    }
    asset
}

/// States of parts of the first instance.
fn states(parts: &[(u32, PartState)]) -> PartStates {
    let instance = InstanceStates { parts: parts.iter().copied().collect(), ..Default::default() };
    PartStates { instances: [(0, instance)].into(), ..Default::default() }
}

fn tint(colour: [u8; 3], strength: f32) -> PartState {
    PartState { tint: Some(Tint { colour, strength }), ..Default::default() }
}

fn draw_instances(
    h: &mut Headless,
    asset: &AssetGpu,
    instances: &[Placement],
    settings: Settings,
) -> Vec<[u8; 4]> {
    let camera = Pose::look_at(DVec3::new(0.8, 2.1, 3.4), DVec3::new(0.0, 0.3, 0.0), DVec3::Y, 0.8);
    let drawables = [Drawable { asset, instances }];
    h.frame(&Frame { settings, ..Frame::new(camera, &drawables) }).unwrap();
    h.picture().unwrap().pixels().map(|p| p.0).collect()
}

fn draw(h: &mut Headless, asset: &AssetGpu, settings: Settings) -> Vec<[u8; 4]> {
    draw_instances(h, asset, &[Placement::default()], settings)
}

/// Settings under which a surface changes no pixel but its own.
fn alone() -> Settings {
    Settings { shadows: None, occlusion: None, anti_aliasing: AntiAliasing::None, ..Settings::default() }
}

/// Pixels that differ between two pictures.
fn differing(a: &[[u8; 4]], b: &[[u8; 4]]) -> Vec<bool> {
    a.iter().zip(b).map(|(a, b)| a != b).collect()
}

fn count(pixels: &[bool]) -> usize {
    pixels.iter().filter(|differs| **differs).count()
}

#[test]
fn hiding_a_part_is_as_if_it_were_not_there_and_showing_it_restores_the_picture() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let wireframe = Settings { wireframe: true, ..alone() };
    let overdraw = Settings { debug_view: DebugView::Overdraw, ..alone() };
    let all = Settings { anti_aliasing: AntiAliasing::None, ..Settings::default() };
    assert!(all.shadows.is_some() && all.occlusion.is_some());
    for settings in [all, Settings::default(), alone(), wireframe, overdraw] {
        let mut asset = without(&h, None);
        let whole = draw(&mut h, &asset, settings);
        for part in 0..4 {
            asset.set_part_states(h.gpu(), states(&[(part, PartState::HIDDEN)])).unwrap();
            let hidden = draw(&mut h, &asset, settings);
            let absent = without(&h, Some(part as usize));
            assert!(hidden == draw(&mut h, &absent, settings), "part {part}, {settings:?}");
            assert!(count(&differing(&hidden, &whole)) > 100, "part {part}, {settings:?}");
        }
        asset.set_part_states(h.gpu(), PartStates::default()).unwrap();
        assert!(whole == draw(&mut h, &asset, settings), "{settings:?}");
    }
}

#[test]
fn hiding_or_tinting_a_part_changes_only_its_pixels() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let mut asset = without(&h, None);
    let whole = draw(&mut h, &asset, alone());
    // Transparent surfaces write no depth.
    for part in [0, 1, 3] {
        draw(&mut h, &asset, alone());
        let depth = h.depth().unwrap();
        let absent = without(&h, Some(part as usize));
        draw(&mut h, &absent, alone());
        let own: Vec<bool> = depth.iter().zip(h.depth().unwrap()).map(|(a, b)| *a != b).collect();
        for state in [PartState::HIDDEN, tint([255, 0, 160], 0.7)] {
            asset.set_part_states(h.gpu(), states(&[(part, state)])).unwrap();
            let changed = differing(&whole, &draw(&mut h, &asset, alone()));
            assert!(
                changed.iter().zip(&own).all(|(changed, own)| *own || !changed),
                "part {part}, {state:?}"
            );
            assert!(10 * count(&changed) > 9 * count(&own), "part {part}, {state:?}");
        }
        asset.set_part_states(h.gpu(), PartStates::default()).unwrap();
    }
}

/// Each part in the colour of a full tint, with or without light.
#[test]
fn a_full_tint_is_the_base_colour() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let colour = [30, 200, 90];
    let linear = colour.map(|c: u8| {
        let c = f32::from(c) / 255.0;
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    });
    let materials = [[0.6, 0.6, 0.6, 1.0], [0.8, 0.5, 0.3, 1.0], [0.3, 0.5, 0.8, 0.6], [0.5, 0.8, 0.3, 1.0]];
    let alphas = [Alpha::Opaque, Alpha::Opaque, Alpha::Blend, Alpha::Mask(0.5)];
    for part in 0..4_usize {
        let mut tinted = without(&h, None);
        tinted.set_part_states(h.gpu(), states(&[(part as u32, tint(colour, 1.0))])).unwrap();
        let mut painted = without(&h, None);
        let base_color = [linear[0], linear[1], linear[2], materials[part][3]];
        let material = Material { base_color, alpha: alphas[part], ..Material::default() };
        painted.set_material(h.gpu(), part, material).unwrap();
        let (got, want) =
            (draw(&mut h, &tinted, Settings::default()), draw(&mut h, &painted, Settings::default()));
        let off = |(a, b): (&[u8; 4], &[u8; 4])| (0..4).map(|i| a[i].abs_diff(b[i])).max().unwrap_or(0);
        assert!(got.iter().zip(&want).map(off).max() <= Some(1), "part {part}");
        let half = states(&[(part as u32, tint(colour, 0.5))]);
        tinted.set_part_states(h.gpu(), half).unwrap();
        assert!(draw(&mut h, &tinted, Settings::default()) != got, "part {part}");
    }
}

/// Temporal anti-aliasing and accumulated occlusion stop when nothing changes.
#[test]
fn a_picture_that_has_settled_follows_a_change_of_state() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let settings = Settings { anti_aliasing: AntiAliasing::Temporal, ..Settings::default() };
    let settle = |h: &mut Headless, asset: &AssetGpu| {
        (0..70).map(|_| draw(h, asset, settings)).last().unwrap_or_default()
    };
    // Jitter begins elsewhere: edges differ by a little.
    let off = |a: &[[u8; 4]], b: &[[u8; 4]]| {
        let far = |a: &[u8; 4], b: &[u8; 4]| (0..3).any(|i| a[i].abs_diff(b[i]) > 12);
        a.iter().zip(b).filter(|(a, b)| far(a, b)).count()
    };
    let absent = without(&h, Some(1));
    let mut asset = without(&h, None);
    let (absent, whole) = (settle(&mut h, &absent), settle(&mut h, &asset));
    assert!(off(&absent, &whole) > 500, "{}", off(&absent, &whole));
    for (state, want) in [(PartState::HIDDEN, &absent), (PartState::default(), &whole)] {
        asset.set_part_states(h.gpu(), states(&[(1, state)])).unwrap();
        let after = settle(&mut h, &asset);
        assert!(off(&after, want) < 20, "{state:?}: {}", off(&after, want));
    }
}

#[test]
fn instances_have_states_of_their_own() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let mut asset = without(&h, None);
    let places = [Placement::default(), at(0.5, 0.8, -1.5, 0.7)];
    let all = Settings::default();
    let both = draw_instances(&mut h, &asset, &places, all);
    let second = draw_instances(&mut h, &asset, &places[1..], all);
    let second_alone = draw_instances(&mut h, &asset, &places[1..], alone());
    let hidden = InstanceStates { others: PartState::HIDDEN, ..Default::default() };
    // The whole first instance, as one or part by part, where its bounds still count for shadow maps.
    let one_by_one = (0..4).map(|part| (part, PartState::HIDDEN)).collect();
    let by_parts = InstanceStates { parts: one_by_one, ..Default::default() };
    for (first, settings, want) in [(hidden, all, &second), (by_parts, alone(), &second_alone)] {
        let only_first = PartStates { instances: [(0, first)].into(), ..Default::default() };
        asset.set_part_states(h.gpu(), only_first).unwrap();
        assert!(*want == draw_instances(&mut h, &asset, &places, settings));
    }
    // All instances but the second.
    let shown = InstanceStates::default();
    let only_second =
        PartStates { others: PartState::HIDDEN, instances: [(1, shown)].into(), ..PartStates::default() };
    asset.set_part_states(h.gpu(), only_second).unwrap();
    assert!(second == draw_instances(&mut h, &asset, &places, Settings::default()));
    asset.set_part_states(h.gpu(), PartStates::default()).unwrap();
    assert!(both == draw_instances(&mut h, &asset, &places, Settings::default()));
}

#[test]
fn the_first_states_compile_pipelines_and_large_parts_are_refused() {
    let Some(mut h) = headless(SIZE, SIZE) else { return };
    let mut asset = without(&h, None);
    draw(&mut h, &asset, Settings::default());
    let without = h.gpu().compiled_pipelines();
    asset.set_part_states(h.gpu(), states(&[(0, tint([9, 9, 9], 0.5))])).unwrap();
    draw(&mut h, &asset, Settings::default());
    let compiled = h.gpu().compiled_pipelines();
    assert!(compiled > without);
    let many: Vec<_> = (0..5000).map(|part| (part, tint([9, 9, 9], 0.5))).collect();
    asset.set_part_states(h.gpu(), states(&many)).unwrap();
    let tinted = draw(&mut h, &asset, Settings::default());
    assert_eq!(h.gpu().compiled_pipelines(), compiled);
    let refused = asset.set_part_states(h.gpu(), states(&[(MAX_PARTS, PartState::HIDDEN)]));
    assert!(matches!(refused, Err(RenderError::NoSuch { what: "part", .. })), "{refused:?}");
    assert!(tinted == draw(&mut h, &asset, Settings::default()));
}
