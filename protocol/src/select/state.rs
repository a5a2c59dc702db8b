//! What is known of an asset, and where its blobs are.

use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, Stop};
use lodestream_geometry::screen::visible_error;

use crate::asset::{AssetDescription, TextureLevel};
use crate::blob::{BlobId, BlobPart};
use crate::scene::AssetEntry;
use crate::select::Wanted;

/// Where a blob is, as far as the caller is concerned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum State {
    /// Not here and not asked for.
    #[default]
    Absent,
    /// Asked for, or about to be pushed.
    InFlight,
    /// The bytes are here, but not in use (yet, or any longer).
    Cached,
    /// In use: drawn (base, chunk, texture level) or known (index page).
    Applied,
    /// Will not come: refused or damaged. Neither it nor its children are wanted.
    Failed,
}

/// What is known of one asset and where its blobs are. The caller keeps one per asset, in the order of
/// asset numbers, and updates it as things arrive; the selector only reads it.
#[derive(Clone, Debug)]
pub struct AssetState {
    entry: AssetEntry,
    base: State,
    pages: Vec<State>,
    chunks: Vec<ChunkInfo>,
    states: Vec<State>,
    /// Chunks up to the last known one: bytes of the beginning that are here, and the stop that is in use.
    held: Vec<u32>,
    stops: Vec<Option<u8>>,
    /// Number of leading index pages that are known without a gap.
    known_pages: u32,
    /// Upper bound on the error of any chunk whose index page is not known yet.
    unknown_error: f32,
    textures: Vec<TextureState>,
}

/// A texture's levels and density.
#[derive(Clone, Debug)]
pub(super) struct TextureState {
    pub(super) levels: Vec<(TextureLevel, State)>,
    /// Texture coordinates per asset unit.
    pub(super) uv_per_unit: f32,
}

/// An index page that does not fit its asset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PageError {
    /// The asset has no such page.
    #[error("the asset has no index page {0}")]
    NoSuchPage(u32),
    /// Another number of chunks than the scene's entry implies.
    #[error("index page {page} lists {got} chunks, but should list {expected}")]
    WrongCount {
        /// The page.
        page: u32,
        /// How many chunks it lists.
        got: usize,
        /// How many it should.
        expected: usize,
    },
    /// A chunk names itself or a younger chunk as its parent.
    #[error("chunk {0} has a parent that is not older")]
    ParentNotOlder(u32),
}

impl AssetState {
    /// An asset of which only the scene's entry is known.
    #[must_use]
    pub fn new(entry: AssetEntry) -> Self {
        let pages = vec![State::Absent; entry.index_pages() as usize];
        let unknown_error = if pages.is_empty() { 0.0 } else { entry.root_error };
        Self {
            entry,
            base: State::Absent,
            pages,
            chunks: Vec::new(),
            states: Vec::new(),
            held: Vec::new(),
            stops: Vec::new(),
            known_pages: 0,
            unknown_error,
            textures: Vec::new(),
        }
    }

    /// The scene's entry.
    #[must_use]
    pub const fn entry(&self) -> &AssetEntry {
        &self.entry
    }

    /// Where a blob is. Blobs that do not exist, or whose page is not known, are absent.
    #[must_use]
    pub fn state(&self, part: BlobPart) -> State {
        match part {
            BlobPart::Base => self.base,
            BlobPart::IndexPage(page) => self.pages.get(page as usize).copied().unwrap_or_default(),
            BlobPart::Chunk(chunk) => self.states.get(chunk as usize).copied().unwrap_or_default(),
            BlobPart::Texture { texture, level } => self
                .textures
                .get(usize::from(texture))
                .and_then(|t| t.levels.get(usize::from(level)))
                .map_or(State::Absent, |(_, state)| *state),
        }
    }

    /// Sets how many bytes of a chunk's beginning are here.
    pub fn set_held(&mut self, chunk: u32, bytes: u32) {
        if let Some(held) = self.held.get_mut(chunk as usize) {
            *held = bytes;
        }
    }

