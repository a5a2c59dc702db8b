//! Slices through the direction to the eye: `slices.wgsl`.

use std::f64::consts::PI;

use super::receiver::{Receiver, basis, length};
use crate::cpu_reference::surface::{V3, dot, scale};

/// See the shader's.
pub(super) struct Slice {
    pub(super) offset_px: [f64; 2],
    pub(super) tangent: V3,
    pub(super) normal_length: f64,
    pub(super) sine: f64,
    pub(super) cosine: f64,
    pub(super) angle: f64,
}

/// Slices, and steps to either side of each.
pub(super) fn counts(r: &Receiver<'_>) -> (usize, usize) {
    counts_of(r.samples)
}

fn counts_of(samples: usize) -> (usize, usize) {
    let slices = ((samples + 8) / 16).max(1);
    (slices, (samples / (2 * slices)).max(1))
}

impl Slice {
    pub(super) fn new(r: &Receiver<'_>, number: usize) -> Self {
        let to_eye = scale(r.centre, -1.0 / length(r.centre));
        let (slices, _) = counts(r);
        let (sin, cos) = (PI * (number as f64 + f64::from(r.rotation) / 16.0) / slices as f64).sin_cos();
        let [b0, b1] = basis(to_eye);
        let along = [0, 1, 2].map(|i| b0[i] * cos + b1[i] * sin);
        let offset = [0, 1].map(|i| (along[i] + r.centre[i] / r.depth * along[2]) * r.scale_px / r.depth);
        let projected = [dot(r.normal, along), dot(r.normal, to_eye)];
        let normal_length = projected[0].hypot(projected[1]).max(1e-6);
        let [sine, cosine] = projected.map(|x| x / normal_length);
        Self {
            offset_px: [offset[0], -offset[1]],
            tangent: [0, 1, 2].map(|i| along[i] * cosine - to_eye[i] * sine),
            normal_length,
            sine,
            cosine,
            angle: projected[0].atan2(projected[1]),
        }
    }

    /// The sample `step` steps away on one side.
    pub(super) fn drawn_at(&self, r: &Receiver<'_>, step: usize, side: f64) -> V3 {
        let share = (step as f64 + r.march_offset()) / counts(r).1 as f64;
        r.drawn_at(self.offset_px.map(|px| px * side * r.march_px(share * share) * r.depth / r.scale_px))
    }

    /// Along the tangent and along the normal.
    pub(super) fn within(&self, r: &Receiver<'_>, to: V3) -> [f64; 2] {
        [dot(to, self.tangent), dot(to, r.normal) / self.normal_length]
    }

    /// The integral of directions' weights from the direction to the eye to an angle.
    pub(super) fn arc(&self, angle: f64) -> f64 {
        0.25 * (self.cosine - (2.0 * angle - self.angle).cos() + 2.0 * angle * self.sine)
    }

    #[cfg(any(test, feature = "methods"))]
    pub(super) fn signed_arc(&self, angle: f64) -> f64 {
        if angle >= 0.0 { self.arc(angle) } else { -self.arc(angle) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed form against numerical sums over the slice.
    #[test]
    fn arcs_are_integrals_of_cosine_and_density() {
        for angle in [-1.4, -0.6, 0.0, 0.3, 1.2_f64] {
            let slice = Slice {
                offset_px: [0.0; 2],
                tangent: [0.0; 3],
                normal_length: 1.0,
                sine: angle.sin(),
                cosine: angle.cos(),
                angle,
            };
            for end in [angle - 0.5 * PI, -0.2, 0.4, angle + 0.5 * PI] {
                let n = 20_000;
                let step = end / f64::from(n);
                let weight = |t: f64| (t - angle).cos() * t.sin().abs() * step;
                let sum: f64 = (0..n).map(|i| weight((f64::from(i) + 0.5) * step)).sum();
                assert!((slice.signed_arc(end) - sum).abs() < 1e-6, "{angle} {end}");
            }
        }
        let counts = [1, 4, 8, 16, 32, 64].map(counts_of);
        assert_eq!(counts, [(1, 1), (1, 2), (1, 4), (1, 8), (2, 8), (4, 8)]);
    }
}
