//! A buffer of inverse depths, triangles drawn into it, and what spheres show in it.

use std::ops::Range;

use glam::{Vec2, Vec3};

use crate::view::View;

/// Depth below which a corner counts as behind the eye, relative to nothing: surfaces so near hide nothing.
const NEAR: f32 = 1e-6;

/// Who drew where nothing is.
const NOBODY: u32 = u32::MAX;

/// Inverse depths, row by row from the top; 0 where nothing is.
#[derive(Debug, Default)]
pub(super) struct DepthBuffer {
    width: usize,
    height: usize,
    /// Pixels per unit of tangent.
    scale: f32,
    /// Nearest surface.
    near: Vec<f32>,
    /// Who drew it.
    owner: Vec<u32>,
    /// Where that is, in the axes of the view.
    points: Vec<Vec3>,
    /// The farthest of the nearest surfaces of a pixel and those around it.
    eroded: Vec<f32>,
}

/// A corner on the screen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    at: Vec2,
    /// 1 over depth; 0 where the corner is not in front of the eye.
    inverse_depth: f32,
}

impl DepthBuffer {
    /// Empties the buffer and fits it to a view, `long_side` pixels along its longer side.
    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    pub(super) fn clear(&mut self, view: &View, long_side: u32) {
        let [width, height] = view.viewport_px.map(|side| side.max(1));
        let scale = long_side as f32 / width.max(height) as f32;
        let side = |px: u32| ((px as f32 * scale).ceil() as usize).max(1);
        (self.width, self.height) = (side(width), side(height));
        self.scale = view.scale_px() as f32 * scale;
        self.near.clear();
        self.near.resize(self.width * self.height, 0.0);
        self.owner.clear();
        self.owner.resize(self.near.len(), NOBODY);
    }

    pub(super) const fn scale(&self) -> f32 {
        self.scale
    }

    #[allow(clippy::cast_precision_loss)]
    fn middle(&self) -> Vec2 {
        Vec2::new(self.width as f32, self.height as f32) * 0.5
    }

    /// A point in the view's axes, on the screen.
    pub(super) fn project(&self, point: Vec3) -> Corner {
        if point.z <= NEAR {
            return Corner { at: Vec2::ZERO, inverse_depth: 0.0 };
        }
        let inverse_depth = 1.0 / point.z;
        Corner { at: self.middle() + point.truncate() * (self.scale * inverse_depth), inverse_depth }
    }

    /// Draws a triangle, seen from either side. One that reaches behind the eye is left out: it hides nothing.
    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    pub(super) fn triangle(&mut self, owner: u32, [a, b, c]: [Corner; 3]) {
        if a.inverse_depth <= 0.0 || b.inverse_depth <= 0.0 || c.inverse_depth <= 0.0 {
            return;
        }
        let (low, high) = (a.at.min(b.at).min(c.at), a.at.max(b.at).max(c.at));
        // Pixels whose centres lie between; conversions to integers saturate.
        let first = |x: f32| (x - 0.5).ceil().max(0.0) as usize;
        let after = |x: f32, side: usize| ((x + 0.5).floor().max(0.0) as usize).min(side);
        let (x0, x1) = (first(low.x), after(high.x, self.width));
        let (y0, y1) = (first(low.y), after(high.y, self.height));
        if x0 >= x1 || y0 >= y1 {
            return;
        }
        let (ab, ac) = (b.at - a.at, c.at - a.at);
        let area = ab.perp_dot(ac);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let inverse = 1.0 / area;
        let (db, dc) = (b.inverse_depth - a.inverse_depth, c.inverse_depth - a.inverse_depth);
        // Barycentric coordinates of b and c grow evenly along a row.
        let (step_b, step_c) = (ac.y * inverse, -ab.y * inverse);
        for y in y0..y1 {
            let from = Vec2::new(x0 as f32 + 0.5, y as f32 + 0.5) - a.at;
            let mut of_b = from.perp_dot(ac) * inverse;
            let mut of_c = ab.perp_dot(from) * inverse;
            let row = y * self.width + x0..y * self.width + x1;
            for (near, who) in self.near[row.clone()].iter_mut().zip(&mut self.owner[row]) {
                if of_b >= 0.0 && of_c >= 0.0 && of_b + of_c <= 1.0 {
                    let inverse_depth = a.inverse_depth + of_b * db + of_c * dc;
                    if inverse_depth > *near {
                        (*near, *who) = (inverse_depth, owner);
                    }
                }
                of_b += step_b;
                of_c += step_c;
            }
        }
    }

