//! Windows, patches, neighbours and levels agree with each other, with features and erosion.

use super::{any_terrain, window};
use proptest::prelude::*;

proptest! {
    #[test]
    fn a_window_is_the_part_of_a_larger_one(
        terrain in any_terrain(), coarser in 0i8..9,
        x in -40i64..20, y in -40i64..20, width in 1usize..40, height in 1usize..40,
        left in 0usize..20, top in 0usize..20, right in 0usize..20, bottom in 0usize..20,
    ) {
        let level = (terrain.finest_level() - coarser).max(-2);
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
    fn neighbours_agree_on_their_border(terrain in any_terrain(), x in -4i64..4, y in -4i64..4) {
        for level in 0..=terrain.finest_level() as u8 {
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
    fn a_level_is_a_subset_of_the_next(terrain in any_terrain(), x in -4i64..4, y in -4i64..4) {
        for level in 0..terrain.finest_level() as u8 {
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
    fn levels_below_0_are_corners(terrain in any_terrain(), x in -1i64..1, y in -1i64..1, sparse in 1i8..4) {
        let (width, height) = (4, 3);
        let corners = window(&terrain, -sparse, x, y, width, height);
        for (i, &corner) in corners.iter().enumerate() {
            let at = (x + (i % width) as i64, y + (i / width) as i64);
            prop_assert_eq!(window(&terrain, 0, at.0 << sparse, at.1 << sparse, 1, 1), [corner]);
        }
    }

    #[test]
    fn a_point_alone_has_the_height_it_has_in_its_patch(terrain in any_terrain(), x in -2i64..2, y in -2i64..2) {
        let n = terrain.finest_level() as u8;
        let patch = terrain.patch(x, y, n).unwrap();
        let side = (1 << n) + 1;
        let mut scratch = Default::default();
        for i in [0, 1, side, side + 1, side * side / 2, side * side - 2, side * side - 1] {
            let at = ((x << n) + (i % side) as i64, (y << n) + (i / side) as i64);
            prop_assert_eq!(terrain.height_at(at.0, at.1, &mut scratch).unwrap(), patch[i]);
        }
    }
}
