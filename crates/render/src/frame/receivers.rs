//! Bounds of the surfaces that a view shows and that shadows must cover.

use glam::DVec3;

/// Bounds of visible surfaces, relative to the eye, world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Receivers {
    pub(crate) nearest: f64,
    pub(crate) farthest: f64,
    /// Corners of a box around all of them.
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
}

impl Receivers {
    /// No surface.
    pub(crate) const NONE: Self =
        Self { nearest: f64::INFINITY, farthest: 0.0, low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// Extends the bounds by a sphere. From inside, its distance counts as an eighth of its size.
    pub(crate) fn add(&mut self, centre: DVec3, radius: f64) {
        self.nearest = self.nearest.min((centre.length() - radius).max(radius / 8.0));
        self.farthest = self.farthest.max(centre.length() + radius);
        self.low = self.low.min(centre - radius);
        self.high = self.high.max(centre + radius);
    }

    /// Whether no sphere within this one extends the bounds.
    pub(crate) fn cover(&self, centre: DVec3, radius: f64) -> bool {
        let distance = centre.length();
        distance - radius >= self.nearest
            && distance + radius <= self.farthest
            && (centre - radius).cmpge(self.low).all()
            && (centre + radius).cmple(self.high).all()
    }

    /// Extends the bounds by a shell between two distances.
    pub(crate) fn add_around(&mut self, nearest: f64, farthest: f64) {
        self.add(DVec3::ZERO, farthest);
        self.nearest = self.nearest.min(nearest);
    }
}
