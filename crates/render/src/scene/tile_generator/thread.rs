//! Thread that generates terrain tiles beside the drawing thread. Both directions are bounded: a new list of requests
//! replaces the previous one, and the thread waits while the queue of generated tiles is full.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;

use lodestream_terrain::Scratch;
use lodestream_terrain::tiles::{PlacedTerrain, TileId};

use super::GeneratedTile;

/// Most generated tiles that wait for the renderer: about 2 KB each.
const MAX_READY: usize = 512;

#[derive(Debug, Default)]
struct TileRequests {
    /// The terrain and its version.
    terrain: Option<(Arc<PlacedTerrain>, u64)>,
    /// Most urgent last.
    tiles: Vec<TileId>,
    stopped: bool,
}

/// Handle of the thread; dropping it stops the thread.
#[derive(Debug)]
pub struct TileGenerator {
    requests: Arc<(Mutex<TileRequests>, Condvar)>,
    ready: Option<Receiver<GeneratedTile>>,
    thread: Option<JoinHandle<()>>,
}

impl TileGenerator {
    /// Starts the thread, which calls `notify` after each tile.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub fn start(notify: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let requests = Arc::new((Mutex::new(TileRequests::default()), Condvar::new()));
        let (sender, ready) = sync_channel(MAX_READY);
        let shared = Arc::clone(&requests);
        let thread = std::thread::Builder::new()
            .name("terrain".into())
            .spawn(move || generate(&shared, &sender, &notify))?;
        Ok(Self { requests, ready: Some(ready), thread: Some(thread) })
    }

    /// Requests tiles, most urgent first, in place of all earlier requests that are not begun. `version` must grow with
    /// every change of the terrain; tiles carry it back.
    pub fn request(
        &self,
        terrain: &Arc<PlacedTerrain>,
        version: u64,
        tiles: impl DoubleEndedIterator<Item = TileId>,
    ) {
        let (requests, wake) = &*self.requests;
        let mut requests = requests.lock().unwrap_or_else(PoisonError::into_inner);
        requests.terrain = Some((Arc::clone(terrain), version));
        requests.tiles.clear();
        requests.tiles.extend(tiles.rev());
        wake.notify_one();
    }

    /// Takes the next generated tile, if there is one.
    #[must_use]
    pub fn take(&self) -> Option<GeneratedTile> {
        self.ready.as_ref()?.try_recv().ok()
    }
}

impl Drop for TileGenerator {
    fn drop(&mut self) {
        let (requests, wake) = &*self.requests;
        requests.lock().unwrap_or_else(PoisonError::into_inner).stopped = true;
        wake.notify_one();
        // The thread may be blocked on a full queue; dropping the receiver unblocks it.
        self.ready = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that generates terrain tiles panicked");
        }
    }
}

fn generate(shared: &(Mutex<TileRequests>, Condvar), ready: &SyncSender<GeneratedTile>, notify: &dyn Fn()) {
    let (requests, wake) = shared;
    let mut scratch = Scratch::new();
    loop {
        let (terrain, version, id) = {
            let mut requests = requests.lock().unwrap_or_else(PoisonError::into_inner);
            loop {
                if requests.stopped {
                    return;
                }
                if let (Some((terrain, version)), true) =
                    (requests.terrain.clone(), !requests.tiles.is_empty())
                    && let Some(id) = requests.tiles.pop()
                {
                    break (terrain, version, id);
                }
                requests = wake.wait(requests).unwrap_or_else(PoisonError::into_inner);
            }
        };
        let mut heights = Vec::new();
        terrain.heights(id, &mut scratch, &mut heights);
        if ready.send(GeneratedTile { id, heights, version }).is_err() {
            return;
        }
        notify();
    }
}
