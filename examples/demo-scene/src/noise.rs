//! Lattice noise from an integer hash: the same on every machine, no tables, no state.

use super::maths::mix;
use glam::DVec3;

/// Mixes a seed and a lattice point (finaliser of SplitMix64; Steele, Lea & Flood, 2014).
pub(super) fn hash(seed: u64, x: i64, y: i64, z: i64) -> u64 {
    let mut h = seed ^ 0x9E37_79B9_7F4A_7C15;
    for v in [x, y, z] {
        h = (h ^ v as u64).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        h ^= h >> 29;
    }
    h = (h ^ (h >> 30)).wrapping_mul(0x94D0_49BB_1331_11EB);
    h ^ (h >> 31)
}

/// Uniform in 0..1, from the hash of a lattice point.
pub(super) fn uniform(seed: u64, x: i64, y: i64, z: i64) -> f64 {
    (hash(seed, x, y, z) >> 11) as f64 / (1u64 << 53) as f64
}

/// Quintic fade (Perlin, "Improving noise", 2002): continuous curvature across lattice cells.
fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Smooth value noise in −1..1 with unit feature size.
pub(super) fn value3(seed: u64, p: DVec3) -> f64 {
    let f = p.floor();
    let (x, y, z) = (f.x as i64, f.y as i64, f.z as i64);
    let (u, v, w) = (fade(p.x - f.x), fade(p.y - f.y), fade(p.z - f.z));
    let at = |dx, dy, dz| uniform(seed, x + dx, y + dy, z + dz);
    let near = mix(mix(at(0, 0, 0), at(1, 0, 0), u), mix(at(0, 1, 0), at(1, 1, 0), u), v);
    let far = mix(mix(at(0, 0, 1), at(1, 0, 1), u), mix(at(0, 1, 1), at(1, 1, 1), u), v);
    mix(near, far, w) * 2.0 - 1.0
}

/// Fractal sum of [`value3`]: each octave half as large and half as high.
pub(super) fn fractal3(seed: u64, p: DVec3, octaves: u32) -> f64 {
    let (mut sum, mut amplitude, mut q) = (0.0, 0.5, p);
    for octave in 0..octaves {
        sum += amplitude * value3(seed.wrapping_add(u64::from(octave)), q);
        amplitude *= 0.5;
        q = q * 2.03 + DVec3::splat(7.3);
    }
    sum
}

/// Noise with sharp crests at 1 and broad valleys (Musgrave's ridged noise, one octave).
pub(super) fn ridged3(seed: u64, p: DVec3) -> f64 {
    1.0 - 2.0 * value3(seed, p).abs()
}

/// Value noise on the plane that repeats every `period` cells; in −1..1.
pub(super) fn value2_periodic(seed: u64, x: f64, y: f64, period: i64) -> f64 {
    let (fx, fy) = (x.floor(), y.floor());
    let (ix, iy) = (fx as i64, fy as i64);
    let (u, v) = (fade(x - fx), fade(y - fy));
    let at = |dx: i64, dy: i64| uniform(seed, (ix + dx).rem_euclid(period), (iy + dy).rem_euclid(period), 0);
    mix(mix(at(0, 0), at(1, 0), u), mix(at(0, 1), at(1, 1), u), v) * 2.0 - 1.0
}

/// Fractal sum over the unit square that tiles: `cells` cells in the first octave.
pub(super) fn fractal2_tiling(seed: u64, u: f64, v: f64, cells: i64, octaves: u32) -> f64 {
    let (mut sum, mut amplitude, mut period) = (0.0, 0.5, cells);
    for octave in 0..octaves {
        let scale = period as f64;
        sum +=
            amplitude * value2_periodic(seed.wrapping_add(u64::from(octave)), u * scale, v * scale, period);
        amplitude *= 0.5;
        period *= 2;
    }
    sum
}

/// Result of [`cells2_tiling`].
pub(super) struct Cell {
    /// Distance to the nearest feature point, in cells.
    pub(super) nearest: f64,
    /// Distance to the second nearest, in cells.
    pub(super) second: f64,
    /// Hash of the nearest feature point.
    pub(super) id: u64,
}

/// Cellular noise (Worley, 1996) that tiles the unit square, with `cells` feature points per side. `jitter` is how far
/// a feature point may be from its cell's middle: 0 for a lattice, 1 for anywhere in the cell.
pub(super) fn cells2_tiling(seed: u64, u: f64, v: f64, cells: i64, jitter: f64) -> Cell {
    let (x, y) = (u * cells as f64, v * cells as f64);
    let (ix, iy) = (x.floor() as i64, y.floor() as i64);
    let mut found = Cell { nearest: f64::MAX, second: f64::MAX, id: 0 };
    for dy in -2..=2 {
        for dx in -2..=2 {
            let (cx, cy) = (ix + dx, iy + dy);
            let (wx, wy) = (cx.rem_euclid(cells), cy.rem_euclid(cells));
            let px = cx as f64 + 0.5 + jitter * (uniform(seed, wx, wy, 1) - 0.5);
            let py = cy as f64 + 0.5 + jitter * (uniform(seed, wx, wy, 2) - 0.5);
            let distance = ((px - x) * (px - x) + (py - y) * (py - y)).sqrt();
            if distance < found.nearest {
                found.second = found.nearest;
                found.nearest = distance;
                found.id = hash(seed, wx, wy, 3);
            } else if distance < found.second {
                found.second = distance;
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stays_in_range_and_tiles() {
        for i in 0..2000i64 {
            let p = DVec3::new(uniform(1, i, 0, 0), uniform(1, i, 1, 0), uniform(1, i, 2, 0)) * 40.0 - 20.0;
            assert!(value3(5, p).abs() <= 1.0);
            assert!(fractal3(5, p, 4).abs() <= 1.0);
            let (u, v) = (uniform(2, i, 0, 0), uniform(2, i, 1, 0));
            assert!(
                (fractal2_tiling(3, u, v, 4, 3) - fractal2_tiling(3, u + 1.0, v - 1.0, 4, 3)).abs() < 1e-9
            );
            let cell = cells2_tiling(4, u, v, 6, 0.8);
            assert!(cell.nearest <= cell.second);
            assert_eq!(cell.id, cells2_tiling(4, u + 1.0, v, 6, 0.8).id);
        }
    }
}
