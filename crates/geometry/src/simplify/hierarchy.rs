//! The result of simplifying a region: a chunk.

use crate::collapse::{NO_VERTEX, Placed, Records};
use crate::mesh::vec3::Vec3;

/// A region with its collapses.
#[derive(Debug, PartialEq)]
pub(crate) struct RegionChunk {
    pub(crate) records: Records,
    /// Faces of the region at the level's start.
    pub(crate) faces: Vec<u32>,
    /// Vertices whose complete star was in the region, ascending.
    pub(crate) interior: Vec<u32>,
    /// Geometric error in grid cells while the chunk is missing, before it is made monotone.
    pub(crate) error: f64,
    /// Attribute error in grid cells while the chunk is missing, before it is made monotone.
    pub(crate) attribute_error: f64,
    /// Geometric error at each truncation point of its records; descending, at most `error`.
    pub(crate) truncation_errors: Vec<f64>,
    /// Grid placements of the region's remaining vertices.
    pub(crate) moves: Vec<Placed>,
    /// Bounding sphere in grid cells about the middle of the grid.
    pub(crate) center: Vec3,
    pub(crate) radius: f64,
}

/// Numbers of elements that chunks may refer to.
#[derive(Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) vertices: usize,
    pub(crate) faces: usize,
    pub(crate) wedges: usize,
}

impl RegionChunk {
    /// Whether all its references are within bounds.
    pub(super) fn fits(&self, bounds: Bounds) -> bool {
        let vertex = |v: u32| (v as usize) < bounds.vertices;
        let face = |f: u32| (f as usize) < bounds.faces;
        let wedge = |w: u32| (w as usize) < bounds.wedges;
        let Records { collapses, moved, removed, removed_wedges, added_wedges, .. } = &self.records;
        collapses.iter().all(|c| vertex(c.removed) && (vertex(c.target) || c.target == NO_VERTEX))
            && moved.iter().all(|m| face(m.face) && wedge(m.from) && wedge(m.to))
            && removed.iter().all(|r| face(r.face) && r.third().is_none_or(vertex))
            && removed_wedges.iter().flatten().chain(added_wedges).all(|&w| wedge(w))
            && self.faces.iter().all(|&f| face(f))
            && self.interior.iter().all(|&v| vertex(v))
            && self.moves.iter().all(|m| vertex(m.vertex))
    }

    /// Removes the truncation points.
    pub(super) fn clear_truncation_points(&mut self) {
        self.records.truncation_points.clear();
        self.truncation_errors.clear();
    }
}
