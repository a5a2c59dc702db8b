//! Why a chunk cannot be applied, undone or raised.

use crate::error::DecodeError;

/// A chunk that cannot be applied or undone now. Nothing was changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RefineError {
    /// Applied already.
    #[error("chunk {0} is applied already")]
    AlreadyApplied(u32),
    /// Not applied.
    #[error("chunk {0} is not applied")]
    NotApplied(u32),
    /// There is no such chunk.
    #[error("chunk {chunk} does not exist: the asset has {count}")]
    NoSuchChunk {
        /// The chunk.
        chunk: u32,
        /// How many there are.
        count: u32,
    },
    /// A parent is missing.
    #[error("chunk {chunk} needs chunk {parent}, which is not applied")]
    MissingParent {
        /// The chunk.
        chunk: u32,
        /// Its parent.
        parent: u32,
    },
    /// A parent is applied only up to a truncation.
    #[error("chunk {chunk} needs the whole of chunk {parent}, which is applied only up to a truncation")]
    PartialParent {
        /// The chunk.
        chunk: u32,
        /// Its parent.
        parent: u32,
    },
    /// A child is still applied.
    #[error("chunk {chunk} cannot be undone: {children} chunks that need it are applied")]
    HasChildren {
        /// The chunk.
        chunk: u32,
        /// Applied chunks that name it as a parent or refer to what it brought.
        children: u32,
    },
    /// The mesh was made with [`ActiveMesh::growing`](crate::refine::active::ActiveMesh::growing).
    #[error("chunk {0} cannot be undone: this mesh only grows")]
    OnlyGrows(u32),
    /// The delta does not fit the mesh.
    #[error("chunk {0} does not fit the mesh: its data refers to what is not there")]
    Mismatch(u32),
}

/// A chunk that cannot be decoded, or not be taken on to another truncation. Nothing was changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ChunkError {
    /// Its bytes are not what the index announces.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The mesh is not as it must be for that: a parent is missing, say. The bytes may be sound.
    #[error(transparent)]
    Refine(#[from] RefineError),
}

/// For who only wants to say why: which of both it was is lost.
impl From<ChunkError> for DecodeError {
    fn from(error: ChunkError) -> Self {
        match error {
            ChunkError::Decode(error) => error,
            ChunkError::Refine(error) => Self::new("refinement", error.to_string()),
        }
    }
}
