//! Previews of scenes for the page: made at the first request, then kept with the scene's version.

use std::sync::Arc;
use std::time::Duration;

use crate::session::scene_preview::PreviewFile;
use crate::session::scenes::{SceneVersion, Scenes};

/// Longest time that a request for the page waits for a preview. Without one the page starts with the client.
const TIMEOUT: Duration = Duration::from_secs(1);

/// The preview of a scene's version, if it has one and it is there in time.
pub(crate) async fn preview(version: Arc<SceneVersion>) -> Option<Arc<PreviewFile>> {
    // A task of its own goes on after the timeout, for the next request.
    let made = tokio::spawn(async move {
        let make = || async {
            let scene = Arc::clone(&version);
            let made = tokio::task::spawn_blocking(move || PreviewFile::of(&**scene.source())).await.ok()?;
            made.inspect_err(|why| tracing::warn!("{}: no preview: {why}", version.name())).ok().map(Arc::new)
        };
        version.preview().get_or_init(make).await.clone()
    });
    tokio::time::timeout(TIMEOUT, made).await.ok()?.ok()?
}

/// The preview with a file name, if it was made for one of the scenes.
pub(crate) fn named(scenes: &Scenes, name: &str) -> Option<Arc<PreviewFile>> {
    let table = scenes.table();
    let mut made = table.versions().filter_map(|version| version.preview().get()?.clone());
    made.find(|preview| preview.name == name)
}
