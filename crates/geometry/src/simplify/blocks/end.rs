//! The remaining mesh of a block after its levels, and its serialisation for resuming interrupted runs.

use crate::entropy::bytes::Reader;
use crate::error::DecodeError;
use crate::mesh::Wedge;
use crate::simplify::hierarchy::Bounds;
use crate::simplify::packed::{halves, list, put, put_wedges, real, wedges};

/// Version of the layout.
const LAYOUT: u32 = 2;

/// The remaining mesh of one or several blocks, in the complete mesh's ids.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct BlockEnd {
    /// Remaining faces, their wedges, and the error around them [geometric, attributes] in grid cells.
    pub(super) faces: Vec<u32>,
    pub(super) corners: Vec<[u32; 3]>,
    pub(super) errors: Vec<[f32; 2]>,
    /// Wedges added by collapses.
    pub(crate) added: Vec<Wedge>,
    /// Error of regions that vanished.
    pub(super) stray_error: f64,
    /// Number of chunks in each stored piece, by level.
    pub(crate) pieces: Vec<Vec<u32>>,
}

impl BlockEnd {
    /// Appends another block's remaining mesh.
    pub(super) fn append(&mut self, other: Self) {
        self.faces.extend(other.faces);
        self.corners.extend(other.corners);
        self.errors.extend(other.errors);
        self.added.extend(other.added);
        self.stray_error = self.stray_error.max(other.stray_error);
    }

    pub(crate) fn pack(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(24 * self.faces.len() + 28 * self.added.len() + 256);
        let [low, high] = halves(self.stray_error);
        put(&mut out, &[LAYOUT, self.pieces.len() as u32, low, high], |&x| [x]);
        self.pieces.iter().for_each(|level| put(&mut out, level, |&x| [x]));
        put(&mut out, &self.faces, |&face| [face]);
        put(&mut out, &self.corners, |&corners| corners);
        put(&mut out, &self.errors, |errors| errors.map(f32::to_bits));
        put_wedges(&mut out, &self.added);
        out
    }

    /// Whether it has `levels` levels and all its references are within bounds.
    pub(crate) fn fits(&self, bounds: Bounds, levels: usize) -> bool {
        self.pieces.len() == levels
            && self.faces.iter().all(|&f| (f as usize) < bounds.faces)
            && self.corners.iter().flatten().all(|&w| (w as usize) < bounds.wedges)
            && self.added.iter().all(|wedge| (wedge.vertex as usize) < bounds.vertices)
    }

    /// Parses the result of [`Self::pack`]; `None` if another version wrote it.
    ///
    /// # Errors
    /// If the bytes are damaged.
    pub(crate) fn unpack(bytes: &[u8]) -> Result<Option<Self>, DecodeError> {
        let mut r = Reader::new(bytes, "the end of a block");
        let head = list(&mut r, |[x]| x)?;
        let &[LAYOUT, levels, low, high] = head.as_slice() else { return Ok(None) };
        let pieces = (0..levels).map(|_| list(&mut r, |[x]| x)).collect::<Result<_, _>>()?;
        let faces = list(&mut r, |[face]| face)?;
        let corners = list(&mut r, |corners| corners)?;
        let errors = list(&mut r, |errors: [u32; 2]| errors.map(f32::from_bits))?;
        let added = wedges(&mut r)?;
        if [corners.len(), errors.len()] != [faces.len(); 2] {
            return Err(r.error("its lists have inconsistent lengths"));
        }
        Ok(Some(Self { faces, corners, errors, added, stray_error: real([low, high]), pieces }))
    }
}
