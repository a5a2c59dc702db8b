//! Scenes that are looked for again while the server runs: now and then, and when that is asked for.

use std::sync::Arc;
use std::time::Duration;

use futures_util::future::BoxFuture;
use lodestream_protocol::source::SceneSource;
use tokio::sync::watch;
use tokio::time::sleep;

use crate::session::state::ServerState;

/// Scenes that there are, where they may have changed.
pub type SceneUpdate = Option<Vec<Arc<dyn SceneSource>>>;

/// Where scenes come from.
pub trait SceneProvider: Send + Sync {
    /// Time between two looks; `None` where looks must be asked for.
    fn poll_interval(&self) -> Option<Duration>;

    /// All scenes as they are now, if some may have changed since the last time, or if `asked`. One that cannot be read is
    /// the one that was there before.
    ///
    /// # Errors
    /// Fails where it cannot be said which scenes there are.
    fn load(&self, forced: bool) -> BoxFuture<'_, anyhow::Result<SceneUpdate>>;
}

/// Serves what the provider finds. Goes on for ever.
pub(crate) async fn watch_scenes(
    provider: Arc<dyn SceneProvider>,
    state: Arc<ServerState>,
    mut asked: watch::Receiver<u64>,
) {
    loop {
        let pause = async {
            match provider.poll_interval() {
                Some(pause) => sleep(pause).await,
                None => std::future::pending().await,
            }
        };
        let forced = tokio::select! {
            biased;
            changed = asked.changed() => {
                if changed.is_err() {
                    return;
                }
                true
            }
            () = pause => false,
        };
        let found = match provider.load(forced).await {
            Ok(Some(found)) => found,
            Ok(None) => continue,
            Err(why) => {
                tracing::error!("scenes stay as they are: {why:#}");
                continue;
            }
        };
        match state.scenes().replace(found) {
            Ok(done) if done.is_nothing() && forced => tracing::info!("scenes: as before"),
            Ok(done) if done.is_nothing() => {}
            Ok(done) => {
                state.metrics().scenes_exchanged(done.added.len() + done.changed.len() + done.removed.len());
                tracing::info!(
                    added = ?done.added,
                    changed = ?done.changed,
                    removed = ?done.removed,
                    "scenes were exchanged; sessions go on with what they have"
                );
            }
            Err(why) => tracing::error!("scenes stay as they are: {why}"),
        }
    }
}