    /// Bytes of a chunk's beginning that are here.
    #[must_use]
    pub fn held_bytes(&self, chunk: u32) -> u32 {
        self.held.get(chunk as usize).copied().unwrap_or(0)
    }

    /// Says that a chunk is in use up to a stop ([`ChunkInfo::stops`]), or no longer: its state is then
    /// that of the rest. A chunk that is [`State::Applied`] is in use whole.
    pub fn set_stop(&mut self, chunk: u32, stop: Option<u8>) {
        if let Some(slot) = self.stops.get_mut(chunk as usize) {
            *slot = stop;
        }
    }

    /// The stop up to which a chunk is in use; `None` where it is whole or not in use.
    #[must_use]
    pub fn stop(&self, chunk: u32) -> Option<u8> {
        match self.states.get(chunk as usize) {
            Some(State::Applied) | None => None,
            Some(_) => self.stops[chunk as usize],
        }
    }

    /// What of a chunk is in use, if anything.
    #[must_use]
    pub fn extent_in_use(&self, chunk: u32) -> Option<Stop> {
        let info = self.chunk(chunk)?;
        match (self.states[chunk as usize], self.stop(chunk)) {
            (State::Applied, _) => Some(info.extent(None)),
            (_, stop @ Some(_)) => Some(info.extent(stop)),
            _ => None,
        }
    }

    /// Where as much of a chunk is as takes it to a stop.
    #[must_use]
    pub fn chunk_state(&self, chunk: u32, stop: Option<u8>) -> State {
        let state = self.state(BlobPart::Chunk(chunk));
        let Some(info) = self.chunk(chunk) else { return state };
        match state {
            State::Applied | State::Failed => state,
            _ if stop.is_some() && self.stop(chunk) >= stop => State::Applied,
            _ if self.held_bytes(chunk) >= info.extent(stop).payload_bytes => State::Cached,
            State::Cached => State::Absent,
            _ => state,
        }
    }

    /// Brings what a selection said of a blob up to date with what has arrived since.
    pub fn refresh(&self, wanted: &mut Wanted) {
        wanted.state = match wanted.id.part() {
            Some(BlobPart::Chunk(chunk)) => {
                wanted.held = self.held_bytes(chunk);
                self.chunk_state(chunk, wanted.stop)
            }
            Some(part) => self.state(part),
            None => wanted.state,
        };
    }

    /// Sets where a blob is; blobs that do not exist are ignored. An index page becomes
    /// [`State::Applied`] by [`AssetState::add_index_page`] only.
    pub fn set_state(&mut self, part: BlobPart, state: State) {
        let slot = match part {
            BlobPart::Base => Some(&mut self.base),
            BlobPart::IndexPage(page) => {
                self.pages.get_mut(page as usize).filter(|old| **old != State::Applied)
            }
            BlobPart::Chunk(chunk) => {
                self.states.get_mut(chunk as usize).filter(|_| self.chunks[chunk as usize].level > 0)
            }
            BlobPart::Texture { texture, level } => self
                .textures
                .get_mut(usize::from(texture))
                .and_then(|t| t.levels.get_mut(usize::from(level)))
                .map(|(_, state)| state),
        };
        if let Some(slot) = slot {
            *slot = state;
        }
    }

    /// Makes the chunks of an index page known. Pages may come in any order.
    ///
    /// # Errors
    /// Refuses pages that do not fit the asset; nothing changes then.
    pub fn add_index_page(&mut self, page: u32, infos: Vec<ChunkInfo>) -> Result<(), PageError> {
        if page as usize >= self.pages.len() {
            return Err(PageError::NoSuchPage(page));
        }
        let first = page as usize * CHUNKS_PER_PAGE;
        let expected = CHUNKS_PER_PAGE.min(self.entry.chunk_count as usize - first);
        if infos.len() != expected {
            return Err(PageError::WrongCount { page, got: infos.len(), expected });
        }
        for (info, id) in infos.iter().zip((page * CHUNKS_PER_PAGE as u32)..) {
            if info.parents.iter().any(|&parent| parent >= id) {
                return Err(PageError::ParentNotOlder(id));
            }
        }
        // Unknown chunks in between have level 0, which no real chunk has.
        let end = first + infos.len();
        if self.chunks.len() < end {
            self.chunks.resize(end, ChunkInfo::default());
            self.states.resize(end, State::Absent);
            self.held.resize(end, 0);
            self.stops.resize(end, None);
        }
        for (slot, mut info) in self.chunks[first..end].iter_mut().zip(infos) {
            info.level = info.level.max(1);
            *slot = info;
        }
        self.pages[page as usize] = State::Applied;
        while self.pages.get(self.known_pages as usize) == Some(&State::Applied) {
            self.known_pages += 1;
        }
        self.unknown_error = self.bound_of_unknown();
        Ok(())
    }

