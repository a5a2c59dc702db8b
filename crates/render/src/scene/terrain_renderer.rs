//! Terrain of a scene: selects the tiles of each frame, generates missing ones and keeps them in GPU memory.

use std::sync::Arc;

use lodestream_scene::pose::Pose;
use lodestream_scene::terrain::TerrainEntry;
use lodestream_terrain::{HeightOverrides, Scratch, Terrain};
use lodestream_threads::Task;

#[cfg(any(test, feature = "client"))]
use crate::passes::shadows::Cascade;
use crate::renderer::Renderer;
use crate::resources::gpu::{Gpu, RenderError};
use crate::scene::terrain::layers;
use crate::scene::terrain::{TERRAIN_SLOTS, TerrainAppearance, TerrainFrame, TerrainGpu, TerrainPart};
use crate::scene::tile_generator::TileGenerator;
use crate::scene::vertical_exaggeration::{LEAST_HEIGHT_FACTOR, MAX_VERTICAL_EXAGGERATION};
use lodestream_terrain::tiles::{
    COARSER, PlacedTerrain, SelectedTile, TerrainView, TileId, TileRegion, TileStore, Tiles,
};

/// Most tiles of one frame: 128 triangles each.
const MAX_TILES: usize = 4000;
#[cfg(any(test, feature = "client"))]
/// Most tiles out of view that cast shadows.
const MAX_CASTERS: usize = 1000;
/// Most generated tiles uploaded per frame.
const TILES_PER_FRAME: usize = 400;
/// Most coarser screen errors tried while finer tiles are being generated: a factor of 2^20 in all.
const COARSER_STEPS: u32 = 64;

/// Where tiles are generated.
#[derive(Debug, Default)]
pub enum TileSource {
    /// On the generator's thread; until tiles arrive, coarser ones are drawn.
    Thread(TileGenerator),
    /// On the drawing thread, before the frame is drawn: pictures depend on the pose alone.
    #[default]
    Immediate,
}

/// The terrain of a scene, with its tiles in GPU memory.
#[derive(Debug)]
pub struct TerrainRenderer {
    gpu: TerrainGpu,
    ground: Arc<PlacedTerrain>,
    /// Vertical exaggeration.
    factor: f64,
    /// Incremented with every change of heights; tiles generated for an older version are discarded.
    version: u64,
    store: TileStore,
    parts: Vec<TerrainPart>,
    /// Tiles out of view that may cast shadows into it.
    casters: Vec<TerrainPart>,
    /// Tiles in view that the last frame lacked.
    absent: Vec<TileId>,
    /// Number of shadow-casting tiles out of view that the last frame lacked.
    absent_casters: usize,
    /// View that was prepared last.
    view: Option<TerrainView>,
    regions: Vec<TileRegion>,
    above: f64,
    scratch: Scratch,
    /// Screen error of what is drawn, in pixels.
    drawn_px: f64,
}

/// Task on its own thread that prepares a terrain before there is a device: measures its errors and computes the ground
/// textures.
#[derive(Debug)]
pub struct TerrainMeasurementTask {
    entry: TerrainEntry,
    task: Task<Result<PlacedTerrain, RenderError>>,
}

impl TerrainMeasurementTask {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub fn start(entry: &TerrainEntry) -> std::io::Result<Self> {
        let (entry, measured_entry) = (entry.clone(), entry.clone());
        let measuring = move || {
            let ground = measure(&measured_entry)?;
            layers::texels();
            Ok(ground)
        };
        Ok(Self { entry, task: Task::start("ground", measuring)? })
    }

    fn finish(self) -> Result<PlacedTerrain, RenderError> {
        self.task.finish().unwrap_or_else(|| {
            Err(RenderError::Terrain("measuring its errors failed: the thread panicked".into()))
        })
    }
}

fn measure(entry: &TerrainEntry) -> Result<PlacedTerrain, RenderError> {
    let terrain = Terrain::with_stamps(entry.parameters, entry.stamps.clone())
        .map_err(|why| RenderError::Terrain(why.to_string()))?;
    Ok(PlacedTerrain::new(Arc::new(terrain), entry.unit.into(), entry.height_unit.into()))
}

