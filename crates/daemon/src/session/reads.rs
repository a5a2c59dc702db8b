//! Reads of blobs that are not in memory, as futures of the store or on blocking threads, beside the session's loop.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use bytes::Bytes;
use futures_util::FutureExt as _;
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::BlobId;
use tokio::task::JoinSet;

/// The reads of one session. Dropping it abandons them; blocking threads finish by themselves.
pub(crate) struct Reads {
    scene: Arc<dyn SceneSource>,
    tasks: JoinSet<(BlobId, Result<Bytes, SourceError>)>,
}

impl Reads {
    /// No reads yet.
    pub(crate) fn new(scene: Arc<dyn SceneSource>) -> Self {
        Self { scene, tasks: JoinSet::new() }
    }

    /// Starts a read. The session bounds their number.
    pub(crate) fn begin(&mut self, id: BlobId) {
        if let Some(fetched) = self.scene.fetch(&id) {
            self.tasks.spawn(async move {
                let fetched = AssertUnwindSafe(fetched).catch_unwind().await;
                (id, fetched.unwrap_or_else(|_| Err(failed(id))))
            });
            return;
        }
        let scene = Arc::clone(&self.scene);
        self.tasks.spawn_blocking(move || {
            // A panic in the store must not leave the session waiting forever.
            let read = catch_unwind(AssertUnwindSafe(|| scene.read(&id)));
            (id, read.unwrap_or_else(|_| Err(failed(id))))
        });
    }

    /// Whether no read is under way.
    pub(crate) fn is_empty(&self) -> bool {
        self.tasks.is_empty()
    }

    /// The next finished read; `None` if none is under way. Cancel safe.
    pub(crate) async fn next(&mut self) -> Option<(BlobId, Result<Bytes, SourceError>)> {
        loop {
            // Tasks fail only when the runtime shuts down.
            if let Ok(done) = self.tasks.join_next().await? {
                return Some(done);
            }
        }
    }
}

fn failed(id: BlobId) -> SourceError {
    SourceError::Unreadable { id, why: "the store panicked".into() }
}
