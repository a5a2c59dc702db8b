//! Previews of scenes for the page: made at the first request, then kept with the scene's version.

use std::sync::Arc;
use std::time::Duration;

use crate::session::scene_preview::{NoPreview, PreviewFile};
use crate::session::scenes::{SceneVersion, Scenes};

/// Longest time that a request for the page waits for a preview. Without one the page starts with the client.
const TIMEOUT: Duration = Duration::from_secs(1);

/// The preview of a scene's version, if it has one and it is there in time.
pub(crate) async fn preview(version: Arc<SceneVersion>) -> Option<Arc<PreviewFile>> {
    if let Some(made) = version.preview().get() {
        return made.clone();
    }
    // A task of its own goes on after the timeout, for the next request.
    let made =
        tokio::spawn(async move { version.preview().get_or_try_init(|| make(&version)).await.ok().cloned() });
    tokio::time::timeout(TIMEOUT, made).await.ok()?.ok()??
}

/// Makes a preview; `None` if the scene cannot have one. A store that does not answer is asked again by the next request.
async fn make(version: &SceneVersion) -> Result<Option<Arc<PreviewFile>>, ()> {
    let source = Arc::clone(version.source());
    let made = tokio::task::spawn_blocking(move || PreviewFile::of(&*source)).await.map_err(drop)?;
    let made = made.inspect_err(|why| tracing::warn!("{}: no preview: {why}", version.name()));
    match made {
        Ok(preview) => Ok(Some(Arc::new(preview))),
        Err(NoPreview::Scene(_)) => Ok(None),
        Err(NoPreview::Source(_)) => Err(()),
    }
}

/// The preview with a file name, if it was made for one of the scenes.
pub(crate) fn named(scenes: &Scenes, name: &str) -> Option<Arc<PreviewFile>> {
    let table = scenes.table();
    let mut made = table.versions().filter_map(|version| version.preview().get()?.clone());
    made.find(|preview| preview.name == name)
}
