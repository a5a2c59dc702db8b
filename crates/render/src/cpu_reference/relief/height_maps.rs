//! Height maps for the comparison of relief methods: each repeats, 0 is deepest, 1 the surface.

use super::ReliefMap;

fn map(size: usize, height: impl Fn(f64, f64) -> f64) -> ReliefMap {
    let at = |i: usize| i as f64 / size as f64;
    let texels = (0..size * size).map(|i| height(at(i % size), at(i / size)).clamp(0.0, 1.0));
    ReliefMap { width: size, height: size, texels: texels.collect() }
}

/// Bricks with sloped joints: two a row, offset by half in every other row.
#[must_use]
pub fn bricks(size: usize) -> ReliefMap {
    let edge = |t: f64, width: f64| (t.min(1.0 - t) / width).clamp(0.0, 1.0);
    map(size, |u, v| {
        let row = (v * 4.0).floor();
        let x = (u * 2.0 + 0.5 * (row % 2.0)).fract();
        edge(x, 0.08).min(edge((v * 4.0).fract(), 0.16))
    })
}

/// Round stones, one in each of 6² cells.
#[must_use]
pub fn cobble(size: usize) -> ReliefMap {
    const CELLS: i64 = 6;
    map(size, |u, v| {
        let (x, y) = (u * CELLS as f64, v * CELLS as f64);
        let (mut nearest, mut next) = (f64::INFINITY, f64::INFINITY);
        for j in -1..=1 {
            for i in -1..=1 {
                let (cx, cy) = (x.floor() as i64 + i, y.floor() as i64 + j);
                let jitter =
                    |salt: u32| 0.7 * (value(cx.rem_euclid(CELLS), cy.rem_euclid(CELLS), salt) - 0.5);
                let (px, py) = (cx as f64 + 0.5 + jitter(1), cy as f64 + 0.5 + jitter(2));
                let far = (px - x).hypot(py - y);
                if far < nearest {
                    (nearest, next) = (far, nearest);
                } else {
                    next = next.min(far);
                }
            }
        }
        // Up from the seam between two, then a dome.
        let seam = ((next - nearest) / 0.25).clamp(0.0, 1.0);
        seam.sqrt() * (1.0 - 0.35 * nearest * nearest)
    })
}

/// Four octaves of value noise.
#[must_use]
pub fn noise(size: usize) -> ReliefMap {
    map(size, |u, v| {
        let octave = |period: i64| {
            let (x, y) = (u * period as f64, v * period as f64);
            let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
            let (fx, fy) = (smooth(x.fract()), smooth(y.fract()));
            let at = |i: i64, j: i64| {
                value((x.floor() as i64 + i).rem_euclid(period), (y.floor() as i64 + j).rem_euclid(period), 7)
            };
            let top = at(0, 0) * (1.0 - fx) + at(1, 0) * fx;
            let bottom = at(0, 1) * (1.0 - fx) + at(1, 1) * fx;
            top * (1.0 - fy) + bottom * fy
        };
        [4, 8, 16, 32].into_iter().map(|period| octave(period) * 2.0 / period as f64).sum::<f64>() / 0.9375
    })
}

/// Letters with upright sides, raised over a plain.
#[must_use]
pub fn lettering(size: usize) -> ReliefMap {
    /// Rows of an R, an E, an L and an F, five wide.
    const ROWS: [[u8; 4]; 7] = [
        [0b11110, 0b11111, 0b10000, 0b11111],
        [0b10001, 0b10000, 0b10000, 0b10000],
        [0b10001, 0b10000, 0b10000, 0b10000],
        [0b11110, 0b11110, 0b10000, 0b11110],
        [0b10100, 0b10000, 0b10000, 0b10000],
        [0b10010, 0b10000, 0b10000, 0b10000],
        [0b10001, 0b11111, 0b11111, 0b10000],
    ];
    map(size, |u, v| {
        let (x, y) = (u * 24.0, v * 18.0);
        // Two lines of letters, each in a box of 6 × 9.
        let (letter, column) = ((x / 6.0) as usize % 4, (x % 6.0) as usize);
        let row = (y % 9.0) as usize;
        let raised = column < 5 && row < 7 && ROWS[row][letter] >> (4 - column) & 1 == 1;
        f64::from(u8::from(raised)) * 0.9 + 0.1
    })
}

/// A number in 0..1 for a place (PCG-like mixing of whole numbers).
fn value(x: i64, y: i64, salt: u32) -> f64 {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b1)
        ^ (y as u32).wrapping_mul(0x85eb_ca77)
        ^ salt.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ h >> 15).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ h >> 12).wrapping_mul(0x297a_2d39);
    f64::from(h ^ h >> 15) / 4_294_967_296.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_fill_their_range_and_repeat() {
        for (name, map) in [
            ("bricks", bricks(96)),
            ("cobble", cobble(96)),
            ("noise", noise(96)),
            ("lettering", lettering(96)),
        ] {
            let least = map.texels.iter().copied().fold(f64::INFINITY, f64::min);
            let most = map.texels.iter().copied().fold(0.0, f64::max);
            assert!(least < 0.25 && most > 0.75 && least >= 0.0 && most <= 1.0, "{name}: {least} to {most}");
            // Heights differ across the seam no more than elsewhere.
            let step = |x: i64| (0..96).map(|y| (map.texel(x, y) - map.texel(x + 1, y)).abs()).sum::<f64>();
            let widest = (0..95).map(step).fold(0.0, f64::max);
            assert!(step(95) <= widest + 1e-9, "{name}: {} and {widest}", step(95));
        }
    }
}
