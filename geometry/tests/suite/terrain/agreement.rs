//! Windows, patches, neighbours and levels agree with each other.

use super::{parameters, window};
use lodestream_geometry::terrain::{Distribution, Terrain};
use proptest::prelude::*;

fn terrain(seed: u64, finest_level: u8, gaussian: bool) -> Terrain {
    let distribution = if gaussian { Distribution::Gaussian } else { Distribution::Uniform };
    Terrain::new(lodestream_geometry::terrain::Parameters { distribution, ..parameters(seed, finest_level) })
        .unwrap()
}

proptest! {
    #[test]
    fn a_window_is_the_part_of_a_larger_one(
        seed: u64, n in 1u8..8, coarser in 0i8..12, gaussian: bool,
        x in -40i64..20, y in -40i64..20, width in 1usize..40, height in 1usize..40,
        left in 0usize..20, top in 0usize..20, right in 0usize..20, bottom in 0usize..20,
    ) {
        let terrain = terrain(seed, n, gaussian);
        let level = (n as i8 - coarser).max(-2);
        let whole = (width + left + right, height + top + bottom);
        let large = window(&terrain, level, x - left as i64, y - top as i64, whole.0, whole.1);
        let part: Vec<i32> = large
            .chunks(whole.0)
            .skip(top)
            .take(height)
            .flat_map(|row| &row[left..left + width])
            .copied()
            .collect();
        prop_assert_eq!(window(&terrain, level, x, y, width, height), part);
    }

    #[test]
    fn neighbours_agree_on_their_border(seed: u64, n in 1u8..8, x in -256i64..255, y in -256i64..255, gaussian: bool) {
        let terrain = terrain(seed, n, gaussian);
        for level in 0..=n {
            let side = (1 << level) + 1;
            let patch = terrain.patch(x, y, level).unwrap();
            let right = terrain.patch(x + 1, y, level).unwrap();
            let below = terrain.patch(x, y + 1, level).unwrap();
            for i in 0..side {
                prop_assert_eq!(patch[i * side + side - 1], right[i * side]);
                prop_assert_eq!(patch[(side - 1) * side + i], below[i]);
            }
        }
    }

    #[test]
    fn a_level_is_a_subset_of_the_next(seed: u64, n in 1u8..8, x in -256i64..255, y in -256i64..255, gaussian: bool) {
        let terrain = terrain(seed, n, gaussian);
        for level in 0..n {
            let (coarse, fine) = (terrain.patch(x, y, level).unwrap(), terrain.patch(x, y, level + 1).unwrap());
            let (side, fine_side) = ((1 << level) + 1, (2 << level) + 1);
            for row in 0..side {
                for column in 0..side {
                    prop_assert_eq!(coarse[row * side + column], fine[2 * row * fine_side + 2 * column]);
                }
            }
        }
    }

    #[test]
    fn levels_below_0_are_corners(seed: u64, n in 1u8..8, x in -16i64..10, y in -16i64..10) {
        let terrain = terrain(seed, n, false);
        let sparse = window(&terrain, -3, x, y, 7, 5);
        for (i, &height) in sparse.iter().enumerate() {
            let (px, py) = ((x + i as i64 % 7) * 8, (y + i as i64 / 7) * 8);
            prop_assert_eq!(window(&terrain, 0, px, py, 1, 1), [height]);
        }
    }
}
