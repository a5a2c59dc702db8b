//! The thread that makes tiles, away from the one that draws. Both sides are bounded: the newest wish replaces what
//! was wished before, and finished tiles wait until there is room.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;

use lodestream_terrain::Scratch;

use super::placed_terrain::PlacedTerrain;
use super::tile::TileId;

/// Finished tiles that may wait for the renderer: some 2 KB each.
const MAX_READY: usize = 512;

/// A tile's heights, rows of [`super::TILE_SAMPLES`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Which.
    pub id: TileId,
    /// Heights in height units, margin included.
    pub heights: Vec<i32>,
    /// State of the ground that it was made from: [`TileGenerator::wish`].
    pub state: u64,
}

#[derive(Debug, Default)]
struct TileRequests {
    /// The ground, and the number of its state.
    ground: Option<(Arc<PlacedTerrain>, u64)>,
    /// Last first.
    tiles: Vec<TileId>,
    ended: bool,
}

/// Handle of the thread; dropping it ends it.
#[derive(Debug)]
pub struct TileGenerator {
    wishes: Arc<(Mutex<TileRequests>, Condvar)>,
    ready: Option<Receiver<Tile>>,
    thread: Option<JoinHandle<()>>,
}

impl TileGenerator {
    /// Starts the thread. `notify` is called on it after each tile.
    ///
    /// # Errors
    /// Fails where the system gives no thread.
    pub fn start(notify: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        let wishes = Arc::new((Mutex::new(TileRequests::default()), Condvar::new()));
        let (sender, ready) = sync_channel(MAX_READY);
        let shared = Arc::clone(&wishes);
        let thread = std::thread::Builder::new()
            .name("terrain".into())
            .spawn(move || make(&shared, &sender, &notify))?;
        Ok(Self { wishes, ready: Some(ready), thread: Some(thread) })
    }

    /// What is to be made, first first, of a ground whose state has a number that grows with every change. Replaces
    /// what was wished before and is not begun.
    pub fn wish(
        &self,
        ground: &Arc<PlacedTerrain>,
        state: u64,
        tiles: impl DoubleEndedIterator<Item = TileId>,
    ) {
        let (wishes, woken) = &*self.wishes;
        let mut wishes = wishes.lock().unwrap_or_else(PoisonError::into_inner);
        wishes.ground = Some((Arc::clone(ground), state));
        wishes.tiles.clear();
        wishes.tiles.extend(tiles.rev());
        woken.notify_one();
    }

    /// A finished tile, if there is one.
    #[must_use]
    pub fn take(&self) -> Option<Tile> {
        self.ready.as_ref()?.try_recv().ok()
    }
}

impl Drop for TileGenerator {
    fn drop(&mut self) {
        let (wishes, woken) = &*self.wishes;
        wishes.lock().unwrap_or_else(PoisonError::into_inner).ended = true;
        woken.notify_one();
        // The thread may wait for room: without a receiver it does not.
        self.ready = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the terrain's thread panicked");
        }
    }
}

fn make(shared: &(Mutex<TileRequests>, Condvar), ready: &SyncSender<Tile>, notify: &dyn Fn()) {
    let (wishes, woken) = shared;
    let mut scratch = Scratch::new();
    loop {
        let (ground, state, id) = {
            let mut wishes = wishes.lock().unwrap_or_else(PoisonError::into_inner);
            loop {
                if wishes.ended {
                    return;
                }
                if let (Some((ground, state)), true) = (wishes.ground.clone(), !wishes.tiles.is_empty())
                    && let Some(id) = wishes.tiles.pop()
                {
                    break (ground, state, id);
                }
                wishes = woken.wait(wishes).unwrap_or_else(PoisonError::into_inner);
            }
        };
        let mut heights = Vec::new();
        ground.heights(id, &mut scratch, &mut heights);
        if ready.send(Tile { id, heights, state }).is_err() {
            return;
        }
        notify();
    }
}
