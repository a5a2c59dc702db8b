//! Reload of scenes while the server runs: periodically, and on request.

use std::sync::Arc;
use std::time::Duration;

use futures_util::future::BoxFuture;
use lodestream_protocol::source::SceneSource;
use tokio::sync::watch;
use tokio::time::sleep;

use crate::session::state::ServerState;

/// The current scenes; `None` if none can have changed since the last call.
pub type SceneUpdate = Option<Vec<Arc<dyn SceneSource>>>;

/// A source of scenes, such as folders or object stores.
pub trait SceneProvider: Send + Sync {
    /// Time between two calls of [`load`](Self::load); `None` to reload only on request.
    fn poll_interval(&self) -> Option<Duration>;

    /// Returns all scenes if some may have changed since the last call, or if `forced`. A scene that cannot be read is
    /// returned in its last readable version.
    ///
    /// # Errors
    /// The scenes cannot be listed.
    fn load(&self, forced: bool) -> BoxFuture<'_, anyhow::Result<SceneUpdate>>;
}

/// Keeps the served scenes up to date with the provider, until the sender of `reload_requests` is dropped.
pub(crate) async fn watch_scenes(
    provider: Arc<dyn SceneProvider>,
    state: Arc<ServerState>,
    mut reload_requests: watch::Receiver<u64>,
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
            changed = reload_requests.changed() => {
                if changed.is_err() {
                    return;
                }
                true
            }
            () = pause => false,
        };
        let scenes = match provider.load(forced).await {
            Ok(Some(scenes)) => scenes,
            Ok(None) => continue,
            Err(why) => {
                tracing::error!("scenes are not reloaded: {why:#}");
                continue;
            }
        };
        match state.scenes().replace(scenes) {
            Ok(changes) if changes.is_empty() && forced => tracing::info!("scenes: unchanged"),
            Ok(changes) if changes.is_empty() => {}
            Ok(changes) => {
                state
                    .metrics()
                    .scenes_changed(changes.added.len() + changes.changed.len() + changes.removed.len());
                tracing::info!(
                    added = ?changes.added,
                    changed = ?changes.changed,
                    removed = ?changes.removed,
                    "scenes reloaded; running sessions keep their versions"
                );
            }
            Err(why) => tracing::error!("scenes are not reloaded: {why}"),
        }
    }
}
