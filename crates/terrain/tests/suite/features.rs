//! Features: overridden heights have their values, and heights that should not change do not.

use super::{any_terrain, features, parameters, window};
use lodestream_terrain::{
    Erosion, FeatureSet, Features, HeightOverride, HeightOverrides, Mode, Parameters, Point, Scratch, Terrain,
};
use proptest::prelude::*;

proptest! {
    #[test]
    fn fixed_points_are_kept_and_additive_ones_add(seed: u64, n in 1u8..7, sets in features(100)) {
        let parameters = Parameters { extent_log2: 10, ..parameters(seed, n) };
        let stamps: Vec<_> =
            sets.iter().map(|set| FeatureSet { points: Vec::new(), ..set.clone() }).collect();
        let before = Terrain::with_features(parameters, &stamps).unwrap();
        let after = Terrain::with_features(parameters, &sets).unwrap();
        let mut scratch = Scratch::new();
        let fixed: std::collections::BTreeMap<_, _> =
            sets[0].points.iter().map(|p| ((p.x, p.y), p.height)).collect();
        for set in &sets {
            for p in &set.points {
                let was = match (fixed.get(&(p.x, p.y)), set.mode) {
                    (Some(height), Mode::Additive) => *height,
                    (_, Mode::Fixed) => 0,
                    (None, Mode::Additive) => before.height_at(p.x, p.y, &mut scratch).unwrap(),
                };
                let overruled = set.mode == Mode::Fixed && sets[1].points.iter().any(|q| (q.x, q.y) == (p.x, p.y));
                if !overruled {
                    prop_assert_eq!(after.height_at(p.x, p.y, &mut scratch).unwrap(), was + p.height);
                }
            }
        }
    }

    #[test]
    fn fixed_points_stay_under_erosion(terrain in any_terrain(), passes in 1u8..6, at in 0u8..7) {
        let n = terrain.finest_level() as u8;
        let erosion = Erosion { level: at.min(n), passes, talus: 10, spike_limit: 4 };
        let mut eroded = Terrain::with_stamps(
            Parameters { erosion, ..*terrain.parameters() },
            terrain.stamps().to_vec(),
        ).unwrap();
        let patches: Vec<_> = terrain.patches_with_points().collect();
        for &(x, y) in &patches {
            eroded.set_points(x, y, terrain.points(x, y).unwrap().clone()).unwrap();
        }
        for &(x, y) in patches.iter().take(3) {
            for p in terrain.points(x, y).unwrap().as_slice().iter().filter(|p| p.mode == Mode::Fixed) {
                let at = ((x << n) + i64::from(p.x), (y << n) + i64::from(p.y));
                prop_assert_eq!(eroded.height_at(at.0, at.1, &mut Scratch::new()).unwrap(), p.height);
            }
        }
    }

    #[test]
    fn patches_without_points_are_as_they_were(seed: u64, n in 2u8..6, at in (1u16..3, 1u16..3)) {
        let plain = Terrain::new(parameters(seed, n)).unwrap();
        let mut changed = plain.clone();
        let point = HeightOverride { x: at.0, y: at.1, mode: Mode::Additive, height: 1_000_000 };
        changed.set_points(3, -2, HeightOverrides::new(n, vec![point]).unwrap()).unwrap();
        for (x, y) in [(2, -2), (4, -2), (3, -1), (3, -3), (2, -1)] {
            prop_assert_eq!(plain.patch(x, y, n), changed.patch(x, y, n));
            prop_assert!(!changed.has_features(x, y));
        }
        prop_assert!(plain.patch(3, -2, n) != changed.patch(3, -2, n) && changed.has_features(3, -2));
        changed.remove_points(3, -2);
        prop_assert_eq!(plain.patch(3, -2, n), changed.patch(3, -2, n));
    }
}

/// A list with features of one mode.
fn list(mode: Mode, points: impl IntoIterator<Item = (i64, i64, i32)>) -> FeatureSet {
    let points = points.into_iter().map(|(x, y, height)| Point { x, y, height }).collect();
    FeatureSet { mode, points, stamps: Vec::new() }
}

#[test]
fn a_whole_surface_listed_as_fixed_is_that_surface() {
    let n = 5;
    let surface = |x: i64, y: i64| (x * x * 97 - y * 1000) as i32;
    let all = (-40..=70).flat_map(|y| (-40..=70).map(move |x| (x, y, surface(x, y))));
    let terrain = Terrain::with_features(parameters(1, n), &[list(Mode::Fixed, all)]).unwrap();
    for (i, height) in window(&terrain, 5, -40, -40, 111, 111).into_iter().enumerate() {
        assert_eq!(height, surface(i as i64 % 111 - 40, i as i64 / 111 - 40));
    }
}

#[test]
fn a_coarse_point_lifts_what_is_around_it() {
    let plain = Terrain::new(parameters(9, 6)).unwrap();
    let lifted = Terrain::with_features(parameters(9, 6), &[list(Mode::Additive, [(32, 32, 6400)])]).unwrap();
    let (before, after) = (plain.patch(0, 0, 6).unwrap(), lifted.patch(0, 0, 6).unwrap());
    let change = |x: usize, y: usize| after[y * 65 + x] - before[y * 65 + x];
    assert_eq!((change(32, 32), change(0, 32), change(0, 0)), (6400, 0, 0));
    assert!((1600..6400).contains(&change(32, 24)), "{}", change(32, 24));
    assert_eq!(change(24, 32), change(32, 24));
}

#[test]
fn gathered_features_make_the_same_terrain_patch_by_patch() {
    let sets = [list(Mode::Fixed, (0..50).map(|i| (i * 7 - 90, i * 3 - 70, i as i32 * 100)))];
    let whole = Terrain::with_features(parameters(3, 4), &sets).unwrap();
    let gathered = Features::gather(whole.parameters(), &sets).unwrap();
    let mut pieces = Terrain::with_stamps(*whole.parameters(), gathered.stamps).unwrap();
    for ((x, y), points) in gathered.patches.into_iter().rev() {
        pieces.set_points(x, y, points).unwrap();
    }
    assert_eq!(window(&whole, 4, -120, -120, 240, 240), window(&pieces, 4, -120, -120, 240, 240));
    assert_eq!(whole.points_bytes(), pieces.points_bytes());
}

#[test]
fn a_border_is_the_same_while_only_one_side_has_its_list() {
    let n = 3;
    let sets = [list(Mode::Fixed, (0..40).map(|i| (i % 5 * 4, i / 5 * 4 - 8, i as i32 * 9000)))];
    let gathered = Features::gather(&parameters(3, n), &sets).unwrap();
    let whole = Terrain::with_features(parameters(3, n), &sets).unwrap();
    // The height overrides of each list that has arrived are in effect, whichever have arrived.
    let lists: Vec<_> = gathered.patches.into_iter().collect();
    for arrived in 0..1_u32 << lists.len().min(9) {
        let mut some = Terrain::new(parameters(3, n)).unwrap();
        let arrived = lists.iter().enumerate().filter(|(i, _)| arrived >> i & 1 == 1).map(|(_, of)| of);
        for ((x, y), points) in arrived {
            some.set_points(*x, *y, points.clone()).unwrap();
        }
        for (x, y) in some.patches_with_points() {
            assert_eq!(some.patch(x, y, n), whole.patch(x, y, n), "patch {x}, {y}");
        }
    }
}
