//! Ink: stroke extraction, coverage, blur and quantised light: `ink_contour.wgsl`, `ink_strokes.wgsl`, `ink.wgsl`.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

/// Least height of a triangle over its edge, in lengths of the edge.
const LEAST_HEIGHT: f64 = 1e-6;
/// Most of its higher triangle's height that a crease takes.
const CREASE_SHARE: f64 = 1.0 / 3.0;
/// By how much a stroke's depth may lie behind what is there.
const BIAS: f64 = 0.002;
/// Pixels that a cell of noise is wide, up to twice.
const CELL_PX: f64 = 2.0;
/// The number of cells of size 1.
const OCTAVE_0: f64 = 32.0;

/// The edges of a mesh by places of their ends, each with the third corners of its triangles. Triangles that have a corner
/// twice have none.
#[must_use]
pub fn edges(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<([DVec3; 2], Vec<DVec3>)> {
    // By value: −0 is 0.
    let place = |slot: u32| positions.get(slot as usize).map(|p| p.map(|x| (x + 0.0).to_bits()));
    let point = |p: [u32; 3]| DVec3::from(p.map(|bits| f64::from(f32::from_bits(bits))));
    let mut found: BTreeMap<[[u32; 3]; 2], Vec<DVec3>> = BTreeMap::new();
    for face in faces {
        let [Some(a), Some(b), Some(c)] = face.map(place) else { continue };
        if a == b || b == c || c == a {
            continue;
        }
        for [from, to, third] in [[a, b, c], [b, c, a], [c, a, b]] {
            found.entry([from.min(to), from.max(to)]).or_default().push(point(third));
        }
    }
    found.into_iter().map(|(ends, thirds)| (ends.map(point), thirds)).collect()
}

/// Kind of stroke.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Contours and borders.
    Contour,
    /// Crease: visible anywhere, but no wider than a share of its triangles' projected height.
    Crease,
}

/// The kind of stroke of an edge seen from the origin, if any: a contour, if all its triangles lie on one side of the
/// plane through eye and edge; or a crease.
#[must_use]
pub fn kind([a, b]: [DVec3; 2], thirds: &[DVec3], crease_cosine: f64) -> Option<Kind> {
    let along = b - a;
    let normals: Vec<DVec3> = thirds.iter().map(|third| along.cross(*third - a)).collect();
    let sides = normals.iter().map(|normal| {
        let is_flat = normal.length() > LEAST_HEIGHT * along.length_squared();
        if is_flat { a.dot(*normal).partial_cmp(&0.0).map_or(0, |side| side as i32) } else { 0 }
    });
    let sides: Vec<i32> = sides.collect();
    let first = sides.first()?;
    let is_contour = *first != 0 && sides.iter().all(|side| side == first);
    let is_crease = normals.iter().skip(1).any(|other| {
        let sizes = normals[0].length() * other.length();
        let turned = normals[0].dot(*other);
        let on = if thirds.len() > 2 { turned.abs() } else { -turned };
        sizes > 0.0 && on < crease_cosine * sizes
    });
    is_contour.then_some(Kind::Contour).or(is_crease.then_some(Kind::Crease))
}

/// A stroke on the screen: pixel and stored depth of its ends.
#[derive(Clone, Copy, Debug)]
pub struct Stroke {
    /// One end.
    pub start: DVec3,
    /// The other.
    pub end: DVec3,
    /// Half its width, in pixels.
    pub half_width: f64,
}

impl Stroke {
    /// Projects a stroke of a kind and width, from the ends of its edge and the third corners of its triangles.
    #[must_use]
    pub fn new(kind: Kind, [start, end]: [DVec3; 2], thirds: &[DVec3], half_width: f64) -> Self {
        let along = (end - start).truncate();
        let height = |third: &DVec3| along.perp_dot((*third - start).truncate()).abs() / along.length();
        let room = match kind {
            Kind::Contour => f64::INFINITY,
            Kind::Crease => 0.5 * CREASE_SHARE * thirds.iter().map(height).fold(0.0, f64::max),
        };
        Self { start, end, half_width: half_width.min(room) }
    }

