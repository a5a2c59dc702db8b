//! State of an asset at the caller: its known chunks, and the state of its blobs.

use std::sync::Arc;

use lodestream_geometry::index::{
    CHUNKS_PER_PAGE, ChunkInfo, IndexPage, TruncationPoint, expected_rest_error,
};
use lodestream_geometry::numbers::id32;

use lodestream_scene::asset::{AssetDescription, TextureInfo, TextureLevel, TextureRegions, cells_of};
use lodestream_scene::blob::{BlobId, BlobPart, Tile};
use lodestream_scene::description::AssetEntry;

use super::occluder::Occluder;
use super::selection::{State, Wanted};

/// One chunk: its index entry and its state.
#[derive(Clone, Debug)]
pub struct Chunk {
    info: ChunkInfo,
    state: State,
    /// Bytes received from the start.
    held: u32,
    /// Truncation point up to which it is applied, if not whole.
    truncation: Option<u8>,
    /// Error of the occluder in the chunk's region.
    margin: f32,
}

impl Chunk {
    /// Its index entry.
    #[must_use]
    pub const fn info(&self) -> &ChunkInfo {
        &self.info
    }

    /// Its state. [`State::Applied`] means the whole chunk.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Bytes received from the start of the chunk.
    #[must_use]
    pub const fn held_bytes(&self) -> u32 {
        self.held
    }

    /// Truncation point up to which it is applied; `None` if it is applied whole or not at all.
    #[must_use]
    pub const fn truncation(&self) -> Option<u8> {
        match self.state {
            State::Applied => None,
            _ => self.truncation,
        }
    }

    /// Error of the asset's occluder in the chunk's region, in the asset's units: the largest error among the chunk
    /// and its ancestors that are not part of the occluder.
    #[must_use]
    pub(super) const fn margin(&self) -> f32 {
        self.margin
    }

    /// Extent of the applied part, if any.
    #[must_use]
    pub fn extent_in_use(&self) -> Option<TruncationPoint> {
        match (self.state, self.truncation) {
            (State::Applied, _) => Some(self.info.extent(None)),
            (_, truncation @ Some(_)) => Some(self.info.extent(truncation)),
            _ => None,
        }
    }

    /// State of the part up to a truncation point.
    #[must_use]
    pub fn state_up_to(&self, truncation: Option<u8>) -> State {
        match self.state {
            State::Applied | State::Failed => self.state,
            _ if truncation.is_some() && self.truncation >= truncation => State::Applied,
            _ if self.held >= self.info.extent(truncation).payload_bytes => State::Cached,
            State::Cached => State::Absent,
            state => state,
        }
    }
}

/// State of one asset. The caller has one per asset, in the order of asset numbers, and updates it as blobs arrive; the
/// selector only reads it.
#[derive(Clone, Debug)]
pub struct AssetState {
    entry: AssetEntry,
    base: State,
    pages: Vec<State>,
    /// Chunks up to the last known one.
    chunks: Vec<Option<Chunk>>,
    /// Number of index pages known without a gap from the first.
    known_pages: u32,
    /// Bound on the errors of later pages that each index page states, if it does.
    rest_errors: Vec<Option<f32>>,
    /// Upper bound on the error of any chunk whose index page is not known yet.
    unknown_error: f32,
    textures: Vec<TextureState>,
    /// By material.
    materials: Vec<MaterialCells>,
    regions: (State, Option<Arc<TextureRegions>>),
    occluder: Option<Arc<Occluder>>,
}

/// A texture's levels and density.
#[derive(Clone, Debug)]
pub(super) struct TextureState {
    /// Levels that are one image each.
    pub(super) levels: Vec<(TextureLevel, State)>,
    /// Levels that are cut, with the states of their tiles.
    pub(super) tiled: Vec<(TextureLevel, Vec<State>)>,
    /// Texture coordinates per asset unit.
    pub(super) uv_per_unit: f32,
}

impl TextureState {
    fn tile(&self, tile: Tile) -> Option<&State> {
        let level = usize::from(tile.level).checked_sub(self.levels.len())?;
        self.tiled.get(level)?.1.get(usize::from(tile.tile))
    }

