//! What a client must know of a chunk before it asks for it: the chunk index.

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

/// A stopping point inside a chunk: what is there once the first `payload_bytes` of the payload are
/// decoded and applied. Legal only while no chunk that has this one as a parent is applied.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct TruncationPoint {
    /// Bytes of the payload that suffice to decode up to here.
    pub payload_bytes: u32,
    /// Geometric error of the region once the chunk is applied up to here, in the asset's units: never
    /// below that of a chunk that has this one as a parent, and nearly always below the chunk's own (a
    /// truncation where it is not is of no use).
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
    /// Level that the chunk leads to; level 0 is the base mesh, so this is at least 1.
    pub level: u8,
    /// Bounds of the region's input surface and of its coarse surface.
    pub sphere: Sphere,
    /// Geometric error while the chunk is missing, in the asset's units. Never smaller than that of
    /// any chunk that has this one as a parent.
    pub error: f32,
    /// How far attributes slide while the chunk is missing, as a length in the asset's units
    /// (docs/design/errors.md): texture over the surface, and shading. Monotone like `error`.
    pub attribute_error: f32,
    /// Stopping points before the chunk's end, coarse to fine.
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
    /// What is there once the chunk is applied up to a truncation, an index of [`Self::truncation_points`]; `None`, or a
    /// truncation that it has not, stands for the whole chunk, whose error is 0: what is then left is its
    /// children's.
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
    /// The largest visible error (all attributes counted) of the chunks on later pages; `None` where
    /// [`expected_rest_error`](crate::index::expected_rest_error) of this page and those before it is not below that.
    pub rest_error: Option<f32>,
}

impl From<Vec<ChunkInfo>> for IndexPage {
    fn from(chunks: Vec<ChunkInfo>) -> Self {
        Self { chunks, rest_error: None }
    }
}

/// The number of pages that `chunks` entries fill.
#[must_use]
pub fn page_count(chunks: usize) -> usize {
    chunks.div_ceil(CHUNKS_PER_PAGE)
}

/// Most parents of one chunk: bounds a decoder's memory.
pub const MAX_PARENTS: usize = 4096;
/// Most stopping points before a chunk's end.
pub const MAX_TRUNCATION_POINTS: usize = 63;
