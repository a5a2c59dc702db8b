//! Distance between two triangle meshes.
//!
//! The metric is the two-sided sampled surface distance of Cignoni, Rocchini and Scopigno ("Metro:
//! measuring error on simplified surfaces", 1998), restricted to faces: points are drawn uniformly
//! by area on each surface, each point's exact nearest distance to the other surface is taken, and
//! the root mean square and the maximum over the points are divided by the diagonal of the bounding
//! box of the first mesh, the reference. The figure is the larger of the two directions. Vertices
//! and edges get no samples of their own; tools that add them give values up to 20 % apart.
//!
//! A maximum over samples is a lower bound on the Hausdorff distance. Attributes are compared at the same
//! points: [`compare_attributes`].
//!
//! Cost: about a microsecond a sample and core on meshes of 70,000 faces, plus reading the files.

mod attributes;
mod distance;
mod obj;
mod sample;

pub use attributes::{AttributeDifferences, Differences, compare_attributes};
pub use distance::{Comparison, Distances, MeasureError, Settings, compare};
pub use obj::{read_models, read_obj};
pub use sample::SurfaceSampler;

/// A surface as triangles, without attributes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Positions, possibly more than the triangles use.
    pub positions: Vec<[f64; 3]>,
    /// Triangles; every index lies within `positions`.
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Length of the diagonal of the bounding box of the positions that triangles use; 0 where
    /// there are none.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        let mut low = glam::DVec3::INFINITY;
        let mut high = glam::DVec3::NEG_INFINITY;
        for &vertex in self.triangles.iter().flatten() {
            let position = glam::DVec3::from_array(self.positions[vertex as usize]);
            low = low.min(position);
            high = high.max(position);
        }
        if self.triangles.is_empty() { 0.0 } else { low.distance(high) }
    }
}