    /// The point of its spine that is nearest to a point of the picture, with its depth.
    #[must_use]
    pub fn spine(&self, at: DVec2) -> DVec3 {
        let (start, way) = (self.start.truncate(), (self.end - self.start).truncate());
        let share = (at - start).dot(way) / way.length_squared().max(1e-12);
        self.start.lerp(self.end, share.clamp(0.0, 1.0))
    }

    /// Coverage of the pixel centred at `at` by the stroke, visible or not.
    #[must_use]
    pub fn covers(&self, at: DVec2) -> f64 {
        let most = (2.0 * self.half_width).min(1.0);
        (self.half_width + 0.5 - at.distance(self.spine(at).truncate())).clamp(0.0, most)
    }
}

/// Whether a point of the spine is visible, given the depth buffer.
#[must_use]
pub fn is_seen(spine: DVec3, depths: &[f32], [width, height]: [u32; 2]) -> bool {
    let clamp = |x: i64, side: u32| x.clamp(0, i64::from(side) - 1) as usize;
    let around = (-1..=1).flat_map(|y| (-1..=1).map(move |x| (x, y)));
    let stored = around.map(|(x, y)| {
        let (column, row) = (spine.x.floor() as i64 + x, spine.y.floor() as i64 + y);
        f64::from(depths[clamp(row, height) * width as usize + clamp(column, width)])
    });
    spine.z >= stored.fold(1.0, f64::min) * (1.0 - BIAS)
}

/// A pixel of a picture of strokes, blurred over so many to each side by a row of Pascal's triangle.
#[must_use]
pub fn blurred(strokes: &[f64], [width, height]: [u32; 2], [x, y]: [u32; 2], blur: u32) -> f64 {
    let row = (0..2 * blur).fold(vec![1.0], |row: Vec<f64>, _| {
        let shifted = [0.0].into_iter().chain(row.iter().copied());
        let own = row.iter().copied().chain([0.0]);
        own.zip(shifted).map(|(a, b)| 0.5 * (a + b)).collect()
    });
    let clamp = |at: u32, i: usize, side: u32| {
        (i64::from(at) + i as i64 - i64::from(blur)).clamp(0, i64::from(side) - 1) as usize
    };
    let mut sum = 0.0;
    for (j, down) in row.iter().enumerate() {
        for (i, across) in row.iter().enumerate() {
            sum += down * across * strokes[clamp(y, j, height) * width as usize + clamp(x, i, width)];
        }
    }
    sum
}

