//! Blobs that cannot be read any more: told once each, and counted.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use lodestream_protocol::source::SourceError;
use lodestream_scene::BlobId;

/// Blobs that are remembered as told; of more, none is told.
const MAX_TOLD: usize = 1024;

/// See the module. Clients ask again for what cannot be read as long as they are there: a line each time would say
/// nothing new.
#[derive(Debug, Default)]
pub(crate) struct UnreadableBlobs(Mutex<BTreeSet<BlobId>>);

impl UnreadableBlobs {
    /// Notes that a read failed; says whether the reason is a fault of the store, and not of who asked.
    pub(crate) fn note(&self, error: &SourceError) -> bool {
        let SourceError::Unreadable { id, why } = error else { return false };
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if told.len() < MAX_TOLD && told.insert(*id) {
            tracing::error!("{id} cannot be read, and is refused until it can: {why}");
        }
        true
    }
}
