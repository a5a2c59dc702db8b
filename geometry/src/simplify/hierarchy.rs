//! What simplification makes of a region: a chunk.

use crate::collapse::{Placed, Records};
use crate::mesh::vec3::Vec3;

/// A region with its collapses.
#[derive(Debug, PartialEq)]
pub(crate) struct RegionChunk {
    pub(crate) records: Records,
    /// Faces of the region at the level's start.
    pub(crate) faces: Vec<u32>,
    /// Vertices whose whole star lay in the region, ascending.
    pub(crate) interior: Vec<u32>,
    /// Geometric error in grid cells while the chunk is missing, before it is made monotone.
    pub(crate) error: f64,
    /// How far attributes slide while the chunk is missing, in grid cells, before it is made monotone.
    pub(crate) attribute_error: f64,
    /// The same once the chunk is applied up to each stop of its records; falling, at most `error`.
    pub(crate) stop_errors: Vec<f64>,
    /// What becomes of the vertices of the region that are left.
    pub(crate) moves: Vec<Placed>,
    /// Bounding sphere in grid cells about the middle of the grid.
    pub(crate) center: Vec3,
    pub(crate) radius: f64,
}

impl RegionChunk {
    /// Leaves only the chunk as a whole.
    pub(super) fn forget_stops(&mut self) {
        self.records.stops.clear();
        self.stop_errors.clear();
    }
}
