//! Parameters, coordinates and heights at the ends of their ranges.

use super::{parameters, window};
use lodestream_terrain::{
    FeatureSet, HeightOverride, HeightOverrides, MAX_BASE_HEIGHT, MAX_WINDOW_POINTS, Mode, Parameters, Point,
    Scratch, Shape, Terrain,
};

/// The largest amplitude for a finest level.
fn highest(finest_level: u8) -> Parameters {
    let parameters = Parameters { finest_level, extent_log2: 31 - finest_level, ..Parameters::default() };
    let fits = |&amplitude: &u32| Parameters { amplitude, ..parameters }.check().is_ok();
    let amplitude = (0..31).rev().fold(0, |best, bit| Some(best | 1 << bit).filter(fits).unwrap_or(best));
    Parameters { amplitude, ..parameters }
}

#[test]
fn the_smallest_and_largest_patches_reach_the_edge_of_the_world() {
    for n in [1, 12] {
        let parameters = highest(n);
        assert!(parameters.worst_height() > MAX_BASE_HEIGHT - 100);
        let terrain = Terrain::new(parameters).unwrap();
        let edge = 1_i64 << 31;
        assert_eq!(terrain.edge(n as i8).unwrap(), edge);
        let last = (1_i64 << (31 - n)) - 1;
        for (x, y) in [(last, -last - 1), (-last - 1, last), (0, 0)] {
            let heights = terrain.patch(x, y, n).unwrap();
            assert!(heights.iter().all(|h| h.unsigned_abs() <= MAX_BASE_HEIGHT as u32));
        }
        let corner = window(&terrain, n as i8, edge - 1, edge - 1, 2, 2);
        assert_eq!(corner[3], terrain.height_at(edge, edge, &mut Scratch::new()).unwrap());
        // Coordinates beyond the edge are refused.
        let refused = |level, x, y, width, height| {
            terrain
                .window(level, x, y, width, height, &mut Scratch::new(), &mut Vec::new())
                .unwrap_err()
                .to_string()
        };
        assert!(refused(n as i8, edge, 0, 2, 1).contains("outside the world"));
        assert!(refused(n as i8, i64::MAX, i64::MIN, 1, 1).contains("outside the world"));
        assert!(refused(n as i8 + 1, 0, 0, 1, 1).contains("is outside"));
        assert!(refused(i8::MIN, 0, 0, 1, 1).contains("level -128 is outside"));
        assert!(refused(0, 0, 0, 0, 7).contains("0 x 7"));
        assert!(refused(0, 0, 0, usize::MAX, 2).contains("must have 1 to 67108864 points"));
        assert!(terrain.patch(last + 1, 0, n).unwrap_err().to_string().contains("outside the world"));
        // The whole world at a coarse level.
        assert_eq!(window(&terrain, terrain.coarsest_level(), -1, -1, 3, 3).len(), 9);
    }
    assert_eq!(MAX_WINDOW_POINTS, 1 << 26);
}

#[test]
fn listed_heights_at_the_limits_of_integers_are_kept_and_nothing_overflows() {
    for n in [1_u8, 4] {
        let side = 1_i64 << n;
        let limits = [i32::MIN, i32::MAX, i32::MAX, i32::MIN, 0];
        let points = |mode| {
            let points = (0..=side).flat_map(|y| (0..=side).map(move |x| (x, y)));
            let points = points.filter(|(x, y)| (x + y) % 2 == 0);
            let point = |(x, y)| Point { x, y, height: limits[((3 * x + y) % 5) as usize] };
            FeatureSet { mode, points: points.map(point).collect(), stamps: Vec::new() }
        };
        for mode in [Mode::Fixed, Mode::Additive] {
            let shape = Shape::Crater { centre: [1, 1], radius: 3, depth: i32::MIN, rim: i32::MAX };
            let stamps = FeatureSet { mode, points: Vec::new(), stamps: vec![shape] };
            let terrain = Terrain::with_features(highest(n), &[points(mode), stamps]).unwrap();
            for level in 0..=n {
                terrain.patch(0, 0, level).unwrap();
            }
            if mode == Mode::Fixed {
                let mut scratch = Scratch::new();
                for p in &points(mode).points {
                    assert_eq!(terrain.height_at(p.x, p.y, &mut scratch).unwrap(), p.height);
                }
            }
            assert_eq!(terrain.level_errors().last(), Some(&0));
            terrain.patch_errors(0, 0, &mut Scratch::new()).unwrap();
        }
    }
}

#[test]
fn every_point_of_a_patch_can_be_listed() {
    let n = 8;
    let height = |x: u16, y: u16| i32::from(x) * 1000 - i32::from(y) * i32::from(y);
    let all = (0..=256).flat_map(|y| {
        (0..=256).map(move |x| HeightOverride { x, y, mode: Mode::Fixed, height: height(x, y) })
    });
    let mut terrain = Terrain::new(parameters(5, n)).unwrap();
    terrain.set_points(-7, 900, HeightOverrides::new(n, all.collect()).unwrap()).unwrap();
    let heights = terrain.patch(-7, 900, n).unwrap();
    let at = |i: usize| height((i % 257) as u16, (i / 257) as u16);
    assert!(heights.iter().enumerate().all(|(i, &h)| h == at(i)));
    assert!(terrain.points_bytes() < 257 * 257 * 40, "{} bytes", terrain.points_bytes());
}