impl TerrainRenderer {
    /// Creates the terrain of a scene; `begun` is a measurement that may already run for it.
    ///
    /// # Errors
    /// [`RenderError::Terrain`] for invalid parameters; otherwise errors of the graphics device.
    pub fn new(
        gpu: &Gpu,
        renderer: &Renderer,
        entry: &TerrainEntry,
        begun: Option<TerrainMeasurementTask>,
    ) -> Result<Self, RenderError> {
        // The measurement may be another scene's.
        let begun = begun.filter(|begun| begun.entry == *entry);
        let look = TerrainAppearance {
            unit: f64::from(entry.unit),
            height_unit: f64::from(entry.height_unit),
            zones: entry.zones,
        };
        // Measuring the terrain and computing its textures take about ten milliseconds each.
        let begun = begun.or_else(|| TerrainMeasurementTask::start(entry).ok());
        let gpu = renderer.create_terrain(gpu, look)?;
        let ground = begun.map_or_else(|| measure(entry), TerrainMeasurementTask::finish)?;
        Ok(Self {
            gpu,
            ground: Arc::new(ground),
            factor: 1.0,
            version: 0,
            store: TileStore::new(TERRAIN_SLOTS),
            parts: Vec::new(),
            casters: Vec::new(),
            absent: Vec::new(),
            absent_casters: 0,
            view: None,
            regions: Vec::new(),
            above: 0.0,
            scratch: Scratch::new(),
            drawn_px: f64::INFINITY,
        })
    }

    /// Replaces a patch's height overrides; tiles that show it are generated again. Measures the patch, which takes a
    /// millisecond with 257² points.
    ///
    /// # Errors
    /// [`RenderError::Terrain`] if there is no such patch.
    pub fn set_points(&mut self, x: i64, y: i64, points: HeightOverrides) -> Result<(), RenderError> {
        let ground = Arc::make_mut(&mut self.ground);
        let (origin, side) = ground
            .set_points(x, y, points, &mut self.scratch)
            .map_err(|why| RenderError::Terrain(why.to_string()))?;
        self.version += 1;
        self.store.invalidate(origin, side);
        Ok(())
    }

    /// Sets the factor on the terrain's heights from the next frame on: 0 to [`MAX_VERTICAL_EXAGGERATION`], 1 for the
    /// scene's heights. Values outside are clamped; NaN counts as 1. Tiles in GPU memory stay valid.
    ///
    /// [`MAX_VERTICAL_EXAGGERATION`]: crate::MAX_VERTICAL_EXAGGERATION
    pub fn set_vertical_exaggeration(&mut self, factor: f64) {
        let factor = if factor.is_nan() { 1.0 } else { factor };
        let factor = factor.clamp(LEAST_HEIGHT_FACTOR, MAX_VERTICAL_EXAGGERATION);
        if factor != self.factor {
            self.factor = factor;
            Arc::make_mut(&mut self.ground).set_vertical_exaggeration(factor);
            self.gpu.set_vertical_exaggeration(factor);
        }
    }

    /// Factor on the terrain's heights.
    #[must_use]
    pub fn vertical_exaggeration(&self) -> f64 {
        self.factor
    }

    /// Height of the ground at a place, world units.
    pub fn height(&mut self, x: f64, z: f64) -> f64 {
        self.ground.height(x, z, &mut self.scratch)
    }

