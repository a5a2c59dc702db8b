//! Depth buffer: triangle rasterisation into inverse depths, and queries with spheres.

use std::ops::Range;

use glam::{Vec2, Vec3, Vec4};

use lodestream_scene::view::View;

/// Depth below which a corner counts as behind the eye, in world units.
const NEAR: f32 = 1e-6;

/// Pixels drawn at once; the width is a multiple of it.
const LANES: usize = 4;
const STEP: f32 = 4.0;

/// Owner of pixels without a surface.
const NO_OWNER: u32 = u32::MAX;

/// Inverse depths, row by row from the top; 0 without a surface.
#[derive(Debug, Default)]
pub(super) struct DepthBuffer {
    width: usize,
    height: usize,
    /// Pixels per unit of tangent.
    scale: f32,
    /// Inverse depth of the nearest surface.
    near: Vec<f32>,
    /// The instance that drew it.
    owner: Vec<u32>,
    /// Its point, in view axes.
    points: Vec<Vec3>,
    /// Minimum of `near` over a pixel and its neighbours.
    eroded: Vec<f32>,
}

/// A range of columns and rows.
#[derive(Clone, Debug, Default)]
pub(super) struct Frame {
    columns: Range<usize>,
    rows: Range<usize>,
}

/// A projected corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    at: Vec2,
    /// 1 / depth; 0 if the corner is behind the eye.
    inverse_depth: f32,
    /// Column and row of the first pixel whose middle is not before the corner, and of the first beyond it. Computed
    /// once, since a corner has some six triangles.
    first: [i16; 2],
    after: [i16; 2],
}

