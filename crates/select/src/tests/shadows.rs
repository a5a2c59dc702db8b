//! Instances out of view that cast shadows into it.

use std::num::NonZeroUsize;

use super::super::priority::is_hidden;
use super::*;

/// Ground in view, and something above and behind the eye.
fn scene() -> [Instance; 2] {
    [
        Instance::at(0, [0.0; 3]),
        Instance { asset: 1, placement: Placement { scale: 0.5, ..Placement::at([0.0, 3.0, 6.0]) } },
    ]
}

/// Direction to a sun behind the eye: the shadow of the instance behind falls into view.
const BEHIND: [f32; 3] = [0.0, 0.5, 1.0];
/// Direction to a sun before the eye: it does not.
const BEFORE: [f32; 3] = [0.0, 0.5, -1.0];

fn assets() -> [AssetState; 2] {
    [known_asset(7), known_asset(7)]
}

fn selector(shadows: bool, to_sun: Option<[f32; 3]>) -> Selector {
    let max_wanted = NonZeroUsize::new(1 << 20).unwrap();
    let mut selector = Selector::new(SelectSettings { shadows, max_wanted, ..SelectSettings::default() });
    selector.set_to_sun(to_sun);
    selector
}

fn view() -> View {
    above([0.0, 1.0, 2.0])
}

fn is_caster(wanted: &Wanted) -> bool {
    matches!(wanted.id, BlobId::Asset { asset: 1, .. })
}

#[test]
fn shadow_casters_are_refined_last() {
    let mut assets = assets();
    assets[0].set_state(BlobPart::Chunk(0), State::Applied);
    let plain = selector(false, Some(BEHIND)).select(&view(), &scene(), &assets).clone();
    let with = selector(true, Some(BEHIND)).select(&view(), &scene(), &assets).clone();
    assert!(!plain.wanted.iter().any(is_caster) && plain.counters.shadow_bytes == 0);
    let (casters, others): (Vec<Wanted>, Vec<Wanted>) = with.wanted.iter().copied().partition(is_caster);
    assert!(!casters.is_empty() && casters.iter().all(|wanted| is_hidden(wanted.priority)));
    assert_eq!(others, plain.wanted, "the view itself wants the same");
    assert!(with.wanted.is_sorted_by_key(is_caster));
    let [of_view, of_all] = [&plain, &with].map(|selection| selection.counters.max_screen_error_px);
    assert_eq!(of_view, of_all, "shadows do not count in the screen error");
}

#[test]
fn instances_without_shadows_in_view_are_not_refined() {
    let some = |to_sun: Option<[f32; 3]>, placed: &[Instance]| {
        selector(true, to_sun).select(&view(), placed, &assets()).wanted.iter().any(is_caster)
    };
    assert!(some(Some(BEHIND), &scene()));
    for to_sun in [None, Some(BEFORE), Some([0.0; 3]), Some([f32::NAN; 3])] {
        assert!(!some(to_sun, &scene()), "{to_sun:?}");
    }
    // The shadow falls below everything in view.
    let mut placed = scene();
    placed[1].placement.translation = [0.0, -3.0, 6.0];
    assert!(!some(Some(BEHIND), &placed));
}

/// The larger the caster, the more bytes it has: at most a tenth of the bytes that the view needs are fetched.
#[test]
fn shadows_use_at_most_a_tenth_of_the_bytes() {
    let mut most = 0.0_f64;
    for scale in [0.1, 0.5, 2.0, 8.0] {
        for max_faces in [8_000_000, 40_000] {
            let mut placed = scene();
            placed[1].placement.scale = scale;
            let mut assets = assets();
            let mut selector = selector(true, Some(BEHIND));
            selector.settings_mut().max_faces = max_faces;
            settle(&mut selector, &view(), &placed, &mut assets);
            let counters = &selector.last().counters;
            let (all, shadow) = (counters.needed_bytes as f64, counters.shadow_bytes as f64);
            assert!(shadow <= 0.1 * (all - shadow), "{shadow} of {all} bytes");
            assert!(counters.applied_faces <= max_faces);
            most = most.max(shadow / (all - shadow));
        }
    }
    assert!(most > 0.05, "{most}");
}
