//! Positions and normals reconstructed from depth: `surface.wgsl`.

use super::depth::{view_depth, view_ray};

/// A depth buffer with its projection.
#[derive(Clone, Copy, Debug)]
pub struct DepthPicture<'a> {
    /// Stored depths, rows from the top.
    pub stored: &'a [f32],
    /// Width and height.
    pub size_px: [u32; 2],
    /// `(tan(fov_x / 2), tan(fov_y / 2))`.
    pub tan_half_fov: [f64; 2],
    /// Near plane.
    pub near: f64,
}

pub(super) type V3 = [f64; 3];

pub(super) fn sub(a: V3, b: V3) -> V3 {
    [0, 1, 2].map(|i| a[i] - b[i])
}

pub(super) fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn scale(a: V3, s: f64) -> V3 {
    a.map(|x| x * s)
}

impl DepthPicture<'_> {
    /// Pixels per world unit at depth 1.
    pub(super) fn scale_px(&self) -> f64 {
        f64::from(self.size_px[1]) / (2.0 * self.tan_half_fov[1])
    }

    /// View depth at a pixel, or at the nearest one of the picture; 1e30 where there is no surface.
    #[must_use]
    pub fn depth_at(&self, p: [i64; 2]) -> f64 {
        // The shader uses a large number instead of infinity.
        view_depth(self.stored_at(p), self.near).min(1e30)
    }

    /// Position of the surface at a pixel, in view space.
    #[must_use]
    pub fn position_at(&self, p: [i64; 2]) -> V3 {
        scale(view_ray(p, self.size_px, self.tan_half_fov), self.depth_at(p))
    }

    /// Normal of the surface at a pixel which lies at `centre`, towards the eye.
    #[must_use]
    pub fn normal_at(&self, p: [i64; 2], centre: V3) -> V3 {
        let at = |dx, dy| self.position_at([p[0] + dx, p[1] + dy]);
        let pick = |before: V3, after: V3, first: bool, last: bool| {
            if first || (after[2].abs() < before[2].abs() && !last) { after } else { before }
        };
        let last = |i: usize| p[i] + 1 >= i64::from(self.size_px[i]);
        let dx = pick(sub(centre, at(-1, 0)), sub(at(1, 0), centre), p[0] == 0, last(0));
        let dy = pick(sub(centre, at(0, -1)), sub(at(0, 1), centre), p[1] == 0, last(1));
        facing(dx, dy, centre)
    }

    /// What is stored at a pixel, or at the nearest one of the picture.
    pub(super) fn stored_at(&self, p: [i64; 2]) -> f64 {
        let clamp = |x: i64, n: u32| x.clamp(0, i64::from(n) - 1) as usize;
        let (x, y) = (clamp(p[0], self.size_px[0]), clamp(p[1], self.size_px[1]));
        f64::from(self.stored[y * self.size_px[0] as usize + x])
    }
}

/// The normal of what two differences of places span, towards the eye.
pub(super) fn facing(dx: V3, dy: V3, centre: V3) -> V3 {
    let n = cross(dx, dy);
    let length = dot(n, n).sqrt();
    let towards_eye = scale(centre, -1.0 / dot(centre, centre).sqrt());
    if !(length > 1e-30 && length < 1e30) {
        return towards_eye;
    }
    scale(n, if dot(n, towards_eye) > 0.0 { 1.0 } else { -1.0 } / length)
}
