//! What a client must know of a chunk before it asks for it: the chunk index.

use crate::DecodeError;

/// Chunks per index page.
pub const CHUNKS_PER_PAGE: usize = 64;

/// A bounding sphere, in the asset's units, relative to the asset's own origin.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Sphere {
    /// Centre.
    pub center: [f32; 3],
    /// Radius.
    pub radius: f32,
}

/// One chunk's entry in the index. Chunks are numbered coarse to fine: parents have smaller ids.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ChunkInfo {
    /// Level that the chunk leads to; level 0 is the base mesh, so this is at least 1.
    pub level: u8,
    /// Bounds of the region's input surface and of its coarse surface.
    pub sphere: Sphere,
    /// Geometric error while the chunk is missing, in the asset's units. Never smaller than that of
    /// any chunk that has this one as a parent.
    pub error: f32,
    /// Ids of the chunks that must be applied before this one, ascending.
    pub parents: Vec<u32>,
    /// Bytes of the payload.
    pub payload_bytes: u32,
    /// Vertices that the chunk adds (its vertex splits).
    pub vertices: u32,
    /// Wedges that the chunk adds.
    pub wedges: u32,
    /// Faces that the chunk adds.
    pub faces: u32,
}

/// The number of pages that `chunks` entries fill.
#[must_use]
pub fn page_count(chunks: usize) -> usize {
    chunks.div_ceil(CHUNKS_PER_PAGE)
}

/// Decodes one index page, as sent on the wire.
///
/// `first` is the id of the page's first chunk (`page × CHUNKS_PER_PAGE`).
///
/// # Errors
/// Refuses truncated pages, counts beyond [`CHUNKS_PER_PAGE`], parents that are not older than their
/// child, and values that are not finite.
pub fn decode_page(bytes: &[u8], first: u32) -> Result<Vec<ChunkInfo>, DecodeError> {
    let _ = (bytes, first);
    Err(DecodeError::new("index page", "not implemented"))
}