    fn tile_mut(&mut self, tile: Tile) -> Option<&mut State> {
        let level = usize::from(tile.level).checked_sub(self.levels.len())?;
        self.tiled.get_mut(level)?.1.get_mut(usize::from(tile.tile))
    }
}

/// What the cells of a material's patches stand for.
#[derive(Clone, Debug)]
pub(super) struct MaterialCells {
    /// Size of the level whose tiles are the cells.
    pub(super) size: [u32; 2],
    /// Textures that have tiles, each once.
    pub(super) textures: Vec<u16>,
}

/// An index page that does not fit its asset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PageError {
    /// The asset has no such page.
    #[error("the asset has no index page {0}")]
    NoSuchPage(u32),
    /// Another number of chunks than the asset's entry implies.
    #[error("index page {page} lists {got} chunks, but should list {expected}")]
    WrongCount {
        /// The page.
        page: u32,
        /// How many chunks it lists.
        got: usize,
        /// How many it should.
        expected: usize,
    },
    /// A chunk whose parent does not have a lower id.
    #[error("chunk {0} has a parent that does not have a lower id")]
    ParentNotOlder(u32),
}

impl AssetState {
    /// An asset of which only the entry is known.
    #[must_use]
    pub fn new(entry: AssetEntry) -> Self {
        let page_count = entry.index_pages() as usize;
        let pages = vec![State::Absent; page_count];
        let unknown_error = if pages.is_empty() { 0.0 } else { entry.root_error };
        Self {
            entry,
            base: State::Absent,
            pages,
            chunks: Vec::new(),
            known_pages: 0,
            rest_errors: vec![None; page_count],
            unknown_error,
            textures: Vec::new(),
            materials: Vec::new(),
            regions: (State::Absent, None),
            occluder: None,
        }
    }

    /// The asset's entry in the scene.
    #[must_use]
    pub const fn entry(&self) -> &AssetEntry {
        &self.entry
    }

    /// Whether an image of a texture exists, as far as the description is known.
    #[must_use]
    pub fn has_image(&self, part: BlobPart) -> bool {
        let texture = part.texture().and_then(|texture| self.textures.get(usize::from(texture)));
        texture.is_some_and(|texture| match part {
            BlobPart::Texture { level, .. } => usize::from(level) < texture.levels.len(),
            BlobPart::Tile(tile) => texture.tile(tile).is_some(),
            _ => false,
        })
    }

    /// State of a blob; absent if it does not exist or its page is not known.
    #[must_use]
    pub fn state(&self, part: BlobPart) -> State {
        match part {
            BlobPart::Base => self.base,
            BlobPart::IndexPage(page) => self.pages.get(page as usize).copied().unwrap_or_default(),
            BlobPart::Chunk(chunk) => self.known(chunk).map_or(State::Absent, Chunk::state),
            BlobPart::Texture { texture, level } => self
                .textures
                .get(usize::from(texture))
                .and_then(|t| t.levels.get(usize::from(level)))
                .map_or(State::Absent, |(_, state)| *state),
            BlobPart::TextureRegions => self.regions.0,
            BlobPart::Tile(tile) => {
                let texture = self.textures.get(usize::from(tile.texture));
                texture.and_then(|texture| texture.tile(tile)).copied().unwrap_or_default()
            }
        }
    }

    /// A chunk, if its page is known.
    #[must_use]
    pub fn known(&self, chunk: u32) -> Option<&Chunk> {
        self.chunks.get(chunk as usize)?.as_ref()
    }

    fn known_mut(&mut self, chunk: u32) -> Option<&mut Chunk> {
        self.chunks.get_mut(chunk as usize)?.as_mut()
    }

    /// Sets how many bytes of a chunk were received from its start.
    pub fn set_held(&mut self, chunk: u32, bytes: u32) {
        if let Some(chunk) = self.known_mut(chunk) {
            chunk.held = bytes;
        }
    }

    /// Bytes of a chunk's beginning that are here.
    #[must_use]
    pub fn held_bytes(&self, chunk: u32) -> u32 {
        self.known(chunk).map_or(0, Chunk::held_bytes)
    }

