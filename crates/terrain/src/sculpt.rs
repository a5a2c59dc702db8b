//! Application of stamps to heights: at each point a function of its position and height only, so levels and
//! neighbours agree.
//!
//! Integers, except for one square root, which IEEE 754 rounds correctly.

use super::mode::Mode;
use super::numbers::{index, real, saturate, truncated};
use super::rect::Rect;
use super::stamp::{Position, Shape, Stamp};

/// 1.0 in fixed point, for weights and relative distances.
const ONE: i64 = 1 << 16;

impl Stamp {
    /// The rectangle of finest points outside of which nothing changes: first and last column, first and last row.
    pub(super) fn footprint(&self) -> ([i64; 2], [i64; 2]) {
        let (line, reach) = (self.line(), self.reach());
        let span = |axis: usize| {
            let (low, high) = line.iter().fold((i64::MAX, i64::MIN), |(low, high), position| {
                (low.min(position[axis]), high.max(position[axis]))
            });
            [low - reach, high + reach]
        };
        (span(0), span(1))
    }

    /// Applies the stamp to the heights of `rect`, whose points are 2^`shift` finest grid units apart.
    pub(super) fn apply(&self, base: i32, rect: Rect, shift: u32, heights: &mut [i32]) {
        let ([left, right], [top, bottom]) = self.footprint();
        // The points of the rectangle inside the footprint.
        let first = |edge: i64, from: i64| ((edge + (1 << shift) - 1) >> shift).max(from);
        let (x0, x1) = (first(left, rect.x), (right >> shift).min(rect.right()));
        let (y0, y1) = (first(top, rect.y), (bottom >> shift).min(rect.bottom()));
        if x0 > x1 || y0 > y1 {
            return;
        }
        let reach = self.reach();
        let near = [[x0, y0], [x1, y1]].map(|at| at.map(|x| x << shift));
        let segments = Segments::new(self.line(), near, reach);
        for y in y0..=y1 {
            let row = &mut heights[rect.index_of(rect.x, y)..][..rect.width];
            for x in x0..=x1 {
                let distance = segments.distance([x << shift, y << shift], reach);
                if let Some((weight, target)) = distance.and_then(|d| self.effect(d)) {
                    let height = &mut row[index(x - rect.x)];
                    let from = i64::from(*height);
                    let changed = match self.mode {
                        Mode::Additive => from + ((target * weight) >> 16),
                        Mode::Fixed => from + (((i64::from(base) + target - from) * weight) >> 16),
                    };
                    *height = saturate(changed);
                }
            }
        }
    }

    /// Weight (in units of [`ONE`]) and height at a distance from the line, in 16ths of a grid unit; `None` outside.
    fn effect(&self, distance: i64) -> Option<(i64, i64)> {
        let part = |of: u32| (distance << 12) / i64::from(of);
        let inside = |from_edge: i64| (from_edge > 0).then_some(from_edge.min(ONE));
        match self.shape {
            Shape::Ridge { half_width, height, .. } => {
                let rest = inside(ONE - part(half_width))?;
                Some(((rest * rest) >> 16, i64::from(height)))
            }
            Shape::Valley { half_width, depth, .. } => {
                Some((smooth(inside(ONE - part(half_width))?), -i64::from(depth)))
            }
            Shape::RiverBed { half_width, depth, .. } => {
                Some((smooth(inside(2 * (ONE - part(half_width)))?), -i64::from(depth)))
            }
            Shape::Plateau { radius, falloff, height, .. } => {
                let beyond = distance - (i64::from(radius) << 4);
                if beyond <= 0 {
                    return Some((ONE, i64::from(height)));
                }
                let rest = inside(ONE - (beyond << 12) / i64::from(falloff.max(1)))?;
                Some((smooth(rest), i64::from(height)))
            }
            Shape::Crater { radius, depth, rim, .. } => {
                let t = part(radius);
                let (depth, rim) = (i64::from(depth), i64::from(rim));
                if t <= ONE {
                    return Some((ONE, (((depth + rim) * ((t * t) >> 16)) >> 16) - depth));
                }
                Some((smooth(inside(2 * ONE - t)?), rim))
            }
        }
    }
}

