//! A session's reads that take their time: done by futures of the store or on threads that may wait, while the session
//! goes on.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use bytes::Bytes;
use futures_util::FutureExt as _;
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::BlobId;
use tokio::task::JoinSet;

/// See the module. Dropped, it forgets what is under way: threads that read end by themselves.
pub(crate) struct Reads {
    scene: Arc<dyn SceneSource>,
    tasks: JoinSet<(BlobId, Result<Bytes, SourceError>)>,
}

impl Reads {
    pub(crate) fn new(scene: Arc<dyn SceneSource>) -> Self {
        Self { scene, tasks: JoinSet::new() }
    }

    /// Begins a read. The session bounds how many there are.
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
            // A store that panics must not leave the session waiting for ever.
            let read = catch_unwind(AssertUnwindSafe(|| scene.read(&id)));
            (id, read.unwrap_or_else(|_| Err(failed(id))))
        });
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.tasks.is_empty()
    }

    /// The next read that is done; `None` where none is under way. May be dropped before it resolves.
    pub(crate) async fn next(&mut self) -> Option<(BlobId, Result<Bytes, SourceError>)> {
        loop {
            // Tasks fail only where the runtime goes down.
            if let Ok(done) = self.tasks.join_next().await? {
                return Some(done);
            }
        }
    }
}

fn failed(id: BlobId) -> SourceError {
    SourceError::Unreadable { id, why: "the store panicked".into() }
}
