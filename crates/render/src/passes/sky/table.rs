//! Table over the unit square with bilinear interpolation.

use glam::DVec3;

/// A table over the unit square.
#[derive(Clone, Debug, Default)]
pub(crate) struct Table {
    width: usize,
    values: Vec<DVec3>,
}

impl Table {
    /// Samples a function at `width` × `height` points, at least 2 × 2; the outermost lie on the border.
    pub(crate) fn new(width: usize, height: usize, value: impl Fn(f64, f64) -> DVec3) -> Self {
        let share = |i: usize, count: usize| i as f64 / (count - 1) as f64;
        let points = (0..width * height).map(|i| (share(i % width, width), share(i / width, height)));
        Self { width, values: points.map(|(x, y)| value(x, y)).collect() }
    }

    pub(crate) fn at(&self, x: f64, y: f64) -> DVec3 {
        let height = self.values.len() / self.width;
        let split = |share: f64, count: usize| {
            let place = share.clamp(0.0, 1.0) * (count - 1) as f64;
            let low = (place as usize).min(count - 2);
            (low, place - low as f64)
        };
        let ((i, u), (j, v)) = (split(x, self.width), split(y, height));
        let row = |j: usize| {
            let first = j * self.width + i;
            self.values[first].lerp(self.values[first + 1], u)
        };
        row(j).lerp(row(j + 1), v)
    }
}