/// Smoothstep 3t² − 2t³ for t in units of [`ONE`].
fn smooth(t: i64) -> i64 {
    (((t * t) >> 16) * (3 * ONE - 2 * t)) >> 16
}

/// A polyline, or a single position.
struct Segments {
    single: Option<Position>,
    segments: Vec<Segment>,
}

struct Segment {
    from: Position,
    to: Position,
    /// Length of the segment, in 256ths.
    length: i64,
}

impl Segments {
    /// The segments of a line within `reach` of a rectangle, given by its corners.
    fn new(line: Vec<Position>, [low, high]: [Position; 2], reach: i64) -> Self {
        let near = |pair: &&[Position]| {
            (0..2).all(|i| {
                pair[0][i].min(pair[1][i]) - reach <= high[i] && pair[0][i].max(pair[1][i]) + reach >= low[i]
            })
        };
        let segment = |pair: &[Position]| {
            let squared = square(pair[0], pair[1]);
            // At most 2 × 2^44 × 2^16.
            Segment {
                from: pair[0],
                to: pair[1],
                length: (squared.cast_unsigned() << 16).isqrt().cast_signed(),
            }
        };
        Self {
            single: (line.len() == 1).then(|| line[0]),
            segments: line.windows(2).filter(near).map(segment).collect(),
        }
    }

    /// Distance of a position, in 16ths of a grid unit; `None` from `reach` on.
    fn distance(&self, at: Position, reach: i64) -> Option<i64> {
        if let Some(single) = self.single {
            return root(square(single, at), reach);
        }
        self.segments.iter().filter_map(|segment| segment.distance(at, reach)).min()
    }
}

impl Segment {
    fn distance(&self, at: Position, reach: i64) -> Option<i64> {
        let low = |axis: usize| self.from[axis].min(self.to[axis]) - reach;
        let high = |axis: usize| self.from[axis].max(self.to[axis]) + reach;
        if (0..2).any(|axis| at[axis] < low(axis) || at[axis] > high(axis)) {
            return None;
        }
        let [dx, dy] = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let [px, py] = [at[0] - self.from[0], at[1] - self.from[1]];
        let along = px * dx + py * dy;
        if along <= 0 {
            return root(square(self.from, at), reach);
        }
        if along >= dx * dx + dy * dy {
            return root(square(self.to, at), reach);
        }
        // Twice the triangle's area over its base: at most 2^48 × 2^12.
        let distance = ((px * dy - py * dx).abs() << 12) / self.length;
        (distance < reach << 4).then_some(distance)
    }
}

fn square(a: Position, b: Position) -> i64 {
    let [dx, dy] = [a[0] - b[0], a[1] - b[1]];
    dx * dx + dy * dy
}

