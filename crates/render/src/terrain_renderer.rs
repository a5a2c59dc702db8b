//! The terrain of a scene in GPU memory: which tiles a frame draws, and where missing ones come from.

use std::sync::Arc;
use std::thread::JoinHandle;

use lodestream_scene::pose::Pose;
use lodestream_scene::terrain::TerrainEntry;
use lodestream_terrain::{HeightOverrides, Scratch, Terrain};

use crate::gpu::{Gpu, RenderError};
use crate::renderer::Renderer;
use crate::shadows::Cascade;
use crate::terrain::layers;
use crate::terrain::{TERRAIN_SLOTS, TerrainFrame, TerrainGpu, TerrainLook, TerrainPart};
use crate::tiles::{
    COARSER, GroundView, PlacedTerrain, SelectedTile, TileGenerator, TileId, TileRegion, TileStore, Tiles,
};
use crate::vertical_exaggeration::{LEAST_HEIGHT_FACTOR, MAX_VERTICAL_EXAGGERATION};

/// Tiles of one frame, at most: 128 triangles each.
const MAX_TILES: usize = 4000;
/// Tiles out of view that cast shadows, at most.
const MAX_CASTERS: usize = 1000;
/// Finished tiles taken per frame, at most: each is a small upload.
const TILES_PER_FRAME: usize = 400;
/// Coarser screen errors tried while finer tiles are being made: a factor of 2^20 in all.
const COARSER_STEPS: u32 = 64;

/// Where tiles come from.
#[derive(Debug, Default)]
pub enum TileSource {
    /// A thread of their own makes them; until they are there, coarser ones are drawn.
    Apart(TileGenerator),
    /// The drawing thread makes what a frame needs before it is drawn: pictures are a function of the pose.
    #[default]
    AtOnce,
}

/// See the module.
#[derive(Debug)]
pub struct TerrainRenderer {
    gpu: TerrainGpu,
    ground: Arc<PlacedTerrain>,
    /// What its heights are multiplied by.
    factor: f64,
    /// Grows with every change of the ground.
    state: u64,
    store: TileStore,
    parts: Vec<TerrainPart>,
    /// Tiles out of view that may cast shadows into it.
    casters: Vec<TerrainPart>,
    /// Tiles in view that the last frame lacked.
    absent: Vec<TileId>,
    /// How many of those it lacked that cast shadows from out of view.
    absent_casters: usize,
    /// What was prepared last.
    view: Option<GroundView>,
    regions: Vec<TileRegion>,
    above: f64,
    scratch: Scratch,
    /// Screen error of what is drawn, in pixels.
    drawn_px: f64,
}

/// What of a terrain needs no device, being made on a thread of its own: its errors are measured, and the ground's
/// textures are painted.
#[derive(Debug)]
pub struct TerrainMeasurementTask {
    entry: TerrainEntry,
    thread: JoinHandle<Result<PlacedTerrain, RenderError>>,
}

impl TerrainMeasurementTask {
    /// Begins.
    ///
    /// # Errors
    /// Fails where the system gives no thread.
    pub fn start(entry: &TerrainEntry) -> std::io::Result<Self> {
        let (entry, of) = (entry.clone(), entry.clone());
        let measure = move || {
            let ground = measured(&of)?;
            layers::texels();
            Ok(ground)
        };
        let thread = std::thread::Builder::new().name("ground".into()).spawn(measure)?;
        Ok(Self { entry, thread })
    }

    fn finish(self) -> Result<PlacedTerrain, RenderError> {
        self.thread.join().unwrap_or_else(|_| Err(RenderError::Terrain("measuring it failed".into())))
    }
}

fn measured(entry: &TerrainEntry) -> Result<PlacedTerrain, RenderError> {
    let terrain = Terrain::with_stamps(entry.parameters, entry.stamps.clone())
        .map_err(|why| RenderError::Terrain(why.to_string()))?;
    Ok(PlacedTerrain::new(Arc::new(terrain), entry))
}

