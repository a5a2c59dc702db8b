//! Tiles of large textures in GPU memory (`docs/design/textures.md`): one pool of pages per renderer, and a table that
//! says for each tile of each level which page is the finest that shows it.
//!
//! A tile that comes or goes changes the words of the places below it, no others. A new tile fades in over
//! [`FADE_S`] seconds of the frames' time.

mod bindings;
mod grid;
mod pages;
mod table;
mod uniform;

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lodestream_scene::asset::TextureKind;

pub(crate) use self::bindings::TileBindings;
pub(crate) use self::grid::TilePlace;
use self::grid::{FADED_IN, MAX_PAGES, PageNumber, Tile, TileGrid};
use self::pages::{LAYER_BYTES, PAGES_OF_LAYER, PageArray, final_layers, has_view_formats};
use self::table::PageTable;
pub(crate) use self::uniform::TiledMap;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::stamp::new_stamp;
use crate::resources::texture_shape::TextureShape;

/// Time in which a new tile fades in over what was there before.
pub(crate) const FADE_S: f32 = 0.15;
/// Budget of the pages of a new renderer.
pub(crate) const DEFAULT_BUDGET_BYTES: u64 = 256 << 20;

/// Memory of the tiles of all textures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TextureTileUse {
    /// GPU memory of the pages, in bytes; at most the budget.
    pub bytes: u64,
    /// Most bytes that pages took at once, those of an array that was being replaced too; at most the largest budget.
    pub peak_bytes: u64,
    /// The budget, in bytes.
    pub budget_bytes: u64,
    /// Pages with a tile.
    pub pages: u32,
    /// Pages that there can be within the budget: two thirds of it or more.
    pub most_pages: u32,
}

/// The tiles of one texture.
#[derive(Debug)]
struct TiledTexture {
    grid: TileGrid,
    /// Its words in the table.
    words: Range<u32>,
    /// Array of its pages.
    array: usize,
    /// Another number for each change of what is drawn.
    stamp: Arc<AtomicU64>,
}

/// A tile that fades in.
#[derive(Debug)]
struct FadingTile {
    texture: u32,
    place: TilePlace,
    /// Time of the first frame with it.
    since_s: Option<f32>,
}

#[derive(Debug)]
struct State {
    /// One for all, or one with sRGB and one without.
    arrays: Vec<PageArray>,
    table: PageTable,
    textures: BTreeMap<u32, TiledTexture>,
    fading: Vec<FadingTile>,
    next: u32,
    budget_bytes: u64,
    bindings: TileBindings,
}

/// The pool of a renderer. Clones share it.
#[derive(Clone, Debug)]
pub(crate) struct TextureTiles {
    /// Layout of the group of pages and page table.
    pub(crate) layout: wgpu::BindGroupLayout,
    state: Arc<Mutex<State>>,
}

/// A texture of the pool; dropping it frees its tiles.
#[derive(Debug)]
pub(crate) struct TileSet {
    pool: TextureTiles,
    number: u32,
    map: TiledMap,
    stamp: Arc<AtomicU64>,
}

/// Most layers of an array.
fn most_layers_of_array(gpu: &Gpu) -> u32 {
    gpu.device.limits().max_texture_array_layers.min(MAX_PAGES / PAGES_OF_LAYER)
}

impl State {
    /// Layers of an array's share of the budget, which arrays share equally.
    fn budget_layers(&self) -> u32 {
        let share = self.budget_bytes / self.arrays.len() as u64;
        u32::try_from(share / LAYER_BYTES).unwrap_or(u32::MAX)
    }

    /// Most layers of an array.
    fn most_layers(&self, gpu: &Gpu) -> u32 {
        final_layers(self.budget_layers(), most_layers_of_array(gpu))
    }

    /// Replaces a tile, and what the table says of it.
    fn set(&mut self, number: u32, place: TilePlace, tile: Option<Tile>) {
        let Some(texture) = self.textures.get_mut(&number) else { return };
        let base = texture.words.start;
        let mut written = Vec::new();
        texture.grid.set(place, tile, self.table.words_of(&texture.words), |range| written.push(range));
        for range in written {
            self.table.touch(base + range.start..base + range.end);
        }
        texture.stamp.store(new_stamp(), Ordering::Relaxed);
    }

    /// A free page, of a new layer if there must be one.
    fn page(&mut self, gpu: &Gpu, array: usize) -> Result<PageNumber, RenderError> {
        let budget = self.budget_layers();
        let full = RenderError::NoTileRoom { budget_bytes: self.budget_bytes };
        // A budget that has become smaller is not exceeded by more tiles.
        if self.arrays[array].used() >= self.most_layers(gpu) * PAGES_OF_LAYER {
            return Err(full);
        }
        if self.arrays[array].is_full() && self.arrays[array].grow(gpu, budget, most_layers_of_array(gpu)) {
            self.bindings.forget();
        }
        self.arrays[array].take().ok_or(full)
    }

