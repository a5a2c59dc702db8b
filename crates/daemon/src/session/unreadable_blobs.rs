//! Log of blobs that cannot be read: one line per blob.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use lodestream_protocol::source::SourceError;
use lodestream_scene::BlobId;

/// Most blobs that are logged.
const MAX_LOGGED: usize = 1024;

/// The blobs that were logged. Clients repeat requests for unreadable blobs, so each blob is logged once.
#[derive(Debug, Default)]
pub(crate) struct UnreadableBlobs(Mutex<BTreeSet<BlobId>>);

impl UnreadableBlobs {
    /// Logs a failed read; returns whether the store is at fault rather than the request.
    pub(crate) fn note(&self, error: &SourceError) -> bool {
        let SourceError::Unreadable { id, why } = error else { return false };
        let mut logged = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if logged.len() < MAX_LOGGED && logged.insert(*id) {
            tracing::error!("{id} cannot be read and is refused until it can: {why}");
        }
        true
    }
}