impl DepthBuffer {
    /// Clears the buffer and sizes it for a view, with `long_side` pixels along its longer side.
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "sides are at most 65,535 pixels, scaled down to `long_side`"
    )]
    pub(super) fn clear(&mut self, view: &View, long_side: u32) {
        let [width, height] = view.viewport_px.map(|side| side.max(1));
        let scale = long_side as f32 / width.max(height) as f32;
        let side = |px: u32| ((px as f32 * scale).ceil() as usize).max(1);
        (self.width, self.height) = (side(width).next_multiple_of(LANES), side(height));
        self.scale = view.scale_px() as f32 * scale;
        self.near.clear();
        self.near.resize(self.width * self.height, 0.0);
        self.owner.clear();
        self.owner.resize(self.near.len(), NO_OWNER);
    }

    pub(super) const fn scale(&self) -> f32 {
        self.scale
    }

    #[expect(clippy::cast_precision_loss, reason = "sides of the buffer are small")]
    fn middle(&self) -> Vec2 {
        Vec2::new(self.width as f32, self.height as f32) * 0.5
    }

    /// Projects a point in view axes.
    pub(super) fn project(&self, point: Vec3) -> Corner {
        if point.z <= NEAR {
            return Corner { at: Vec2::ZERO, inverse_depth: 0.0, first: [0; 2], after: [0; 2] };
        }
        let inverse_depth = 1.0 / point.z;
        let at = self.middle() + point.truncate() * (self.scale * inverse_depth);
        // No buffer is wider than i16::MAX, so saturation is harmless.
        let short = |pixel: i32| i16::try_from(pixel).unwrap_or(if pixel < 0 { i16::MIN } else { i16::MAX });
        let first = at.to_array().map(|x| short(ceil(x - 0.5)));
        let after = at.to_array().map(|x| short(floor(x + 0.5)));
        Corner { at, inverse_depth, first, after }
    }

    /// Draws a triangle, of either orientation. Skips triangles that reach behind the eye.
    #[inline]
    pub(super) fn triangle(&mut self, owner: u32, [a, b, c]: [&Corner; 3]) {
        // Pixels whose centres lie between.
        let range = |axis: usize, side: usize| {
            let first = a.first[axis].min(b.first[axis]).min(c.first[axis]).max(0);
            let after = a.after[axis].max(b.after[axis]).max(c.after[axis]);
            usize::try_from(first).unwrap_or(0)..usize::try_from(after).unwrap_or(0).min(side)
        };
        let (columns, rows) = (range(0, self.width), range(1, self.height));
        let before = a.inverse_depth > 0.0 && b.inverse_depth > 0.0 && c.inverse_depth > 0.0;
        // Most small faces cover no pixel centre.
        if !columns.is_empty() && !rows.is_empty() && before {
            self.fill(owner, [a, b, c], columns, rows);
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "sides of the buffer are small")]
    fn fill(&mut self, owner: u32, [a, b, c]: [&Corner; 3], columns: Range<usize>, rows: Range<usize>) {
        let (ab, ac) = (b.at - a.at, c.at - a.at);
        let area = ab.perp_dot(ac);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let inverse = 1.0 / area;
        let (db, dc) = (b.inverse_depth - a.inverse_depth, c.inverse_depth - a.inverse_depth);
        // Barycentric coordinates of b and c grow evenly along a row. Four pixels at once.
        let (step_b, step_c) = (ac.y * inverse, -ab.y * inverse);
        let first = columns.start - columns.start % LANES;
        let lanes = Vec4::new(0.0, 1.0, 2.0, 3.0);
        for y in rows {
            let from = Vec2::new(first as f32 + 0.5, y as f32 + 0.5) - a.at;
            let mut of_b = Vec4::splat(from.perp_dot(ac) * inverse) + lanes * step_b;
            let mut of_c = Vec4::splat(ab.perp_dot(from) * inverse) + lanes * step_c;
            let row = y * self.width + first..y * self.width + columns.end.next_multiple_of(LANES);
            let near = self.near[row.clone()].as_chunks_mut::<LANES>().0;
            for (near, who) in near.iter_mut().zip(self.owner[row].as_chunks_mut::<LANES>().0) {
                let inverse_depth = Vec4::splat(a.inverse_depth) + of_b * db + of_c * dc;
                let inside = of_b.cmpge(Vec4::ZERO) & of_c.cmpge(Vec4::ZERO) & (of_b + of_c).cmple(Vec4::ONE);
                let nearer = (inside & inverse_depth.cmpgt(Vec4::from_array(*near))).bitmask();
                if nearer != 0 {
                    for (lane, inverse_depth) in inverse_depth.to_array().into_iter().enumerate() {
                        if nearer >> lane & 1 != 0 {
                            (near[lane], who[lane]) = (inverse_depth, owner);
                        }
                    }
                }
                of_b += STEP * step_b;
                of_c += STEP * step_c;
            }
        }
    }

    /// Erodes the surfaces by `pixels` along both axes.
    pub(super) fn erode(&mut self, pixels: u32) {
        self.eroded.clone_from(&self.near);
        let mut before = vec![0.0; self.near.len()];
        let width = self.width;
        for _ in 0..pixels {
            before.copy_from_slice(&self.eroded);
            for (row, before) in self.eroded.chunks_exact_mut(width).zip(before.chunks_exact(width)) {
                lessen(&mut row[1..], before);
                lessen(row, &before[1..]);
            }
            before.copy_from_slice(&self.eroded);
            lessen(&mut self.eroded[width..], &before);
            lessen(&mut self.eroded, &before[width..]);
        }
    }

    /// Inverse depth of the nearest surface, 0 if there is none.
    pub(super) fn nearest(&self) -> f32 {
        self.near.iter().copied().fold(0.0, f32::max)
    }

    /// Computes the visible points, after all triangles are drawn.
    pub(super) fn find_points(&mut self) {
        let mut points = std::mem::take(&mut self.points);
        points.clear();
        for (y, row) in self.near.chunks_exact(self.width.max(1)).enumerate() {
            points.extend(
                row.iter().enumerate().map(|(x, &near)| self.ray(x, y) / near.max(f32::MIN_POSITIVE)),
            );
        }
        self.points = points;
    }

    /// Direction of a pixel's middle; its depth is 1.
    #[expect(clippy::cast_precision_loss, reason = "sides of the buffer are small")]
    fn ray(&self, x: usize, y: usize) -> Vec3 {
        ((Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - self.middle()) / self.scale).extend(1.0)
    }

    pub(super) fn pixels(&self) -> usize {
        self.near.len()
    }

    /// Bounds in pixels of triangles with these corners.
    pub(super) fn frame(&self, corners: &[Corner]) -> Frame {
        let before = || corners.iter().filter(|corner| corner.inverse_depth > 0.0);
        let range = |axis: usize, side: usize| {
            let first = before().map(|corner| corner.first[axis]).min().unwrap_or(0);
            let after = before().map(|corner| corner.after[axis]).max().unwrap_or(0);
            usize::try_from(first).unwrap_or(0)..usize::try_from(after).unwrap_or(0).min(side)
        };
        Frame { columns: range(0, self.width), rows: range(1, self.height) }
    }

    /// Visits the points of an owner, which lie within `frame`, that a sphere may contain; of large spheres an even
    /// sample. `visit` gets the pixel's index and the point. Returns the pixels per visited point; `None` for a
    /// sphere that contains the eye.
    pub(super) fn points_around(
        &self,
        owner: u32,
        frame: &Frame,
        center: Vec3,
        radius: f32,
        mut visit: impl FnMut(usize, Vec3),
    ) -> Option<f32> {
        let disc = self.disc(center, radius)?;
        let within = |of_disc: &Range<usize>, of_owner: &Range<usize>| {
            let first = of_disc.start.max(of_owner.start.next_multiple_of(disc.stride));
            let end = of_disc.end.min(of_owner.end);
            first.min(end)..end
        };
        let (columns, rows) = (within(&disc.columns, &frame.columns), within(&disc.rows, &frame.rows));
        for y in rows.step_by(disc.stride) {
            let row = y * self.width + columns.start..y * self.width + columns.end;
            let mut look = |pixel: usize, who: u32| {
                if who == owner {
                    visit(pixel, self.points[pixel]);
                }
            };
            let pixels = row.clone().zip(self.owner[row].iter().copied());
            // Most discs are small, and iterating without a step is twice as fast.
            if disc.stride == 1 {
                pixels.for_each(|(pixel, who)| look(pixel, who));
            } else {
                pixels.step_by(disc.stride).for_each(|(pixel, who)| look(pixel, who));
            }
        }
        Some(disc.weight())
    }

    /// Number of pixels in which the eroded buffer is behind a sphere's nearest point, and number of the sphere's
    /// pixels.
    #[expect(clippy::cast_precision_loss, reason = "sides of the buffer are small")]
    pub(super) fn seen_through(&self, center: Vec3, radius: f32) -> (f32, f32) {
        let Some(disc) = self.disc(center, radius) else { return (1.0, 1.0) };
        let nearest = center.z - radius;
        let (mut seen, mut all) = (0.0, 0.0);
        for y in disc.rows.clone().step_by(disc.stride) {
            for x in disc.columns.clone().step_by(disc.stride) {
                let from = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - disc.middle;
                // Half a pixel's diagonal more, so that the smallest discs have a pixel.
                if from.length_squared() <= (disc.radius + 0.71) * (disc.radius + 0.71) {
                    all += 1.0;
                    if self.eroded[y * self.width + x] * nearest <= 1.0 {
                        seen += 1.0;
                    }
                }
            }
        }
        (seen * disc.weight(), all * disc.weight())
    }

    /// Where a sphere is on the screen; `None` for one that reaches to the eye.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it is clamped first")]
    fn disc(&self, center: Vec3, radius: f32) -> Option<Disc> {
        let nearest = center.z - radius;
        if nearest <= NEAR || !radius.is_finite() {
            return None;
        }
        let middle = self.middle() + center.truncate() * (self.scale / center.z);
        let radius = self.scale * radius / nearest;
        let stride = (radius / STRIDE_RADIUS).clamp(1.0, MAX_STRIDE) as usize;
        let range = |at: f32, side: usize| {
            let first = usize::try_from(floor(at - radius - 0.5)).unwrap_or(0).min(side);
            let end = usize::try_from(ceil(at + radius + 0.5)).unwrap_or(0).clamp(first, side);
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

/// The greatest integer that is not more; saturates. A cast is cheaper than the library's call where the processor
/// has no instruction for it.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "saturates; beyond 24 bits every f32 is whole"
)]
fn floor(x: f32) -> i32 {
    let near = x as i32;
    near.saturating_sub(i32::from(x < near as f32))
}

/// The least integer that is not less; saturates.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "saturates; beyond 24 bits every f32 is whole"
)]
fn ceil(x: f32) -> i32 {
    let near = x as i32;
    near.saturating_add(i32::from(x > near as f32))
}

/// Takes what is less of each and its fellow, as far as there are fellows.
fn lessen(values: &mut [f32], others: &[f32]) {
    for (value, other) in values.iter_mut().zip(others) {
        *value = value.min(*other);
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
    #[expect(clippy::cast_precision_loss, reason = "a stride is less than the buffer's sides")]
    fn weight(&self) -> f32 {
        (self.stride * self.stride) as f32
    }
}