    /// Moves tiles together where much is free.
    fn shrink(&mut self, gpu: &Gpu) {
        let (budget, most) = (self.budget_layers(), self.most_layers(gpu));
        for array in 0..self.arrays.len() {
            let Some(layers) = self.arrays[array].shrunk(budget, most) else { continue };
            let own = || self.textures.values().filter(|texture| texture.array == array);
            let mut used: Vec<_> =
                own().flat_map(|texture| texture.grid.tiles().map(|(_, tile)| tile.page)).collect();
            used.sort_unstable();
            self.arrays[array].shrink(gpu, layers, &used);
            let moved = |page| used.partition_point(|other| *other < page) as PageNumber;
            for texture in self.textures.values_mut().filter(|texture| texture.array == array) {
                texture.grid.renumber(moved, self.table.words_of(&texture.words), |_| {});
                self.table.touch(texture.words.clone());
            }
            self.bindings.forget();
        }
    }

    /// Fades tiles in, as of a frame at `time_s`.
    fn fade(&mut self, time_s: f32) {
        let mut fading = std::mem::take(&mut self.fading);
        fading.retain_mut(|FadingTile { texture, place, since_s }| {
            let age_s = time_s - *since_s.get_or_insert(time_s);
            // As morphs, fades end in a picture at no time, and where time runs back.
            let share = if time_s < f32::MAX && age_s >= 0.0 { age_s / FADE_S } else { 1.0 };
            let fade = (share.clamp(0.0, 1.0) * f32::from(FADED_IN)).round() as u8;
            let tile = self.textures.get(texture).and_then(|texture| texture.grid.tile(*place));
            if let Some(tile) = tile.filter(|tile| tile.fade != fade) {
                self.set(*texture, *place, Some(Tile { fade, ..tile }));
            }
            fade < FADED_IN
        });
        self.fading = fading;
    }
}

impl TextureTiles {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self::with_arrays(gpu, if has_view_formats(gpu) { 1 } else { 2 })
    }

    /// With one array of pages for all textures, or with two.
    fn with_arrays(gpu: &Gpu, count: usize) -> Self {
        use wgpu::TextureFormat::{Rgba8Unorm, Rgba8UnormSrgb};
        let formats: &[_] = if count == 1 { &[Rgba8Unorm] } else { &[Rgba8UnormSrgb, Rgba8Unorm] };
        let bindings = TileBindings::new(gpu);
        let state = State {
            arrays: formats.iter().map(|format| PageArray::new(*format)).collect(),
            table: PageTable::default(),
            textures: BTreeMap::new(),
            fading: Vec::new(),
            next: 0,
            budget_bytes: DEFAULT_BUDGET_BYTES,
            bindings,
        };
        Self { layout: state.bindings.layout.clone(), state: Arc::new(Mutex::new(state)) }
    }

    // Each change is complete when the lock is released, so a poisoned one is consistent.
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a texture whose levels from `whole` on are tiled.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the page table has no room.
    pub(crate) fn add(&self, gpu: &Gpu, shape: &TextureShape, whole: u32) -> Result<TileSet, RenderError> {
        let mut state = self.state();
        let grid = TileGrid::new(shape, whole);
        let words = state.table.allocate(gpu, grid.words())?;
        let colour = shape.kind == TextureKind::Color;
        // Colours have the first array.
        let array = if colour { 0 } else { state.arrays.len() - 1 };
        let (number, stamp, map) = (state.next, Arc::default(), grid.map(words.start));
        state.next += 1;
        state.textures.insert(number, TiledTexture { grid, words, array, stamp: Arc::clone(&stamp) });
        Ok(TileSet { pool: self.clone(), number, map, stamp })
    }

    /// Begins a frame: fades tiles in, moves pages together where much is free, and uploads the table.
    pub(crate) fn begin_frame(&self, gpu: &Gpu, time_s: f32) -> wgpu::BindGroup {
        let mut state = self.state();
        state.fade(time_s);
        state.shrink(gpu);
        if state.table.flush(gpu) {
            state.bindings.forget();
        }
        let State { arrays, table, bindings, .. } = &mut *state;
        let last = arrays.len() - 1;
        bindings.group(gpu, [arrays[0].texture(), arrays[last].texture()], table.texture())
    }

    /// Whether a frame at a later time differs because tiles fade in.
    pub(crate) fn are_fading(&self) -> bool {
        !self.state().fading.is_empty()
    }

    /// Sets the budget. Pages go with the next frames, as far as tiles are removed.
    pub(crate) fn set_budget(&self, bytes: u64) {
        self.state().budget_bytes = bytes;
    }

    /// Memory of pages.
    pub(crate) fn used(&self, gpu: &Gpu) -> TextureTileUse {
        let state = self.state();
        TextureTileUse {
            bytes: state.arrays.iter().map(PageArray::bytes).sum(),
            peak_bytes: state.arrays.iter().map(PageArray::peak_bytes).sum(),
            budget_bytes: state.budget_bytes,
            pages: state.arrays.iter().map(PageArray::used).sum(),
            most_pages: state.most_layers(gpu) * PAGES_OF_LAYER * state.arrays.len() as u32,
        }
    }

    fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.state, &other.state)
    }
}