impl TerrainRenderer {
    /// The terrain of a scene, which somebody may have begun to measure.
    ///
    /// # Errors
    /// What the graphics device refuses; [`RenderError::Terrain`] for parameters of which no terrain can be made.
    pub fn new(
        gpu: &Gpu,
        renderer: &Renderer,
        entry: &TerrainEntry,
        begun: Option<TerrainMeasurementTask>,
    ) -> Result<Self, RenderError> {
        // What was begun may be another scene's.
        let begun = begun.filter(|begun| begun.entry == *entry);
        let look = TerrainLook {
            unit: f64::from(entry.unit),
            height_unit: f64::from(entry.height_unit),
            zones: entry.zones,
        };
        // TerrainMeasurementTask the ground and painting its textures take some ten milliseconds each.
        let (ground, on_gpu) = std::thread::scope(|scope| {
            let ground =
                scope.spawn(|| begun.map_or_else(|| measured(entry), TerrainMeasurementTask::finish));
            let on_gpu = renderer.create_terrain(gpu, look);
            (ground.join(), on_gpu)
        });
        let ground = ground.map_err(|_| RenderError::Terrain("measuring it failed".into()))??;
        Ok(Self {
            gpu: on_gpu?,
            ground: Arc::new(ground),
            factor: 1.0,
            state: 0,
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

    /// Lists points for a patch, in place of those it had. Tiles that show it are made anew; the patch is measured, which
    /// takes a millisecond with 257² points.
    ///
    /// # Errors
    /// [`RenderError::Terrain`] if there is no such patch.
    pub fn set_points(&mut self, x: i64, y: i64, points: HeightOverrides) -> Result<(), RenderError> {
        let ground = Arc::make_mut(&mut self.ground);
        let (origin, side) = ground
            .set_points(x, y, points, &mut self.scratch)
            .map_err(|why| RenderError::Terrain(why.to_string()))?;
        self.state += 1;
        self.store.forget(origin, side);
        Ok(())
    }

    /// Multiplies the terrain's heights from the next frame on: 0 to [`MAX_VERTICAL_EXAGGERATION`], where 1 leaves them as they
    /// are. Tiles keep their places on the device. What is not within is taken for the nearest that is, what is no number
    /// for 1.
    ///
    /// [`MAX_VERTICAL_EXAGGERATION`]: crate::MAX_VERTICAL_EXAGGERATION
    pub fn multiply_heights(&mut self, factor: f64) {
        let factor = if factor.is_nan() { 1.0 } else { factor };
        let factor = factor.clamp(LEAST_HEIGHT_FACTOR, MAX_VERTICAL_EXAGGERATION);
        if factor != self.factor {
            self.factor = factor;
            Arc::make_mut(&mut self.ground).multiply_heights(factor);
            self.gpu.multiply_heights(factor);
        }
    }

    /// What heights are multiplied by.
    #[must_use]
    pub fn vertical_exaggeration(&self) -> f64 {
        self.factor
    }

    /// Height of the ground at a place, world units.
    pub fn height(&mut self, x: f64, z: f64) -> f64 {
        self.ground.height(x, z, &mut self.scratch)
    }

    /// Prepares what a frame draws from `camera` into a picture of `size` pixels, for a screen error of `target_px`.
    ///
    /// # Errors
    /// What the graphics device refuses.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        making: &TileSource,
        camera: &Pose,
        size: (u32, u32),
        target_px: f64,
    ) -> Result<(), RenderError> {
        self.store.begin();
        let view = GroundView::new(&self.ground, camera, size, &mut self.scratch);
        self.above = view.above;
        let wanted = self.ground.tiles(&view, target_px, MAX_TILES);
        for picked in &wanted.picked {
            self.store.touch(picked.tile);
        }
        if let TileSource::Apart(maker) = making {
            for _ in 0..TILES_PER_FRAME {
                let Some(tile) = maker.take() else { break };
                // What was made of an older ground may be wrong.
                if tile.state == self.state
                    && let Some(slot) = self.store.insert(tile.id)
                {
                    self.gpu.upload(gpu, slot, &tile.heights)?;
                }
            }
        }
        self.absent = self.store.absent(&wanted.picked);
        let drawn = match making {
            TileSource::Apart(maker) => {
                // Coarse ones first: the picture is whole the sooner.
                self.absent.sort_by_key(|tile| std::cmp::Reverse(tile.spacing));
                maker.wish(&self.ground, self.state, self.absent.iter().copied());
                self.finest_held(&view, wanted)
            }
            TileSource::AtOnce => wanted,
        };
        self.make(gpu, &self.store.absent(&drawn.picked))?;
        self.drawn_px = drawn.target_px;
        self.regions = drawn.regions();
        self.parts = self.placed(&drawn, |tile| drawn.mask(tile));
        self.casters.clear();
        self.absent_casters = 0;
        self.view = Some(view);
        Ok(())
    }

    /// Prepares what of the ground out of the view that was prepared casts shadows into the maps of `cascades`. What another
    /// thread has not made yet casts none.
    pub(crate) fn prepare_casters(
        &mut self,
        gpu: &Gpu,
        making: &TileSource,
        cascades: &[Cascade],
    ) -> Result<(), RenderError> {
        let Some(view) = self.view else { return Ok(()) };
        let matters = |column| cascades.iter().any(|cascade| cascade.is_reached(column));
        let mut tiles = self.ground.tiles_out_of_view(&view, self.drawn_px, MAX_CASTERS, &matters);
        for picked in &tiles.picked {
            self.store.touch(picked.tile);
        }
        let absent = self.store.absent(&tiles.picked);
        self.absent_casters = absent.len();
        match making {
            TileSource::Apart(maker) => {
                let wished = self.absent.iter().chain(&absent).copied();
                maker.wish(&self.ground, self.state, wished.collect::<Vec<_>>().into_iter());
                tiles.picked.retain(|picked| self.store.slot(picked.tile).is_some());
            }
            TileSource::AtOnce => self.make(gpu, &absent)?,
        }
        // Where ground is rougher, what is out of view may be a little coarser than elsewhere.
        self.casters = self.placed(&tiles, |_| 0);
        Ok(())
    }

    /// Makes tiles that are not held, as far as there is room for them.
    fn make(&mut self, gpu: &Gpu, tiles: &[TileId]) -> Result<(), RenderError> {
        let mut heights = Vec::new();
        for &tile in tiles {
            if let Some(slot) = self.store.insert(tile) {
                self.ground.heights(tile, &mut self.scratch, &mut heights);
                self.gpu.upload(gpu, slot, &heights)?;
            }
        }
        Ok(())
    }

    /// Those tiles that are held, as they are drawn.
    fn placed(&self, tiles: &Tiles, regions: impl Fn(TileId) -> u32) -> Vec<TerrainPart> {
        let part = |picked: &SelectedTile| {
            Some(TerrainPart {
                origin: picked.tile.origin(),
                spacing: picked.tile.spacing,
                slot: self.store.slot(picked.tile)?,
                quadrants: picked.quadrants,
                morph: tiles.morph(picked.tile),
                regions: regions(picked.tile),
            })
        };
        tiles.picked.iter().filter_map(part).collect()
    }

    /// The finest selection of which everything is held; if there is none, the coarsest that was tried, a handful of
    /// tiles that are then made at once.
    fn finest_held(&self, view: &GroundView, wanted: Tiles) -> Tiles {
        let mut tiles = wanted;
        for _ in 0..COARSER_STEPS {
            if self.store.absent(&tiles.picked).is_empty() {
                break;
            }
            tiles = self.ground.tiles(view, tiles.target_px * COARSER, MAX_TILES);
        }
        tiles
    }

    /// Tiles that the last frame lacked and that are being made.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.absent.len() + self.absent_casters
    }

    /// Screen error that the last frame's tiles were chosen for, in pixels.
    #[must_use]
    pub fn drawn_px(&self) -> f64 {
        self.drawn_px
    }

    /// Bytes in GPU memory.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.gpu.bytes()
    }

    /// What [`TerrainRenderer::prepare`] prepared.
    #[must_use]
    pub fn frame(&self) -> TerrainFrame<'_> {
        let Self { gpu: terrain, parts, casters, regions, above, drawn_px, .. } = self;
        TerrainFrame { terrain, parts, casters, regions, above: *above, error_px: *drawn_px }
    }
}