/// Square root in 16ths, rounded down; `None` from `reach` ≤ 2^21 on.
fn root(squared: i64, reach: i64) -> Option<i64> {
    // Below 2^50, where the correctly rounded root has the right integer part.
    (squared < reach * reach).then(|| truncated(real(squared << 8).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heights(stamp: &Stamp, base: i32, start: i32) -> Vec<i32> {
        let mut heights = vec![start; 65 * 65];
        stamp.apply(base, Rect::new(-32, -32, 65, 65), 0, &mut heights);
        heights
    }

    fn at(heights: &[i32], x: i32, y: i32) -> i32 {
        heights[((y + 32) * 65 + x + 32) as usize]
    }

    #[test]
    fn a_valley_is_as_deep_as_it_says_and_ends_where_it_says() {
        let shape = Shape::Valley { from: [-10, 0], to: [10, 0], half_width: 8, depth: 1000 };
        let valley = heights(&Stamp { mode: Mode::Additive, shape: shape.clone() }, 7, 50);
        assert_eq!((at(&valley, 0, 0), at(&valley, -10, 0)), (-950, -950));
        assert_eq!((at(&valley, 0, 4), at(&valley, 0, -4)), (-450, -450), "half way, half as deep");
        assert_eq!((at(&valley, 0, 8), at(&valley, 18, 0), at(&valley, 16, 6)), (50, 50, 50));
        assert!(at(&valley, 17, 0) < 50);
        let fixed = heights(&Stamp { mode: Mode::Fixed, shape }, 7, 50);
        assert_eq!((at(&fixed, 0, 0), at(&fixed, 0, 8)), (7 - 1000, 50));
    }

    #[test]
    fn a_slanted_line_is_as_wide_as_a_straight_one() {
        let shape = Shape::RiverBed { line: vec![[-30, -40], [30, 40]], half_width: 10, depth: 100 };
        let bed = heights(&Stamp { mode: Mode::Additive, shape }, 0, 0);
        // (8, -6) is 10 from the line, (4, -3) is 5: on the flat.
        assert_eq!((at(&bed, 0, 0), at(&bed, 4, -3), at(&bed, 8, -6)), (-100, -100, 0));
        // 7.8 from the line: 3t² − 2t³ of 0.44, to a 16th of a grid unit.
        assert!((-44..=-40).contains(&at(&bed, 6, -5)), "{}", at(&bed, 6, -5));
    }

    #[test]
    fn a_crater_has_a_bowl_and_a_rim_and_a_plateau_is_level() {
        let shape = Shape::Crater { centre: [1, 2], radius: 10, depth: 300, rim: 100 };
        let crater = heights(&Stamp { mode: Mode::Additive, shape }, 0, 0);
        assert_eq!((at(&crater, 1, 2), at(&crater, 11, 2), at(&crater, 1, 22)), (-300, 100, 0));
        assert_eq!(at(&crater, 1, 17), 50, "half way down the outer slope");
        let shape = Shape::Plateau { centre: [0, 0], radius: 10, falloff: 10, height: 70 };
        let plateau = heights(&Stamp { mode: Mode::Fixed, shape }, 5, -900);
        assert_eq!((at(&plateau, 0, 0), at(&plateau, 6, 8), at(&plateau, 20, 0)), (75, 75, -900));
    }

    #[test]
    fn a_ridge_stands_up_and_levels_see_the_same() {
        let shape = Shape::Ridge { from: [-7, 3], to: [20, -9], half_width: 12, height: 500 };
        let stamp = Stamp { mode: Mode::Additive, shape };
        let fine = heights(&stamp, 0, 0);
        assert_eq!(at(&fine, -7, 3), 500);
        let mut coarse = vec![0; 17 * 17];
        stamp.apply(0, Rect::new(-8, -8, 17, 17), 2, &mut coarse);
        for (i, &height) in coarse.iter().enumerate() {
            assert_eq!(height, at(&fine, (i as i32 % 17 - 8) * 4, (i as i32 / 17 - 8) * 4));
        }
    }

    #[test]
    fn heights_at_the_limits_saturate() {
        for (mode, height) in [(Mode::Additive, i32::MAX), (Mode::Fixed, i32::MAX), (Mode::Fixed, i32::MIN)] {
            let shape = Shape::Plateau { centre: [0, 0], radius: 10, falloff: 0, height };
            let plateau = heights(&Stamp { mode, shape }, 1 << 28, 1 << 28);
            let expected = if height < 0 { i32::MIN + (1 << 28) } else { i32::MAX };
            assert_eq!((at(&plateau, 0, 0), at(&plateau, 11, 0)), (expected, 1 << 28));
        }
        let shape = Shape::Crater { centre: [0, 0], radius: 9, depth: i32::MIN, rim: i32::MAX };
        heights(&Stamp { mode: Mode::Additive, shape }, 0, 0);
    }
}
