//! Errors of applying, undoing and raising chunks.

use crate::error::DecodeError;

/// A chunk cannot be applied or undone. The mesh is unchanged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RefineError {
    /// The chunk is already applied.
    #[error("chunk {0} is applied already")]
    AlreadyApplied(u32),
    /// The chunk is not applied.
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
    /// A parent is applied up to a truncation point only.
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
        /// Number of applied chunks that depend on it.
        children: u32,
    },
    /// The mesh keeps no undo records ([`ActiveMesh::growing`](crate::refine::active::ActiveMesh::growing)).
    #[error("chunk {0} cannot be undone: this mesh only grows")]
    OnlyGrows(u32),
    /// The delta does not fit the mesh.
    #[error("chunk {0} does not fit the mesh: its data refers to what is not there")]
    Mismatch(u32),
}

/// A chunk cannot be decoded or raised. The mesh is unchanged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ChunkError {
    /// The payload does not match the index.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The mesh is in the wrong state, for example a parent is missing. The payload may be valid.
    #[error(transparent)]
    Refine(#[from] RefineError),
}

/// Keeps the message only.
impl From<ChunkError> for DecodeError {
    fn from(error: ChunkError) -> Self {
        match error {
            ChunkError::Decode(error) => error,
            ChunkError::Refine(error) => Self::new("refinement", error.to_string()),
        }
    }
}
