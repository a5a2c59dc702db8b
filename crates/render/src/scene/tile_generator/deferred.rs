//! Terrain tiles without threads: a few milliseconds of them in each frame, so that no frame waits for many, and more
//! where the host waits for its device.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use lodestream_terrain::Scratch;
use lodestream_terrain::tiles::{PlacedTerrain, TileId};
use lodestream_threads::Instant;

use super::GeneratedTile;

/// Time for tiles in a frame.
const FRAME_BUDGET: Duration = Duration::from_millis(6);

#[derive(Default)]
struct TileRequests {
    /// The terrain and its version.
    terrain: Option<(Arc<PlacedTerrain>, u64)>,
    /// Most urgent last.
    tiles: Vec<TileId>,
    /// Start of this frame's first tile.
    begun: Option<Instant>,
    scratch: Scratch,
    ready: VecDeque<GeneratedTile>,
}

impl TileRequests {
    fn generate(&mut self) -> Option<GeneratedTile> {
        let (terrain, version) = self.terrain.clone()?;
        let id = self.tiles.pop()?;
        let mut heights = Vec::new();
        terrain.heights(id, &mut self.scratch, &mut heights);
        Some(GeneratedTile { id, heights, version })
    }
}

/// Generates tiles when they are taken.
pub struct TileGenerator(Mutex<TileRequests>);

impl TileGenerator {
    /// A generator; `notify` is not called, since tiles come with frames.
    ///
    /// # Errors
    /// Never; with threads, the system may provide none.
    pub fn start(_notify: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        Ok(Self(Mutex::default()))
    }

    /// Requests tiles, most urgent first, in place of all earlier requests. `version` must grow with every change of the
    /// terrain; tiles carry it back.
    pub fn request(
        &self,
        terrain: &Arc<PlacedTerrain>,
        version: u64,
        tiles: impl DoubleEndedIterator<Item = TileId>,
    ) {
        let mut requests = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        requests.terrain = Some((Arc::clone(terrain), version));
        requests.tiles.clear();
        requests.tiles.extend(tiles.rev());
        requests.ready.retain(|tile| tile.version == version);
        let TileRequests { tiles, ready, .. } = &mut *requests;
        tiles.retain(|id| ready.iter().all(|tile| tile.id != *id));
        requests.begun = None;
    }

    /// The next requested tile, generated now or before; none once the frame's time is used up.
    #[must_use]
    pub fn take(&self) -> Option<GeneratedTile> {
        let mut requests = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(tile) = requests.ready.pop_front() {
            return Some(tile);
        }
        if requests.begun.get_or_insert_with(Instant::now).elapsed() > FRAME_BUDGET {
            return None;
        }
        requests.generate()
    }

    /// Generates requested tiles for about this time, for [`TileGenerator::take`].
    pub fn work(&self, budget: Duration) {
        let mut requests = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = Instant::now();
        while begun.elapsed() < budget
            && let Some(tile) = requests.generate()
        {
            requests.ready.push_back(tile);
        }
    }
}

impl std::fmt::Debug for TileGenerator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("TileGenerator(deferred)")
    }
}