    /// An unknown chunk's error is at most that of any of its parents. Chunks are numbered level by
    /// level, and parents lie in the nearest coarser level that has one there, as a rule the one before:
    /// so the largest error among the last two known levels bounds what follows.
    fn bound_of_unknown(&self) -> f32 {
        if self.known_pages as usize == self.pages.len() {
            return 0.0;
        }
        let known = &self.chunks[..self.known_pages as usize * CHUNKS_PER_PAGE];
        let Some(last) = known.last() else { return self.entry.root_error };
        known
            .iter()
            .rev()
            .filter(|info| info.level.saturating_add(1) >= last.level)
            .map(|info| visible_error(info, 1.0))
            .fold(0.0, f32::max)
            .min(self.entry.root_error)
    }

    /// The base mesh arrived with this description. `uv_per_unit` gives texture coordinates per asset
    /// unit (the square root of uv area over surface area), for the texel density.
    pub fn set_description(&mut self, description: &AssetDescription, uv_per_unit: f32) {
        self.textures = description
            .textures
            .iter()
            .map(|t| TextureState {
                levels: t.levels.iter().map(|level| (*level, State::Absent)).collect(),
                uv_per_unit,
            })
            .collect();
    }

    /// A chunk's index entry, if its page is known.
    #[must_use]
    pub fn chunk(&self, chunk: u32) -> Option<&ChunkInfo> {
        self.chunks.get(chunk as usize).filter(|info| info.level > 0)
    }

    /// Entries of all known chunks, by id; entries with level 0 are not known yet.
    #[must_use]
    pub fn chunks(&self) -> &[ChunkInfo] {
        &self.chunks
    }

    /// States of all chunks up to the last known one.
    #[must_use]
    pub fn chunk_states(&self) -> &[State] {
        &self.states
    }

    /// Number of leading index pages that are known without a gap.
    #[must_use]
    pub const fn known_pages(&self) -> u32 {
        self.known_pages
    }

    /// Upper bound on the error of chunks that are not known yet, in the asset's units: 0 once all
    /// index pages are known, the root error before the first.
    #[must_use]
    pub const fn unknown_error(&self) -> f32 {
        self.unknown_error
    }

    pub(super) fn textures(&self) -> &[TextureState] {
        &self.textures
    }

    /// Length of a blob, where the scene or the index tells.
    #[must_use]
    pub fn blob_bytes(&self, part: BlobPart) -> Option<u32> {
        match part {
            BlobPart::Base => Some(self.entry.base_bytes),
            BlobPart::IndexPage(_) => None,
            BlobPart::Chunk(chunk) => self.chunk(chunk).map(|info| info.payload_bytes),
            BlobPart::Texture { texture, level } => {
                let texture = self.textures.get(usize::from(texture))?;
                texture.levels.get(usize::from(level)).map(|(level, _)| level.bytes)
            }
        }
    }

    /// Ids of all blobs of `asset` (this asset's number) that are here: base and index pages only, as a
    /// reconnecting client lists them.
    #[must_use]
    pub fn held(&self, asset: u32) -> Vec<BlobId> {
        let here = |state: &State| matches!(state, State::Cached | State::Applied);
        let base = Some(BlobId::base(asset)).filter(|_| here(&self.base));
        let pages = (0..).zip(&self.pages).filter(|(_, state)| here(state));
        base.into_iter().chain(pages.map(|(page, _)| BlobId::index_page(asset, page))).collect()
    }
}