    /// Sets the truncation point ([`ChunkInfo::truncation_points`]) up to which a chunk is applied; its state is then
    /// that of the rest. A chunk that is [`State::Applied`] is applied whole.
    pub fn set_truncation(&mut self, chunk: u32, truncation: Option<u8>) {
        if let Some(chunk) = self.known_mut(chunk) {
            chunk.truncation = truncation;
        }
    }

    /// Updates the state of a wanted blob to what has arrived since the selection.
    pub fn refresh(&self, wanted: &mut Wanted) {
        wanted.state = match wanted.id.part() {
            Some(BlobPart::Chunk(chunk)) => {
                wanted.held = self.held_bytes(chunk);
                self.known(chunk).map_or(State::Absent, |chunk| chunk.state_up_to(wanted.truncation))
            }
            Some(part) => self.state(part),
            None => wanted.state,
        };
    }

    /// Sets the state of a blob; ignores blobs that do not exist. An index page becomes [`State::Applied`] only by
    /// [`AssetState::add_index_page`], texture regions by [`AssetState::set_texture_regions`].
    pub fn set_state(&mut self, part: BlobPart, state: State) {
        let slot = match part {
            BlobPart::Base => Some(&mut self.base),
            BlobPart::IndexPage(page) => {
                self.pages.get_mut(page as usize).filter(|old| **old != State::Applied)
            }
            BlobPart::Chunk(chunk) => self.known_mut(chunk).map(|chunk| &mut chunk.state),
            BlobPart::Texture { texture, level } => self
                .textures
                .get_mut(usize::from(texture))
                .and_then(|t| t.levels.get_mut(usize::from(level)))
                .map(|(_, state)| state),
            BlobPart::TextureRegions => Some(&mut self.regions.0).filter(|old| **old != State::Applied),
            BlobPart::Tile(tile) => {
                self.textures.get_mut(usize::from(tile.texture)).and_then(|texture| texture.tile_mut(tile))
            }
        };
        if let Some(slot) = slot {
            *slot = state;
        }
    }

    /// Adds the chunks of an index page. Pages may come in any order.
    ///
    /// # Errors
    /// If the page does not fit the asset; then nothing changes.
    pub fn add_index_page(&mut self, page: u32, contents: impl Into<IndexPage>) -> Result<(), PageError> {
        let IndexPage { chunks: infos, rest_error } = contents.into();
        if page as usize >= self.pages.len() {
            return Err(PageError::NoSuchPage(page));
        }
        let first = page as usize * CHUNKS_PER_PAGE;
        let expected = CHUNKS_PER_PAGE.min(self.entry.chunk_count as usize - first);
        if infos.len() != expected {
            return Err(PageError::WrongCount { page, got: infos.len(), expected });
        }
        for (info, id) in infos.iter().zip((page * id32(CHUNKS_PER_PAGE))..) {
            if info.parents.iter().any(|&parent| parent >= id) {
                return Err(PageError::ParentNotOlder(id));
            }
        }
        let end = first + infos.len();
        if self.chunks.len() < end {
            self.chunks.resize(end, None);
        }
        for (id, info) in (first..end).zip(infos) {
            let margin = self.margin_of(&info, false);
            match &mut self.chunks[id] {
                // A repeated page does not change the state.
                Some(chunk) => chunk.info = info,
                slot => *slot = Some(Chunk { info, state: State::Absent, held: 0, truncation: None, margin }),
            }
        }
        self.rest_errors[page as usize] = rest_error;
        self.pages[page as usize] = State::Applied;
        while self.pages.get(self.known_pages as usize) == Some(&State::Applied) {
            self.known_pages += 1;
        }
        self.unknown_error = self.bound_of_unknown();
        Ok(())
    }

    /// Sets the surface for the occlusion test: with the chunks that are [`State::Applied`], or finer.
    pub fn set_occluder(&mut self, occluder: Arc<Occluder>) {
        self.occluder = Some(occluder);
        for id in 0..self.chunks.len() {
            let Some(chunk) = &self.chunks[id] else { continue };
            let margin = self.margin_of(&chunk.info, chunk.state == State::Applied);
            if let Some(chunk) = &mut self.chunks[id] {
                chunk.margin = margin;
            }
        }
    }

