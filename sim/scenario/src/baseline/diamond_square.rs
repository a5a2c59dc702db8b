//! Diamond-square terrain (Fournier, Fussell and Carpenter 1982) in f32 and in place, as a reference for generation
//! times. It has no features, its borders do not match neighbours, its heights depend on the order of points, and its
//! random numbers come from a sequential generator.

use lodestream_geometry::random::Random;

/// Range of the first offsets; halved in each step.
const RANGE: f32 = 65_536.0;

/// Replaces `heights` by (2^level + 1)² new ones, row by row; each step computes centres, then edges.
pub fn diamond_square(level: u8, random: &mut Random, heights: &mut Vec<f32>) {
    let side = (1_usize << level) + 1;
    heights.clear();
    heights.resize(side * side, 0.0);
    let mut range = RANGE;
    let mut offset = |range: f32| ((random.next_u64() >> 40) as f32 * (2.0 / (1 << 24) as f32) - 1.0) * range;
    for corner in [0, side - 1, side * (side - 1), side * side - 1] {
        heights[corner] = offset(range);
    }
    let mut step = side - 1;
    while step > 1 {
        let half = step / 2;
        range *= 0.5;
        for y in (half..side).step_by(step) {
            for x in (half..side).step_by(step) {
                let at = |x: usize, y: usize| heights[y * side + x];
                let sum = at(x - half, y - half)
                    + at(x + half, y - half)
                    + at(x - half, y + half)
                    + at(x + half, y + half);
                heights[y * side + x] = sum * 0.25 + offset(range);
            }
        }
        for y in (0..side).step_by(half) {
            let first = if (y / half).is_multiple_of(2) { half } else { 0 };
            for x in (first..side).step_by(step) {
                let at = y * side + x;
                heights[at] = offset(range)
                    + if x == 0 || y == 0 || x == side - 1 || y == side - 1 {
                        let beside = [(x >= half, at.wrapping_sub(half)), (x + half < side, at + half)];
                        let beyond =
                            [(y >= half, at.wrapping_sub(half * side)), (y + half < side, at + half * side)];
                        let inside = beside.into_iter().chain(beyond).filter(|n| n.0);
                        inside.map(|n| heights[n.1]).sum::<f32>() / 3.0
                    } else {
                        let sum = heights[at - half]
                            + heights[at + half]
                            + heights[at - half * side]
                            + heights[at + half * side];
                        sum * 0.25
                    };
            }
        }
        step = half;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each point is the mean of its neighbours plus an offset within its step's range.
    #[test]
    fn a_point_is_near_the_mean_of_its_neighbours() {
        let mut heights = Vec::new();
        diamond_square(5, &mut Random::new(3), &mut heights);
        assert_eq!(heights.len(), 33 * 33);
        let at = |x: usize, y: usize| heights[y * 33 + x];
        let range = RANGE / 32.0;
        let mut moved = 0;
        for y in (1..33).step_by(2) {
            for x in (1..33).step_by(2) {
                let mean = (at(x - 1, y - 1) + at(x + 1, y - 1) + at(x - 1, y + 1) + at(x + 1, y + 1)) / 4.0;
                assert!((at(x, y) - mean).abs() <= range * 1.001, "{x}, {y}");
                moved += usize::from((at(x, y) - mean).abs() > range / 100.0);
            }
        }
        assert!(moved > 200, "{moved} of 256");
        // An edge on the border has three neighbours.
        let mean = (at(0, 0) + at(2, 0) + at(1, 1)) / 3.0;
        assert!((at(1, 0) - mean).abs() <= range * 1.001);
    }
}
