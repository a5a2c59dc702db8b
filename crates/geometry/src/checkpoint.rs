//! How the pure crate borrows storage: what a preparation needs again only when it encodes is put away where its
//! caller says.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Mutex, PoisonError};

/// What is put away and fetched as one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Piece {
    /// The level, 0 for the finest.
    pub level: u32,
    /// Which of the level's blocks of regions; [`Piece::END`] for what closes the level.
    pub block: u32,
}

impl Piece {
    /// Stands for what is put away once all blocks of a level are.
    pub const END: u32 = u32::MAX;
    /// Stands for the level of what closes a spatial block, of meshes that are simplified block after block.
    pub const OF_BLOCKS: u32 = u32::MAX;

    /// What closes a level.
    #[must_use]
    pub const fn end_of(level: u32) -> Self {
        Self { level, block: Self::END }
    }

    /// Whether it closes a level or a block: all that belongs to that was put away before.
    #[must_use]
    pub const fn closes(self) -> bool {
        self.block == Self::END || self.level == Self::OF_BLOCKS
    }

    /// What closes a spatial block.
    #[must_use]
    pub const fn end_of_block(block: u32) -> Self {
        Self { level: Self::OF_BLOCKS, block }
    }
}

/// A name that no other piece has, of letters, digits and a hyphen.
impl fmt::Display for Piece {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.block {
            block if self.level == Self::OF_BLOCKS => write!(f, "end-{block}"),
            Self::END => write!(f, "{}-end", self.level),
            block => write!(f, "{}-{block}", self.level),
        }
    }
}

/// Storage that does not keep what it is given, or cannot give it back.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("what is put away between levels: {why}")]
pub struct CheckpointError {
    /// What went wrong, and where.
    pub why: String,
}

impl CheckpointError {
    /// An error that says why.
    pub fn new(why: impl fmt::Display) -> Self {
        Self { why: why.to_string() }
    }
}

/// Keeps pieces. What [`CheckpointStore::get`] answers must be what [`CheckpointStore::put`] was given for the same mesh and settings, by
/// this preparation or, where there is storage that lasts, by one before it that was ended early.
pub trait CheckpointStore: Sync {
    /// Whether pieces outlive the process. Then a level is closed with what it takes to go on from it, about 7 bytes a
    /// face of the input; and what is closed already is not done again.
    fn lasts(&self) -> bool;

    /// Keeps a piece, in place of what was there under its name.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn put(&self, piece: Piece, bytes: Vec<u8>) -> Result<(), CheckpointError>;

    /// A piece, or `None` where there is none that is whole.
    ///
    /// # Errors
    /// Where it cannot be said.
    fn get(&self, piece: Piece) -> Result<Option<Vec<u8>>, CheckpointError>;
}

/// Keeps pieces in memory.
#[derive(Debug, Default)]
pub struct InMemoryCheckpoint(Mutex<BTreeMap<Piece, Vec<u8>>>);

impl CheckpointStore for InMemoryCheckpoint {
    fn lasts(&self) -> bool {
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
