//! The receiver: the pixel whose occlusion is estimated, and lookups around it.

use crate::cpu_reference::surface::{DepthPicture, V3, dot, sub};

/// As in the shader: elevation above the tangent plane from which on something occludes.
pub(super) const MIN_ELEVATION: f64 = 0.03;

/// The pixel whose occlusion is estimated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receiver<'a> {
    pub(super) picture: DepthPicture<'a>,
    pub(super) pixel: [i64; 2],
    pub(super) depth: f64,
    pub(super) centre: V3,
    pub(super) normal: V3,
    pub(super) radius: f64,
    pub(super) rotation: u32,
    pub(super) scale_px: f64,
    pub(super) samples: usize,
    /// Pixels between two that are looked up: 4 where it has a sixteenth of the picture.
    pub(super) stride: i64,
}

/// Two perpendiculars to the unit vector `n` (Duff et al., 2017).
pub(super) fn basis(n: V3) -> [V3; 2] {
    let s = if n[2] >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (s + n[2]);
    let b = n[0] * n[1] * a;
    [[1.0 + s * n[0] * n[0] * a, s * b, -s * n[0]], [b, s + n[1] * n[1] * a, -n[1]]]
}

impl Receiver<'_> {
    /// Falloff of an occluder with distance.
    pub(super) fn falloff(&self, distance: f64) -> f64 {
        (1.0 - distance / self.radius).max(0.0)
    }

    /// Falloff of an occluder between two samples of a march.
    pub(super) fn met_between(&self, last: V3, to: V3) -> f64 {
        let here = self.falloff(length(to));
        if last == [0.0; 3] {
            return here;
        }
        let middle = [0, 1, 2].map(|i| 0.5 * (last[i] + to[i]));
        let mean = 0.25 * (here + self.falloff(length(last))) + 0.5 * self.falloff(length(middle));
        let joined = (2.0 - length(sub(to, last)) / self.radius).clamp(0.0, 1.0);
        here + joined * (mean - here).max(0.0)
    }

    pub(super) fn march_offset(&self) -> f64 {
        (f64::from((self.rotation * 5 + 3) & 15) + 0.5) / 16.0
    }

    /// Pixels to go for a share of the radius, from the next on.
    pub(super) fn march_px(&self, share: f64) -> f64 {
        let next = self.stride as f64;
        next + ((self.radius * self.scale_px / self.depth).max(next) - next) * share
    }

    /// Surface at an offset in pixels.
    pub(super) fn drawn_at(&self, offset_px: [f64; 2]) -> V3 {
        let stride = self.stride as f64;
        let there = [0, 1]
            .map(|i| self.pixel[i] + self.stride * ((offset_px[i] + 0.5 * stride) / stride).floor() as i64);
        let outside = (0..2).any(|i| there[i] < 0 || there[i] >= i64::from(self.picture.size_px[i]));
        if outside || there == self.pixel || self.picture.depth_at(there) >= 1e30 {
            return [0.0; 3];
        }
        sub(self.picture.position_at(there), self.centre)
    }
}

pub(super) fn length(v: V3) -> f64 {
    dot(v, v).sqrt()
}
