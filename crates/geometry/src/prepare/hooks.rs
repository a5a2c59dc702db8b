//! Callbacks of a preparation.

use crate::checkpoint::CheckpointStore;
use crate::codec::source::Source;
use crate::error::DecodeError;
use crate::pool::{Monitor, Pool};
use crate::refine::ActiveMesh;

/// Converts a payload to the bytes that are stored and sent, for example by compressing it.
pub type Store<'a> = &'a (dyn Fn(Vec<u8>) -> Result<Vec<u8>, DecodeError> + Sync);
/// Called with each chunk just before it is encoded.
pub(crate) type Observer<'a> = &'a (dyn Fn(&ActiveMesh, u32, &Source<'_>) + Sync);

/// Callbacks of a preparation: threads, progress, storage of payloads, checkpoints.
#[derive(Clone, Copy)]
pub struct Hooks<'a> {
    pub(super) pool: &'a dyn Pool,
    pub(super) monitor: &'a dyn Monitor,
    pub(super) store: Store<'a>,
    pub(super) observe: Observer<'a>,
    pub(super) checkpoint: Option<&'a dyn CheckpointStore>,
}

impl std::fmt::Debug for Hooks<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hooks").finish_non_exhaustive()
    }
}

impl<'a> Hooks<'a> {
    /// Runs on `pool`, reports to `monitor`, and stores payloads unchanged.
    #[must_use]
    pub fn new(pool: &'a dyn Pool, monitor: &'a dyn Monitor) -> Self {
        Self { pool, monitor, store: &Ok, observe: &|_, _, _| {}, checkpoint: None }
    }

    /// Passes each payload through `store`; the index states the lengths of the results.
    #[must_use]
    pub fn with_store(self, store: Store<'a>) -> Self {
        Self { store, ..self }
    }

    /// Stores finished levels in `checkpoint` instead of memory: 37 to 65 bytes per face. The result does not depend
    /// on it.
    #[must_use]
    pub fn with_checkpoints(self, checkpoint: &'a dyn CheckpointStore) -> Self {
        Self { checkpoint: Some(checkpoint), ..self }
    }

    /// Calls `observe` with each chunk before it is encoded.
    pub(crate) fn with_observer(self, observe: Observer<'a>) -> Self {
        Self { observe, ..self }
    }
}