impl TileSet {
    /// What a material of this pool's renderer says of the texture.
    pub(crate) fn map(&self, pool: &TextureTiles) -> Option<TiledMap> {
        self.pool.is(pool).then_some(self.map)
    }

    /// Another number for each change of what is drawn.
    pub(crate) fn stamp(&self) -> &Arc<AtomicU64> {
        &self.stamp
    }

    /// Whether a tile is there.
    pub(crate) fn has(&self, place: TilePlace) -> bool {
        self.pool.state().textures.get(&self.number).is_some_and(|texture| texture.grid.tile(place).is_some())
    }

    /// Sets a tile, whose page `write` fills in the given format. One that was there keeps its page and its fade.
    ///
    /// # Errors
    /// [`RenderError::NoTileRoom`]; nothing is changed then.
    pub(crate) fn set(
        &self,
        gpu: &Gpu,
        place: TilePlace,
        write: impl FnOnce(wgpu::TexelCopyTextureInfo<'_>, wgpu::TextureFormat),
    ) -> Result<(), RenderError> {
        let mut state = self.pool.state();
        let Some(texture) = state.textures.get(&self.number) else { return Ok(()) };
        let (array, there) = (texture.array, texture.grid.tile(place));
        let page = match there {
            Some(tile) => tile.page,
            None => state.page(gpu, array)?,
        };
        let array = &state.arrays[array];
        if let Some(at) = array.place(page) {
            write(at, array.format());
        }
        state.set(self.number, place, Some(there.unwrap_or(Tile { page, fade: 0 })));
        if there.is_none() {
            state.fading.push(FadingTile { texture: self.number, place, since_s: None });
        }
        Ok(())
    }

    /// Removes a tile; returns whether it was there.
    pub(crate) fn remove(&self, place: TilePlace) -> bool {
        let mut state = self.pool.state();
        let Some(texture) = state.textures.get(&self.number) else { return false };
        let (array, Some(tile)) = (texture.array, texture.grid.tile(place)) else { return false };
        state.set(self.number, place, None);
        state.arrays[array].give(tile.page);
        state.fading.retain(|fading| (fading.texture, fading.place) != (self.number, place));
        true
    }
}

impl Drop for TileSet {
    fn drop(&mut self) {
        let mut state = self.pool.state();
        let Some(texture) = state.textures.remove(&self.number) else { return };
        for (_, tile) in texture.grid.tiles() {
            state.arrays[texture.array].give(tile.page);
        }
        state.table.free(texture.words);
        state.fading.retain(|fading| fading.texture != self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::headless;

    #[test]
    fn without_view_formats_colours_and_other_maps_share_the_budget() {
        let Some(h) = headless(1, 1) else { return };
        let gpu = h.gpu();
        let pool = TextureTiles::with_arrays(gpu, 2);
        pool.set_budget(6 * LAYER_BYTES);
        let sets = [TextureKind::Color, TextureKind::Normal].map(|kind| {
            let shape = TextureShape::full(2048, 2048, kind).tiled();
            pool.add(gpu, &shape, shape.whole()).unwrap()
        });
        let place = |number: u32| TilePlace { level: 11, column: number % 8, row: number / 8 };
        let mut formats = Vec::new();
        for set in &sets {
            for number in 0..48 {
                set.set(gpu, place(number), |_, format| formats.push(format)).unwrap();
            }
            formats.dedup();
        }
        assert_eq!(formats, [wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Rgba8Unorm]);
        for set in &sets {
            let refused = set.set(gpu, place(50), |_, _| panic!("nothing is written"));
            assert!(matches!(refused, Err(RenderError::NoTileRoom { .. })));
        }
        let used = pool.used(gpu);
        assert_eq!((used.bytes, used.pages, used.most_pages), (6 * LAYER_BYTES, 96, 96));
        pool.begin_frame(gpu, f32::MAX);
        gpu.check().unwrap();
        // A smaller budget takes effect as tiles go; none comes in their place.
        pool.set_budget(2 * LAYER_BYTES);
        pool.begin_frame(gpu, f32::MAX);
        assert_eq!(pool.used(gpu).bytes, 6 * LAYER_BYTES);
        let [colours, normals] = sets;
        drop(normals);
        assert!((0..32).all(|number| colours.remove(place(number))));
        assert!(matches!(colours.set(gpu, place(0), |_, _| {}), Err(RenderError::NoTileRoom { .. })));
        pool.begin_frame(gpu, f32::MAX);
        assert_eq!(pool.used(gpu).bytes, LAYER_BYTES);
        assert!((32..48).all(|number| colours.has(place(number))));
        drop(colours);
        pool.begin_frame(gpu, f32::MAX);
        assert_eq!((pool.used(gpu).bytes, pool.used(gpu).pages), (0, 0));
        gpu.check().unwrap();
    }
}
