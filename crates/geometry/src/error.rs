//! Error values of the crate: what was wrong, and where.

#[cfg(feature = "prepare")]
use crate::checkpoint::CheckpointError;
#[cfg(feature = "prepare")]
use crate::simplify::settings::SettingsError;

/// Bytes or values that cannot be what they claim to be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: {why}")]
pub struct DecodeError {
    /// What was being read ("index page", "chunk 17", …).
    pub what: String,
    /// Why it cannot be used.
    pub why: String,
}

impl DecodeError {
    /// An error about `what`.
    pub fn new(what: impl Into<String>, why: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.into() }
    }
}

/// A mesh that cannot be prepared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// No face is left after degenerate faces are dropped.
    #[error("the mesh has no usable face ({dropped} degenerate faces were dropped)")]
    NoFaces {
        /// Faces with repeated vertices.
        dropped: usize,
    },
    /// A coordinate that is not a finite number of at most f32 range.
    #[error("position {index} has the coordinate {value}, which is not a finite 32-bit number")]
    BadCoordinate {
        /// Index of the position.
        index: usize,
        /// The value.
        value: f64,
    },
    /// A texture coordinate that is not finite.
    #[error("texture coordinate {index} is not finite")]
    BadUv {
        /// Index of the texture coordinate.
        index: usize,
    },
    /// A face that refers to something that is not there.
    #[error("face {face} refers to {kind} {index}, but there are only {count}")]
    BadIndex {
        /// Index of the face.
        face: usize,
        /// "position", "uv" or "normal".
        kind: &'static str,
        /// The index.
        index: u32,
        /// How many there are.
        count: usize,
    },
    /// More of something than ids can number.
    #[error("the mesh has {count} {kind}; at most {limit} are supported")]
    TooLarge {
        /// "faces", "positions" or "materials".
        kind: &'static str,
        /// How many there are.
        count: usize,
        /// How many are supported.
        limit: usize,
    },
    /// A setting that is out of its range.
    #[cfg(feature = "prepare")]
    #[error(transparent)]
    BadSetting(#[from] SettingsError),
    /// Bits or a tolerance that cannot be had.
    #[error("position precision: {why}")]
    BadPrecision {
        /// What is wrong with it.
        why: String,
    },
    /// A promise of the format that preparation could not keep: a defect of this program.
    #[error("preparation failed: {why}; please report this with the mesh")]
    Internal {
        /// What went wrong.
        why: String,
    },
    /// Storage does not keep what is put away between levels.
    #[cfg(feature = "prepare")]
    #[error(transparent)]
    CheckpointStore(#[from] CheckpointError),
    /// The pool of threads does not keep its promise.
    #[error(transparent)]
    SkippedTask(#[from] SkippedTask),
    /// Preparation was cancelled.
    #[error("preparation was cancelled")]
    Cancelled,
}

/// A pool that returned before all its tasks were done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the pool of threads left out task {task} of {count}: it must run each exactly once")]
pub struct SkippedTask {
    /// The first task without a result.
    pub task: usize,
    /// How many there were.
    pub count: usize,
}