    /// Prepares the tiles of a frame drawn from `camera` with `size` pixels, for a screen error of `target_px`.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        source: &TileSource,
        camera: &Pose,
        size: (u32, u32),
        target_px: f64,
    ) -> Result<(), RenderError> {
        self.store.begin();
        let view = TerrainView::new(
            &self.ground,
            camera.eye,
            camera.rotation,
            camera.tan_half_fov(size.0, size.1),
            size.1,
            &mut self.scratch,
        );
        self.above = view.above;
        let wanted = self.ground.tiles(&view, target_px, MAX_TILES);
        for part in &wanted.selected {
            self.store.touch(part.tile);
        }
        if let TileSource::Thread(generator) = source {
            for _ in 0..TILES_PER_FRAME {
                let Some(tile) = generator.take() else { break };
                // Discard tiles generated for older heights.
                if tile.version == self.version
                    && let Some(slot) = self.store.insert(tile.id)
                {
                    self.gpu.upload(gpu, slot, &tile.heights)?;
                }
            }
        }
        self.absent = self.store.absent(&wanted.selected);
        let drawn = match source {
            TileSource::Thread(generator) => {
                // Coarse tiles first: they fill the picture soonest.
                self.absent.sort_by_key(|tile| std::cmp::Reverse(tile.spacing));
                generator.request(&self.ground, self.version, self.absent.iter().copied());
                self.finest_available(&view, wanted)
            }
            TileSource::Immediate => wanted,
        };
        self.generate(gpu, &self.store.absent(&drawn.selected))?;
        self.drawn_px = drawn.target_px;
        self.regions = drawn.regions();
        self.parts = self.drawn_parts(&drawn, |tile| drawn.mask(tile));
        self.casters.clear();
        self.absent_casters = 0;
        self.view = Some(view);
        Ok(())
    }

    #[cfg(any(test, feature = "client"))]
    /// Prepares the tiles outside the prepared view that cast shadows into the maps of `cascades`. Tiles that are still
    /// being generated cast none.
    pub(crate) fn prepare_casters(
        &mut self,
        gpu: &Gpu,
        source: &TileSource,
        cascades: &[Cascade],
    ) -> Result<(), RenderError> {
        let Some(view) = self.view else { return Ok(()) };
        let matters = |column| cascades.iter().any(|cascade| cascade.is_reached(column));
        let mut tiles = self.ground.tiles_out_of_view(&view, self.drawn_px, MAX_CASTERS, &matters);
        for part in &tiles.selected {
            self.store.touch(part.tile);
        }
        let absent = self.store.absent(&tiles.selected);
        self.absent_casters = absent.len();
        match source {
            TileSource::Thread(generator) => {
                let requested = self.absent.iter().chain(&absent).copied();
                generator.request(&self.ground, self.version, requested.collect::<Vec<_>>().into_iter());
                tiles.selected.retain(|part| self.store.slot(part.tile).is_some());
            }
            TileSource::Immediate => self.generate(gpu, &absent)?,
        }
        // Rough regions are ignored: shadows from out of view may be slightly coarser.
        self.casters = self.drawn_parts(&tiles, |_| 0);
        Ok(())
    }

    /// Generates and uploads missing tiles, as long as slots are free.
    fn generate(&mut self, gpu: &Gpu, tiles: &[TileId]) -> Result<(), RenderError> {
        let mut heights = Vec::new();
        for &tile in tiles {
            if let Some(slot) = self.store.insert(tile) {
                self.ground.heights(tile, &mut self.scratch, &mut heights);
                self.gpu.upload(gpu, slot, &heights)?;
            }
        }
        Ok(())
    }

    /// The selected tiles that have a slot, as they are drawn.
    fn drawn_parts(&self, tiles: &Tiles, regions: impl Fn(TileId) -> u32) -> Vec<TerrainPart> {
        let part = |selected: &SelectedTile| {
            Some(TerrainPart {
                origin: selected.tile.origin(),
                spacing: selected.tile.spacing,
                slot: self.store.slot(selected.tile)?,
                quadrants: selected.quadrants,
                morph: tiles.morph(selected.tile),
                regions: regions(selected.tile),
            })
        };
        tiles.selected.iter().filter_map(part).collect()
    }

    /// The finest selection whose tiles all have slots. If there is none, the coarsest that was tried: a handful of
    /// tiles, which are then generated at once.
    fn finest_available(&self, view: &TerrainView, wanted: Tiles) -> Tiles {
        let mut tiles = wanted;
        for _ in 0..COARSER_STEPS {
            if self.store.absent(&tiles.selected).is_empty() {
                break;
            }
            tiles = self.ground.tiles(view, tiles.target_px * COARSER, MAX_TILES);
        }
        tiles
    }

    /// Number of tiles that the last frame lacked and that are being generated.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.absent.len() + self.absent_casters
    }

    /// Screen error of the last frame's selection, in pixels.
    #[must_use]
    pub fn drawn_px(&self) -> f64 {
        self.drawn_px
    }

    /// Bytes in GPU memory.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.gpu.bytes()
    }

    /// The frame prepared by [`TerrainRenderer::prepare`].
    #[must_use]
    pub fn frame(&self) -> TerrainFrame<'_> {
        let Self { gpu: terrain, parts, casters, regions, above, drawn_px, .. } = self;
        TerrainFrame { terrain, parts, casters, regions, above: *above, error_px: *drawn_px }
    }
}
