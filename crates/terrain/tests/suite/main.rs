//! Terrain: the same heights on every machine, in any order and division of windows.
#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]

mod agreement;
mod extremes;
mod features;
mod golden;
mod golden_cases;
mod spectrum;
mod wire;

use lodestream_terrain::{
    Distribution, Erosion, FeatureSet, Mode, Parameters, Point, Scratch, Shape, Terrain,
};
use proptest::prelude::*;

/// Heights of a window.
fn window(terrain: &Terrain, level: i8, x: i64, y: i64, width: usize, height: usize) -> Vec<i32> {
    let mut out = Vec::new();
    terrain.window(level, x, y, width, height, &mut Scratch::new(), &mut out).unwrap();
    out
}

/// A terrain of `finest_level` in a world of 2^10 patches along each axis.
fn parameters(seed: u64, finest_level: u8) -> Parameters {
    Parameters { seed, finest_level, extent_log2: 10, amplitude: 100_000, ..Parameters::default() }
}

/// A few features within `reach` of the origin, where patches meet.
fn features(reach: i64) -> impl Strategy<Value = Vec<FeatureSet>> {
    let at = move || (-reach..=reach, -reach..=reach);
    let points = move || {
        prop::collection::hash_map(at(), -200_000..200_000, 0..40).prop_map(|points| {
            let points = points.into_iter().map(|((x, y), height)| Point { x, y, height });
            let mut points: Vec<_> = points.collect();
            points.sort_by_key(|p| (p.x, p.y));
            points
        })
    };
    let stamp =
        (at(), at(), 1..30_u32, -90_000..90_000, any::<bool>()).prop_map(|(a, b, width, height, disc)| {
            if disc {
                Shape::Crater { centre: [a.0, a.1], radius: width, depth: height, rim: height / 3 }
            } else {
                Shape::Valley { from: [a.0, a.1], to: [b.0, b.1], half_width: width, depth: height }
            }
        });
    let set =
        move |mode| {
            (points(), prop::collection::vec(stamp.clone(), 0..3))
                .prop_map(move |(points, stamps)| FeatureSet { mode, points, stamps })
        };
    (set.clone()(Mode::Fixed), set(Mode::Additive)).prop_map(|(fixed, additive)| vec![fixed, additive])
}

/// Erosion, off in half of the cases.
fn erosion(finest_level: u8) -> impl Strategy<Value = Erosion> {
    let some = (0..=finest_level, 0..5_u8, 0..3000_u16, 0..3_u8)
        .prop_map(|(level, passes, talus, spike_limit)| Erosion { level, passes, talus, spike_limit });
    prop_oneof![Just(Erosion::default()), some]
}

/// A terrain with features around the origin, possibly with erosion.
fn any_terrain() -> impl Strategy<Value = Terrain> {
    (any::<u64>(), 1..7_u8, any::<bool>())
        .prop_flat_map(|(seed, n, gaussian)| (Just((seed, n, gaussian)), erosion(n), features(3 << n)))
        .prop_map(|((seed, n, gaussian), erosion, features)| {
            let distribution = if gaussian { Distribution::Gaussian } else { Distribution::Uniform };
            let parameters = Parameters { distribution, erosion, ..parameters(seed, n) };
            Terrain::with_features(parameters, &features).unwrap()
        })
}
