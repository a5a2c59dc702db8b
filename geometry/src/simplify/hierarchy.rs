//! What simplification leaves: levels of chunks above a base mesh.

use crate::collapse::{Placed, Records};
use crate::mesh::vec3::Vec3;
use crate::simplify::live::Live;

/// A region with its collapses.
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

/// A mesh reduced to its base, and the way there.
pub(crate) struct Simplified {
    /// Levels, finest first; each a list of chunks.
    pub(crate) levels: Vec<Vec<RegionChunk>>,
    /// What is left.
    pub(crate) live: Live,
    /// Error of regions that vanished or were dropped without a chunk of their own.
    pub(crate) stray_error: f64,
    /// How many bits the grids leave out that the levels' chunks bring vertices to; one more for the base mesh.
    pub(crate) shifts: Vec<u8>,
}
