//! A ray over a height map, and its intersection.

use super::ReliefMap;

/// A ray over a height map.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Texture coordinates where it comes to the surface.
    pub start: [f64; 2],
    /// Change of texture coordinates until full depth.
    pub span: [f64; 2],
    /// Cosine of its angle to the normal.
    pub cosine: f64,
}

impl Ray {
    /// Texture coordinates at a fraction of the way.
    #[must_use]
    pub fn at(&self, s: f64) -> [f64; 2] {
        [self.start[0] + self.span[0] * s, self.start[1] + self.span[1] * s]
    }
}

/// The intersection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReliefHit {
    /// Fraction of the way.
    pub at: f64,
    /// Lookups of a texture, each of four texels or one.
    pub lookups: u32,
}

/// Clearance of a ray over the surface, in depths.
pub(super) fn clearance(map: &ReliefMap, ray: &Ray, s: f64) -> f64 {
    1.0 - map.sample(ray.at(s)) - s
}
