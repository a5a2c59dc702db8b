//! Fine relief on statues: cloth, hair, scales, weathered stone.

use super::maths::smoothstep;
use super::noise::{fractal3, ridged3, value3};
use glam::DVec3;

/// Kind of a part's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Skin {
    /// The shape without relief.
    Plain,
    /// Polished, with slight unevenness.
    Polished,
    /// Chiselled rock.
    Rock,
    /// Short fur over muscle.
    Fur,
    /// Long locks that hang down.
    Mane,
    /// Hanging cloth: folds that run downwards; the number is their height in metres.
    Cloth(f64),
    /// Thin strands that hang down.
    Strands,
    /// Overlapping scales; `1 / columns` of a turn each.
    Scales {
        /// Scales around the body.
        columns: f64,
        /// Radius of the body there, in metres.
        radius: f64,
    },
}

impl Skin {
    /// Largest absolute value of [`Skin::relief`], in metres.
    pub(super) fn height(self) -> f64 {
        match self {
            Skin::Plain => 0.0,
            Skin::Polished => 0.004,
            Skin::Rock => 0.115,
            Skin::Fur => 0.014,
            Skin::Mane => 0.046,
            Skin::Cloth(height) => height * 1.04,
            Skin::Strands => 0.018,
            Skin::Scales { radius, .. } => 0.14 * radius,
        }
    }

    /// Height above the shape at `p`, in metres. `along` is the position on a body: arc length over radius, and the
    /// angle from the back in turns.
    pub(super) fn relief(self, p: DVec3, along: Option<(f64, f64)>, seed: u64) -> f64 {
        match self {
            Skin::Plain => 0.0,
            Skin::Polished => 0.003 * value3(seed ^ 1, p * 14.0) + 0.001 * value3(seed ^ 2, p * 60.0),
            Skin::Rock => 0.075 * fractal3(seed ^ 3, p * 3.1, 4) + 0.03 * ridged3(seed ^ 4, p * 2.3) - 0.01,
            Skin::Fur => {
                let warp = DVec3::splat(0.35 * value3(seed ^ 5, p * 6.0));
                let stretched = DVec3::new(p.x * 34.0, p.y * 11.0, p.z * 16.0) + warp * 4.0;
                0.007 * value3(seed ^ 6, p * 5.0) + 0.005 * ridged3(seed ^ 7, stretched)
            }
            Skin::Mane => {
                let warp = value3(seed ^ 8, p * 4.0) * 0.16;
                let lock = DVec3::new((p.x + warp) * 10.0, p.y * 4.0 + warp * 5.0, (p.z - warp) * 10.0);
                let strand = DVec3::new((p.x + warp) * 30.0, p.y * 6.0, (p.z - warp) * 30.0);
                0.036 * ridged3(seed ^ 9, lock) + 0.009 * ridged3(seed ^ 10, strand)
            }
            Skin::Cloth(height) => {
                let warp = value3(seed ^ 11, p * 1.7) * 0.12;
                let fold = DVec3::new((p.x + warp) * 7.0, p.y * 0.8, (p.z - warp) * 7.0);
                let crease = DVec3::new((p.x - warp) * 19.0, p.y * 2.5, (p.z + warp) * 19.0);
                let weave = 0.02 * value3(seed ^ 14, p * 70.0);
                height * (0.8 * ridged3(seed ^ 12, fold) + 0.22 * ridged3(seed ^ 13, crease) + weave)
            }
            Skin::Strands => {
                let warp = value3(seed ^ 15, p * 7.0) * 0.05;
                let strand = DVec3::new((p.x + warp) * 42.0, p.y * 5.0, (p.z + warp) * 34.0);
                0.010 * ridged3(seed ^ 16, p * DVec3::new(16.0, 3.0, 16.0))
                    + 0.008 * ridged3(seed ^ 17, strand)
            }
            Skin::Scales { columns, radius } => match along {
                None => 0.02 * radius * value3(seed ^ 18, p * 30.0),
                Some((length, turns)) => scales(length, turns, columns, radius),
            },
        }
    }
}

/// Rows of rounded, overlapping scales on back and flanks; broad plates on the belly.
fn scales(length: f64, turns: f64, columns: f64, radius: f64) -> f64 {
    // A scale is as long as it is wide: `columns` of them around 2π radii.
    let v = length * columns / 5.4;
    let belly = smoothstep(0.335, 0.365, turns.abs());
    let row = v.floor();
    let odd = row - (row * 0.5).floor() * 2.0;
    // Rows overlap: the higher of two candidate rows counts.
    let mut best: f64 = 0.0;
    for k in 0..2 {
        let k = f64::from(k);
        let shift = if (odd == 0.0) == (k == 0.0) { 0.0 } else { 0.5 };
        let u = turns * columns + shift;
        let du = u - u.floor() - 0.5;
        let dv = (v - row + k) * 0.5;
        let rim = 1.0 - du * du * 4.0 * 0.9 - dv * dv;
        if rim > 0.0 {
            let keel = 0.12 * (1.0 - smoothstep(0.0, 0.12, du.abs()));
            best = best.max((rim.sqrt() * (1.0 - 0.55 * dv) + keel) * smoothstep(0.0, 0.07, dv));
        }
    }
    let plate = {
        let w = v * 0.5;
        let f = w - w.floor();
        0.25 + 0.75 * (1.0 - f) * smoothstep(0.0, 0.12, f)
    };
    radius * 0.11 * (best * (1.0 - belly) + plate * 0.8 * belly)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::uniform;

    #[test]
    fn relief_stays_within_its_stated_height() {
        let skins = [
            Skin::Plain,
            Skin::Polished,
            Skin::Rock,
            Skin::Fur,
            Skin::Mane,
            Skin::Cloth(0.05),
            Skin::Strands,
            Skin::Scales { columns: 16.0, radius: 0.2 },
        ];
        for skin in skins {
            for i in 0..4000 {
                let r = |k| uniform(9, i, k, 0) * 6.0 - 3.0;
                let along = (i % 3 != 0).then(|| (r(3) * 20.0, r(4) / 6.0));
                let relief = skin.relief(DVec3::new(r(0), r(1), r(2)), along, 77);
                assert!(relief.abs() <= skin.height() + 1e-12, "{skin:?}: {relief}");
            }
        }
    }
}