    /// Lets edges give way by so many pixels, to the sides and upright.
    pub(super) fn erode(&mut self, pixels: u32) {
        self.eroded.clone_from(&self.near);
        for _ in 0..pixels {
            for row in self.eroded.chunks_exact_mut(self.width) {
                let mut left = f32::INFINITY;
                for x in 0..row.len() {
                    let here = row[x];
                    let right = row.get(x + 1).copied().unwrap_or(here);
                    row[x] = left.min(here).min(right);
                    left = here;
                }
            }
            let mut above = self.eroded[..self.width].to_vec();
            for y in 0..self.height {
                let (rows, rest) = self.eroded.split_at_mut((y + 1) * self.width);
                let row = &mut rows[y * self.width..];
                for x in 0..self.width {
                    let here = row[x];
                    let below = rest.get(x).copied().unwrap_or(here);
                    row[x] = above[x].min(here).min(below);
                    above[x] = here;
                }
            }
        }
    }

    /// 1 over the depth of the nearest surface, 0 if there is none.
    pub(super) fn nearest(&self) -> f32 {
        self.near.iter().copied().fold(0.0, f32::max)
    }

    /// Says where the points are that are seen, once all is drawn.
    pub(super) fn find_points(&mut self) {
        self.points.clear();
        self.points.reserve(self.near.len());
        for y in 0..self.height {
            for x in 0..self.width {
                let near = self.near[y * self.width + x];
                let point = if near > 0.0 { self.ray(x, y) / near } else { Vec3::ZERO };
                self.points.push(point);
            }
        }
    }

    /// Direction of a pixel's middle; its depth is 1.
    #[allow(clippy::cast_precision_loss)]
    fn ray(&self, x: usize, y: usize) -> Vec3 {
        ((Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - self.middle()) / self.scale).extend(1.0)
    }

    pub(super) fn pixels(&self) -> usize {
        self.near.len()
    }

    /// The points of an owner's that a sphere may contain, of large ones a part, evenly: `visit` gets the pixel's number
    /// and the point. Gives how many pixels each stands for; `None` for a sphere that reaches to the eye.
    pub(super) fn points_around(
        &self,
        owner: u32,
        center: Vec3,
        radius: f32,
        mut visit: impl FnMut(usize, Vec3),
    ) -> Option<f32> {
        let disc = self.disc(center, radius)?;
        for y in disc.rows.clone().step_by(disc.stride) {
            let row = y * self.width;
            for x in disc.columns.clone().step_by(disc.stride) {
                if self.owner[row + x] == owner {
                    visit(row + x, self.points[row + x]);
                }
            }
        }
        Some(disc.weight())
    }

    /// In how many pixels one sees a sphere: all that is there lies behind its nearest point.
    #[allow(clippy::cast_precision_loss)]
    pub(super) fn seen_through(&self, center: Vec3, radius: f32) -> f32 {
        let Some(disc) = self.disc(center, radius) else { return 1.0 };
        let nearest = center.z - radius;
        let mut seen = 0.0;
        for y in disc.rows.clone().step_by(disc.stride) {
            for x in disc.columns.clone().step_by(disc.stride) {
                let from = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - disc.middle;
                // Half a pixel's diagonal more, so that the smallest discs have a pixel.
                let inside = from.length_squared() <= (disc.radius + 0.71) * (disc.radius + 0.71);
                if inside && self.eroded[y * self.width + x] * nearest <= 1.0 {
                    seen += 1.0;
                }
            }
        }
        seen * disc.weight()
    }

    /// Where a sphere is on the screen; `None` for one that reaches to the eye.
    #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn disc(&self, center: Vec3, radius: f32) -> Option<Disc> {
        let nearest = center.z - radius;
        if nearest <= NEAR || !radius.is_finite() {
            return None;
        }
        let middle = self.middle() + center.truncate() * (self.scale / center.z);
        let radius = self.scale * radius / nearest;
        // Saturates; at least 1.
        let stride = (radius / STRIDE_RADIUS).clamp(1.0, MAX_STRIDE) as usize;
        let range = |at: f32, side: usize| {
            let first = ((at - radius - 0.5).floor().max(0.0) as usize).min(side);
            let end = ((at + radius + 0.5).ceil().max(0.0) as usize).clamp(first, side);
            // On a lattice that is the same for all discs of a stride.
            first.next_multiple_of(stride).min(end)..end
        };
        Some(Disc {
            middle,
            radius,
            columns: range(middle.x, self.width),
            rows: range(middle.y, self.height),
            stride,
        })
    }
}

/// Radius of the largest discs of which all pixels are looked at.
const STRIDE_RADIUS: f32 = 10.0;
/// Of the largest, each so many-th row and column is.
const MAX_STRIDE: f32 = 8.0;

/// A sphere on the screen, in pixels of the buffer.
#[derive(Clone, Debug)]
struct Disc {
    middle: Vec2,
    radius: f32,
    columns: Range<usize>,
    rows: Range<usize>,
    stride: usize,
}

impl Disc {
    /// Pixels that one which is looked at stands for.
    #[allow(clippy::cast_precision_loss)]
    fn weight(&self) -> f32 {
        (self.stride * self.stride) as f32
    }
}
