//! The chunk index: metadata of each chunk.

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

/// A truncation point of a chunk: the state after the first `payload_bytes` of the payload are decoded and applied.
/// Valid only while no child of the chunk is applied.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct TruncationPoint {
    /// Bytes of the payload to decode.
    pub payload_bytes: u32,
    /// Geometric error of the region at this point, in the asset's units. Never below that of the chunk's children,
    /// and nearly always below the chunk's own (otherwise the point is useless).
    pub error: f32,
    /// Vertices added up to here.
    pub vertices: u32,
    /// Wedges added up to here.
    pub wedges: u32,
    /// Faces added up to here.
    pub faces: u32,
}

/// One chunk's entry in the index. Chunks are numbered coarse to fine: parents have smaller ids.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ChunkInfo {
    /// Level that the chunk leads to; at least 1, since level 0 is the base mesh.
    pub level: u8,
    /// Bounds of the region's input surface and of its coarse surface.
    pub sphere: Sphere,
    /// Geometric error while the chunk is missing, in the asset's units. At least that of each of its children.
    pub error: f32,
    /// Attribute error while the chunk is missing (texture displacement over the surface and shading), as a length in
    /// the asset's units (docs/design/errors.md). Monotone like `error`.
    pub attribute_error: f32,
    /// Truncation points before the chunk's end, coarse to fine.
    pub truncation_points: Vec<TruncationPoint>,
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

impl ChunkInfo {
    /// The state at a truncation point (an index of [`Self::truncation_points`]). For `None` or an index out of
    /// range, the whole chunk, with error 0: the remaining error is that of its children.
    #[must_use]
    pub fn extent(&self, truncation: Option<u8>) -> TruncationPoint {
        let whole = TruncationPoint {
            payload_bytes: self.payload_bytes,
            error: 0.0,
            vertices: self.vertices,
            wedges: self.wedges,
            faces: self.faces,
        };
        truncation
            .and_then(|truncation| self.truncation_points.get(usize::from(truncation)))
            .copied()
            .unwrap_or(whole)
    }
}

/// One page of the index.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct IndexPage {
    /// Its chunks.
    pub chunks: Vec<ChunkInfo>,
    /// The largest visible error (attributes at full weight) of the chunks on later pages; `None` if it does not
    /// exceed [`expected_rest_error`](crate::index::expected_rest_error) of the pages up to this one.
    pub rest_error: Option<f32>,
}

impl From<Vec<ChunkInfo>> for IndexPage {
    fn from(chunks: Vec<ChunkInfo>) -> Self {
        Self { chunks, rest_error: None }
    }
}

/// Number of pages for `chunks` entries.
#[must_use]
pub fn page_count(chunks: usize) -> usize {
    chunks.div_ceil(CHUNKS_PER_PAGE)
}

/// Most parents of one chunk: bounds a decoder's memory.
pub const MAX_PARENTS: usize = 4096;
/// Most truncation points per chunk.
pub const MAX_TRUNCATION_POINTS: usize = 63;