    /// The surface for the occlusion test, if it is known.
    #[must_use]
    pub const fn occluder(&self) -> Option<&Arc<Occluder>> {
        self.occluder.as_ref()
    }

    /// [`Chunk::margin`] of a chunk whose parents have theirs. `drawn` says that the chunk is part of the occluder.
    fn margin_of(&self, info: &ChunkInfo, drawn: bool) -> f32 {
        let own = if drawn { 0.0 } else { info.error };
        let parents = info.parents.iter().filter_map(|&parent| self.known(parent));
        parents.map(Chunk::margin).fold(own, f32::max)
    }

    /// Bound on the errors of unknown chunks: stated by the last page known without a gap, or estimated from the
    /// known chunks ([`expected_rest_error`]).
    fn bound_of_unknown(&self) -> f32 {
        if self.known_pages as usize == self.pages.len() {
            return 0.0;
        }
        let Some(last) = self.known_pages.checked_sub(1) else { return self.entry.root_error };
        let known = self.chunks[..self.known_pages as usize * CHUNKS_PER_PAGE].iter().flatten();
        let stated = self.rest_errors[last as usize];
        stated.unwrap_or_else(|| expected_rest_error(known.map(Chunk::info))).min(self.entry.root_error)
    }

    /// Sets the description, which arrives with the base mesh.
    pub fn set_description(&mut self, description: &AssetDescription) {
        let texture = |info: &TextureInfo| {
            let (whole, cut) = info.levels.split_at(info.whole_levels());
            let tiles = |(level, number): (&TextureLevel, usize)| {
                (*level, vec![State::Absent; info.images(number) as usize])
            };
            TextureState {
                levels: whole.iter().map(|level| (*level, State::Absent)).collect(),
                tiled: cut.iter().zip(whole.len()..).map(tiles).collect(),
                uv_per_unit: info.uv_per_unit,
            }
        };
        self.textures = description.textures.iter().map(texture).collect();
        let materials = (0..).zip(&description.materials);
        self.materials = materials
            .map(|(number, material)| {
                let mut textures: Vec<u16> = material.textures().collect();
                textures.retain(|&texture| {
                    self.textures.get(usize::from(texture)).is_some_and(|texture| !texture.tiled.is_empty())
                });
                textures.sort_unstable();
                textures.dedup();
                MaterialCells { size: cells_of(description, number), textures }
            })
            .collect();
    }

    /// Sets where the surface is in its textures. Regions that do not [fit](TextureRegions::fit) the description show no
    /// tile.
    pub fn set_texture_regions(&mut self, regions: TextureRegions) {
        self.regions = (State::Applied, Some(Arc::new(regions)));
    }

    pub(super) fn texture_regions(&self) -> Option<&Arc<TextureRegions>> {
        self.regions.1.as_ref()
    }

    pub(super) fn material_cells(&self, material: u16) -> Option<&MaterialCells> {
        self.materials.get(usize::from(material))
    }

    /// A chunk's index entry, if its page is known.
    #[must_use]
    pub fn chunk(&self, chunk: u32) -> Option<&ChunkInfo> {
        self.known(chunk).map(Chunk::info)
    }

    /// All chunks up to the last known one, by id; `None` if the page is not known.
    #[must_use]
    pub fn chunks(&self) -> &[Option<Chunk>] {
        &self.chunks
    }

    /// Number of index pages known without a gap from the first.
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

    /// Length of a blob, if the scene or the index states it.
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
            BlobPart::TextureRegions | BlobPart::Tile(_) => None,
        }
    }

    /// Ids of the received base mesh and index pages of `asset` (this asset's number), as a reconnecting client lists
    /// them.
    #[must_use]
    pub fn held(&self, asset: u32) -> Vec<BlobId> {
        let here = |state: &State| matches!(state, State::Cached | State::Applied);
        let base = Some(BlobId::base(asset)).filter(|_| here(&self.base));
        let pages = (0..).zip(&self.pages).filter(|(_, state)| here(state));
        base.into_iter().chain(pages.map(|(page, _)| BlobId::index_page(asset, page))).collect()
    }
}
