//! Errors of the crate.

#[cfg(feature = "prepare")]
use crate::checkpoint::CheckpointError;
#[cfg(feature = "prepare")]
use crate::simplify::settings::SettingsError;

/// Bytes or values that do not form what they should.
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

/// A mesh that cannot be prepared, with the reason.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// No face remains after degenerate faces are dropped.
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
    /// Skins that are not as many as positions, or poses without a map for each joint.
    #[error("the mesh's skins or poses do not fit its positions and joints")]
    BadSkins,
    /// A face refers to an element that does not exist.
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
    /// More elements than ids can number.
    #[error("the mesh has {count} {kind}; at most {limit} are supported")]
    TooLarge {
        /// "faces", "positions" or "materials".
        kind: &'static str,
        /// How many there are.
        count: usize,
        /// How many are supported.
        limit: usize,
    },
    /// A setting out of range.
    #[cfg(feature = "prepare")]
    #[error(transparent)]
    BadSetting(#[from] SettingsError),
    /// An impossible number of bits or tolerance.
    #[error("position precision: {why}")]
    BadPrecision {
        /// What is wrong with it.
        why: String,
    },
    /// Preparation violated an invariant of the format: a bug in this crate.
    #[error("preparation failed: {why}; please report this with the mesh")]
    Internal {
        /// What went wrong.
        why: String,
    },
    /// The checkpoint store failed.
    #[cfg(feature = "prepare")]
    #[error(transparent)]
    CheckpointStore(#[from] CheckpointError),
    /// The thread pool left out a task.
    #[error(transparent)]
    SkippedTask(#[from] SkippedTask),
    /// Preparation was cancelled.
    #[error("preparation was cancelled")]
    Cancelled,
}

/// A pool returned before all its tasks were done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the pool of threads left out task {task} of {count}: it must run each exactly once")]
pub struct SkippedTask {
    /// The first task without a result.
    pub task: usize,
    /// How many there were.
    pub count: usize,
}