/// The finaliser of MurmurHash3 (Appleby 2011).
fn scrambled(word: u32) -> u32 {
    let x = (word ^ (word >> 16)).wrapping_mul(0x85eb_ca6b);
    let x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

/// Value noise in cells of 2^(octave − 32) world units, 0 to 1.
fn noise_in(octave: u32, world: DVec3) -> f64 {
    let at = world / (f64::from(octave) - OCTAVE_0).exp2();
    let (low, way) = (at.floor(), at - at.floor());
    let t = way * way * (3.0 - 2.0 * way);
    let corner = |k: u32| {
        let c = [0, 1, 2].map(|i| (low[i] + f64::from(k >> i & 1)).rem_euclid(256.0) as u32);
        f64::from(scrambled(c[0] | c[1] << 8 | c[2] << 16 | octave << 24) >> 8) / 16_777_216.0
    };
    let share = |k: u32| (0..3).map(|i| if k >> i & 1 == 1 { t[i] } else { 1.0 - t[i] }).product::<f64>();
    (0..8).map(|k| share(k) * corner(k)).sum()
}

/// Noise at a place of the world that is seen at a depth, 0 to 1. `scale_px`: pixels per world unit at depth 1.
#[must_use]
pub fn noise(world: DVec3, depth: f64, scale_px: f64) -> f64 {
    let wanted = ((CELL_PX * depth / scale_px).log2() + OCTAVE_0).clamp(0.0, 62.0);
    let octave = wanted.floor() as u32;
    let (low, high) = (noise_in(octave, world), noise_in(octave + 1, world));
    low + (high - low) * (wanted - wanted.floor())
}

/// Quantised light in `levels` levels, with borders moved by noise.
#[must_use]
pub fn level_of(light: f64, levels: u32, spatter: f64, noise: f64) -> f64 {
    let levels = f64::from(levels);
    let share = light / (1.0 + light);
    let level = (share * levels + (noise - 0.5) * spatter).floor().clamp(0.0, levels - 1.0);
    let middle = (level + 0.5) / levels;
    middle / (1.0 - middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_is_a_contour_where_both_sides_lie_the_same_way() {
        let edge = [DVec3::new(-1.0, 0.0, -5.0), DVec3::new(1.0, 0.0, -5.0)];
        let (up, down, behind) =
            (DVec3::new(0.0, 1.0, -5.0), DVec3::new(0.0, -1.0, -5.0), DVec3::new(0.0, 0.5, -7.0));
        let is = |thirds: &[DVec3]| kind(edge, thirds, -2.0) == Some(Kind::Contour);
        assert!(!is(&[up, down]) && !is(&[down, up]) && !is(&[behind, down]));
        assert!(is(&[up, behind]) && is(&[up]) && is(&[up, behind, up]));
        assert!(!is(&[up, behind, down]) && !is(&[]));
        // Triangles without area, and seen edge-on.
        assert!(!is(&[DVec3::new(0.3, 0.0, -5.0)]) && !is(&[DVec3::new(0.0, 0.0, -9.0)]));
    }

    #[test]
    fn a_crease_begins_at_its_angle() {
        let edge = [DVec3::new(-1.0, 0.0, -5.0), DVec3::new(1.0, 0.0, -5.0)];
        for turned in [0.0, 20.0, 39.0, 41.0, 90.0, 170.0_f64] {
            let (sin, cos) = turned.to_radians().sin_cos();
            let thirds = [DVec3::new(0.0, -1.0, -5.0), DVec3::new(0.0, cos, -5.0 - sin)];
            let is = kind(edge, &thirds, 40.0_f64.to_radians().cos());
            assert_eq!(is.is_some(), turned > 40.0, "{turned}");
        }
    }

    #[test]
    fn levels_are_even_and_light_in_the_middle_of_one_stays() {
        for levels in 2..=16 {
            for level in 0..levels {
                let middle = (f64::from(level) + 0.5) / f64::from(levels);
                let light = middle / (1.0 - middle);
                assert!((level_of(light, levels, 0.9, 0.1) / light - 1.0).abs() < 1e-12);
            }
            assert!(level_of(f64::from(u32::MAX), levels, 1.0, 1.0).is_finite());
        }
        let borders: Vec<f64> = (0..1000).map(|i| level_of(f64::from(i) * 0.01, 4, 0.0, 0.5)).collect();
        assert!(borders.is_sorted());
    }

    #[test]
    fn noise_is_even_about_its_middle_and_has_no_steps() {
        let (mut sum, mut most, mut n) = (0.0, 0.0_f64, 0);
        for i in 0..4000 {
            let way =
                |i: i32| DVec3::new(f64::from(i) * 0.013, 3.0 - f64::from(i) * 0.007, f64::from(i % 97));
            let at = |i| noise(way(i), 40.0 * (1.0 + f64::from(i) * 1e-3), 200.0);
            sum += at(i);
            n += 1;
            let near = noise(way(i) + DVec3::splat(1e-4), 40.0 * (1.0 + f64::from(i) * 1e-3), 200.0);
            most = most.max((near - at(i)).abs());
        }
        assert!((sum / f64::from(n) - 0.5).abs() < 0.02, "{}", sum / f64::from(n));
        assert!(most < 2e-3, "{most}");
    }

    #[test]
    fn blur_keeps_what_there_is() {
        let size = [9, 7];
        for blur in 0..=3 {
            let mut one = vec![0.0; 63];
            one[3 * 9 + 4] = 1.0;
            let sum: f64 = (0..7)
                .flat_map(|y| (0..9).map(move |x| [x, y]))
                .map(|at| blurred(&one, size, at, blur))
                .sum();
            assert!((sum - 1.0).abs() < 1e-12, "{blur}: {sum}");
            assert!((blurred(&[0.7; 63], size, [0, 6], blur) - 0.7).abs() < 1e-12);
        }
    }
}
