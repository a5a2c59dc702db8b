//! Storage for finished levels, which a preparation reads again only while encoding. The caller supplies the storage,
//! so this crate opens no file.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Mutex, PoisonError};

/// Key of one stored result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Piece {
    /// The level, 0 for the finest.
    pub level: u32,
    /// Block of regions within the level; [`Piece::END`] for the piece that completes the level.
    pub block: u32,
}

impl Piece {
    /// Block number of the piece that completes a level.
    pub const END: u32 = u32::MAX;
    /// Level number of the pieces that complete a spatial block (meshes that are simplified block by block).
    pub const OF_BLOCKS: u32 = u32::MAX;

    /// The piece that completes a level.
    #[must_use]
    pub const fn end_of(level: u32) -> Self {
        Self { level, block: Self::END }
    }

    /// Whether the piece completes a level or a spatial block: everything that belongs to it has been stored before.
    #[must_use]
    pub const fn is_end(self) -> bool {
        self.block == Self::END || self.level == Self::OF_BLOCKS
    }

    /// The piece that completes a spatial block.
    #[must_use]
    pub const fn end_of_block(block: u32) -> Self {
        Self { level: Self::OF_BLOCKS, block }
    }
}

/// A unique name of letters, digits and a hyphen, usable as a file name.
impl fmt::Display for Piece {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.block {
            block if self.level == Self::OF_BLOCKS => write!(f, "end-{block}"),
            Self::END => write!(f, "{}-end", self.level),
            block => write!(f, "{}-{block}", self.level),
        }
    }
}

/// A checkpoint could not be stored or read back.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("checkpoint between levels: {why}")]
pub struct CheckpointError {
    /// What went wrong, and where.
    pub why: String,
}

impl CheckpointError {
    /// An error with its cause.
    pub fn new(why: impl fmt::Display) -> Self {
        Self { why: why.to_string() }
    }
}

/// Stores checkpoints. [`CheckpointStore::get`] returns what [`CheckpointStore::put`] was given for the same mesh and
/// settings, by this preparation or, if the storage is persistent, by an earlier one that was interrupted.
pub trait CheckpointStore: Sync {
    /// Whether pieces outlive the process. If so, each level is also stored with the state from which simplification
    /// continues, about 7 bytes per face of the input, and levels that are complete are not computed again.
    fn is_persistent(&self) -> bool;

    /// Stores a piece, replacing any earlier one with the same key.
    ///
    /// # Errors
    /// If it cannot be stored.
    fn put(&self, piece: Piece, bytes: Vec<u8>) -> Result<(), CheckpointError>;

    /// Reads a piece; `None` if there is none or it is incomplete.
    ///
    /// # Errors
    /// If the storage cannot be read.
    fn get(&self, piece: Piece) -> Result<Option<Vec<u8>>, CheckpointError>;
}

/// Stores pieces in memory.
#[derive(Debug, Default)]
pub struct InMemoryCheckpoint(Mutex<BTreeMap<Piece, Vec<u8>>>);

impl CheckpointStore for InMemoryCheckpoint {
    fn is_persistent(&self) -> bool {
        false
    }

    fn put(&self, piece: Piece, bytes: Vec<u8>) -> Result<(), CheckpointError> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(piece, bytes);
        Ok(())
    }

    fn get(&self, piece: Piece) -> Result<Option<Vec<u8>>, CheckpointError> {
        Ok(self.0.lock().unwrap_or_else(PoisonError::into_inner).get(&piece).cloned())
    }
}
