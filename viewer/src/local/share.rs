//! `--share`: the scene of local files for other viewers, by the daemon that `lodestream-server serve` runs.

use std::future::Future;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context as _;
use lodestream_daemon::{
    Daemon, DaemonOptions, PageSetting, SceneProvider, SceneUpdate, Scenes, StopRequests,
};
use lodestream_protocol::source::SceneSource;
use lodestream_store::{BlobCache, DEFAULT_CACHE_BYTES, Objects, SceneStore};
use tokio::runtime::Runtime;

/// A daemon that serves one scene.
pub(super) struct Share {
    address: SocketAddr,
    /// Folder of the development certificate.
    state_folder: PathBuf,
    blobs: BlobCache,
    runtime: Runtime,
    running: Option<Running>,
}

struct Running {
    newest: Arc<NewestScene>,
    reload: Box<dyn Fn() + Send>,
}

impl Share {
    /// Prepares to serve at an address; nothing is served yet.
    pub(super) fn new(address: SocketAddr, state_folder: &Path) -> anyhow::Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let blobs = BlobCache::new(DEFAULT_CACHE_BYTES);
        Ok(Self { address, state_folder: state_folder.to_owned(), blobs, runtime, running: None })
    }

    /// Serves the published scene in a file instead of the last one. Returns the addresses for other viewers, the first
    /// time.
    ///
    /// # Errors
    /// The scene cannot be read, or the address cannot be bound.
    pub(super) fn serve(&mut self, scene: &Path) -> anyhow::Result<Vec<String>> {
        let folder = scene.parent().unwrap_or(Path::new("."));
        let name = scene.file_name().unwrap_or_default().to_string_lossy();
        let objects = Objects::of_folder(folder)?;
        let store = self.runtime.block_on(SceneStore::open(&objects, &name, &self.blobs))?;
        let store: Arc<dyn SceneSource> = Arc::new(store);
        if let Some(running) = &self.running {
            *running.newest.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(store);
            (running.reload)();
            return Ok(Vec::new());
        }
        let newest = Arc::new(NewestScene::default());
        let options = DaemonOptions {
            listen: Some(self.address),
            http: Some(self.address),
            page: PageSetting::installed()?,
            provider: Some(Arc::clone(&newest) as Arc<dyn SceneProvider>),
            ..DaemonOptions::new(&self.state_folder)
        };
        let bind = Daemon::bind(options, Scenes::one(store));
        let daemon = self.runtime.block_on(bind).with_context(|| format!("--share {}", self.address))?;
        let urls = [daemon.urls(), daemon.page_urls()].concat();
        self.running = Some(Running { newest, reload: Box::new(daemon.reload()) });
        self.runtime.spawn(async move {
            if let Err(why) = daemon.serve(UntilTheEnd).await {
                tracing::warn!("the scene is not shared any more: {why:#}");
            }
        });
        Ok(urls)
    }
}

/// The scene that has changed, until the daemon takes it.
#[derive(Default)]
struct NewestScene(Mutex<Option<Arc<dyn SceneSource>>>);

impl SceneProvider for NewestScene {
    fn poll_interval(&self) -> Option<Duration> {
        None
    }

    fn load(&self, _forced: bool) -> Pin<Box<dyn Future<Output = anyhow::Result<SceneUpdate>> + Send + '_>> {
        let newest = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        Box::pin(std::future::ready(Ok(newest.map(|scene| vec![scene]))))
    }
}

/// The daemon ends with the program.
struct UntilTheEnd;

impl StopRequests for UntilTheEnd {
    async fn next(&mut self) {
        std::future::pending().await
    }
}
