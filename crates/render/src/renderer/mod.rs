//! The renderer: its state between frames, and the planning of a frame. `passes` records the planned passes.

mod memory;
mod passes;

use std::sync::Arc;

use glam::DVec3;
use lodestream_scene::asset::Material;

use crate::frame::accumulation::Accumulation;
use crate::frame::batch::Meshes;
use crate::frame::compiler::Compiler;
use crate::frame::composite::Composites;
use crate::frame::counters::Counters;
use crate::frame::draw::{DrawList, ListMemory};
use crate::frame::draw_calls::DrawCalls;
use crate::frame::draw_groups::DrawGroups;
use crate::frame::fullscreen::depth_attachment;
use crate::frame::graph::{self, Needs, PassId, Resource};
use crate::frame::pipelines::Pipelines;
use crate::frame::placed::PlacedInstances;
use crate::frame::settings::{AntiAliasing, DebugView, Frame, MAX_ANISOTROPY, MIN_RENDER_SCALE, Settings};
use crate::frame::target::{Load, Target};
use crate::frame::targets::Targets;
use crate::frame::timing::{PassEncoder, Timer, Timings};
use crate::frame::uniforms::FrameUniform;
use crate::passes::bloom::{Bloom, BloomPass};
use crate::passes::debug::{self, DebugPipelines};
use crate::passes::floor::{FloorPass, FloorPlace};
#[cfg(any(test, feature = "methods"))]
use crate::passes::ink::{InkPass, StrokeInputs};
use crate::passes::occlusion::OcclusionNormals;
#[cfg(any(test, feature = "methods"))]
use crate::passes::occlusion_layers::Layers;
#[cfg(any(test, feature = "methods"))]
use crate::passes::pn_triangles::PatchInputs;
use crate::passes::pn_triangles::PatchLists;
use crate::passes::reflections::{ReflectionMethod, Tracer};
use crate::passes::shadows::{self, Casters, ShadowMaps, Sun};
use crate::passes::sky::SkyGpu;
use crate::passes::temporal::{Temporal, TemporalStep};
use crate::passes::water::{WaterPass, WaterView};
use crate::resources::buffer::GrowingBuffer;
use crate::resources::descriptors::uniform_buffer;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::texture::Texture;
use crate::resources::texture_shape::TextureShape;
use crate::resources::texture_tiles::TextureTileUse;
use crate::scene::asset::AssetGpu;
use crate::scene::bound_material::Features;
use crate::scene::environment::Environment;
use crate::scene::lights::{PunctualLightList, PunctualLightPass};
use crate::scene::material_bindings::MaterialBindings;
use crate::scene::mesh_pools::MeshPools;
use crate::scene::placement::InstanceRaw;
use crate::scene::terrain::{TerrainAppearance, TerrainGpu, TileList, TileRaw};

/// Draws frames into targets of one format.
#[derive(Debug)]
pub struct Renderer {
    kit: MaterialBindings,
    pools: MeshPools,
    pipelines: Arc<Pipelines>,
    composites: Composites,
    debug: DebugPipelines,
    targets: Targets,
    frame_buffer: wgpu::Buffer,
    frame_group: wgpu::BindGroup,
    /// Group 2 of meshes: pages and page table of textures.
    texture_tiles: wgpu::BindGroup,
    /// Placements of the last frame's drawables.
    placed: PlacedInstances,
    memory: ListMemory,
    instances: GrowingBuffer<InstanceRaw>,
    calls: DrawCalls,
    patches: PatchLists,
    tiles: GrowingBuffer<TileRaw>,
    shadow_maps: ShadowMaps,
    /// Once a frame has had a studio.
    floor: Option<FloorPass>,
    sky: SkyGpu,
    punctual_lights: PunctualLightPass,
    water: WaterPass,
    tracer: Tracer,
    bloom: BloomPass,
    #[cfg(any(test, feature = "methods"))]
    ink: InkPass,
    #[cfg(any(test, feature = "methods"))]
    layers: Layers,
    temporal: Temporal,
    accumulation: Accumulation,
    target_format: wgpu::TextureFormat,
    warned_wireframe: bool,
    warned_patches: bool,
    warned_ink: bool,
    /// Set while passes are timed.
    timer: Option<Timer>,
}

impl Renderer {
    /// Creates a renderer for targets of `target_format`. A format with sRGB encodes by itself; with any other the
    /// shader applies the sRGB curve, so both show the same picture. Compiles the pipelines of [`Settings::default`];
    /// others are compiled by the first frame that needs them.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device refuses a shader or pipeline.
    pub fn new(gpu: &Gpu, target_format: wgpu::TextureFormat) -> Result<Self, RenderError> {
        let this = Self::without_pipelines(gpu, target_format)?;
        this.compiler(gpu, &Settings::default(), false).compile();
        gpu.check()?;
        Ok(this)
    }

    /// Creates a renderer without compiling pipelines: [`Renderer::compiler`] compiles them on the caller's threads,
    /// else each frame compiles what it lacks.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device refuses a buffer or texture.
    pub fn without_pipelines(gpu: &Gpu, target_format: wgpu::TextureFormat) -> Result<Self, RenderError> {
        let kit = MaterialBindings::new(gpu);
        let pipelines = Arc::new(Pipelines::new(gpu, &kit, target_format));
        let frame_buffer = uniform_buffer::<FrameUniform>(gpu, "frame");
        let frame_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: &pipelines.frame_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: frame_buffer.as_entire_binding() }],
        });
        let shadow_maps = ShadowMaps::new(gpu, &pipelines.frame_layout);
        let read = gpu.curve_usage();
        let temporal = Temporal::new(Arc::clone(&pipelines.resolve), read);
        gpu.check()?;
        Ok(Self {
            texture_tiles: kit.tiles.begin_frame(gpu, f32::MAX),
            kit,
            pools: MeshPools::new(gpu),
            pipelines,
            composites: Composites::default(),
            debug: DebugPipelines::default(),
            targets: Targets::default(),
            frame_buffer,
            frame_group,
            instances: GrowingBuffer::new("instance buffer", wgpu::BufferUsages::VERTEX | read),
            placed: PlacedInstances::default(),
            memory: ListMemory::default(),
            calls: DrawCalls::default(),
            patches: PatchLists::default(),
            tiles: GrowingBuffer::new("terrain tiles", wgpu::BufferUsages::VERTEX),
            floor: None,
            shadow_maps,
            sky: SkyGpu::new(gpu),
            punctual_lights: PunctualLightPass::new(gpu),
            water: WaterPass::new(gpu),
            tracer: Tracer::new(gpu),
            bloom: BloomPass::default(),
            #[cfg(any(test, feature = "methods"))]
            ink: InkPass::default(),
            #[cfg(any(test, feature = "methods"))]
            layers: Layers::default(),
            temporal,
            accumulation: Accumulation::default(),
            target_format,
            warned_wireframe: false,
            warned_patches: false,
            warned_ink: false,
            timer: None,
        })
    }

    /// The format of the targets that this renderer draws into.
    #[must_use]
    pub fn target_format(&self) -> wgpu::TextureFormat {
        self.target_format
    }

    /// A compiler for the pipelines that frames with these settings need, optionally with terrain or the ground of a
    /// studio (`ground`).
    #[must_use]
    pub fn compiler(&self, gpu: &Gpu, settings: &Settings, ground: bool) -> Compiler {
        Compiler::new(gpu, &self.pipelines, settings, ground)
    }

    /// Turns timing of passes on or off from the next frame. Costs two timestamp queries a pass, read back without
    /// waiting.
    pub fn time_passes(&mut self, gpu: &Gpu, on: bool) {
        match (&self.timer, on) {
            (None, true) => self.timer = Some(Timer::new(gpu)),
            (_, false) => self.timer = None,
            (Some(_), true) => {}
        }
    }

    /// Times of the last frames, of which the newest may be pending; empty unless requested by
    /// [`Renderer::time_passes`].
    pub fn timings(&mut self) -> Timings {
        self.timer.as_mut().map(Timer::timings).unwrap_or_default()
    }

    /// Creates an empty asset. Vertex positions are relative to `origin` (asset units); materials refer to `textures`
    /// by index.
    #[must_use]
    pub fn create_asset(
        &self,
        gpu: &Gpu,
        origin: DVec3,
        materials: &[Material],
        textures: &[TextureShape],
    ) -> AssetGpu {
        let textures = textures.iter().map(|shape| Texture::new(gpu, *shape)).collect();
        self.create_asset_with(gpu, origin, materials, textures)
    }

    /// Creates an empty asset with textures that other assets may share.
    #[must_use]
    pub fn create_asset_with(
        &self,
        gpu: &Gpu,
        origin: DVec3,
        materials: &[Material],
        textures: Vec<Texture>,
    ) -> AssetGpu {
        for material in materials {
            let mut named = material.textures().filter_map(|texture| textures.get(usize::from(texture)));
            let features = Features { tiled: named.any(Texture::is_tiled), ..Features::of(material) };
            self.pipelines.meshes.ensure(gpu, features);
        }
        AssetGpu::new(gpu, (self.kit.clone(), &self.pools), origin, materials, textures)
    }

    /// Memory of the tiles of textures ([`Texture::set_tile`]).
    #[must_use]
    pub fn texture_tiles(&self, gpu: &Gpu) -> TextureTileUse {
        self.kit.tiles.used(gpu)
    }

    /// Sets the most memory that tiles of textures take, in bytes (default: 256 MiB). It is allocated as tiles come, by
    /// replacing an array with a larger one. Both are within the budget, so tiles can fill two thirds to five sixths of
    /// it. A smaller budget takes effect as tiles are removed.
    pub fn set_texture_tile_budget(&self, bytes: u64) {
        self.kit.tiles.set_budget(bytes);
    }

    /// Whether tiles of textures fade in, so that a frame at a later time differs from the last one.
    #[must_use]
    pub fn fades_texture_tiles(&self) -> bool {
        self.kit.tiles.are_fading()
    }

    /// Creates a terrain without tiles.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] where the device cannot hold the atlas of tiles, [`RenderError::Device`] if it
    /// refuses it.
    pub fn create_terrain(&self, gpu: &Gpu, look: TerrainAppearance) -> Result<TerrainGpu, RenderError> {
        TerrainGpu::new(gpu, self.pipelines.terrain(gpu), look)
    }

    /// Records a frame into `target`. Uploads happen at once, drawing when the
    /// caller submits `encoder` to the device's queue; one frame must be submitted before the next
    /// is recorded.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] for a size that the device cannot draw (or 0), [`RenderError::Target`] for views
    /// that cannot be drawn into, and [`RenderError::Device`] with the first error that wgpu reported since the
    /// last frame.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &Target<'_>,
        frame: &Frame<'_>,
    ) -> Result<Counters, RenderError> {
        target.check(self.target_format)?;
        self.pools.begin_frame();
        self.texture_tiles = self.kit.tiles.begin_frame(gpu, frame.time_s);
        let mut passes = PassEncoder::new(encoder, self.timer.as_mut().map(Timer::begin));
        let (size, mut counters) = (drawn_size(target, frame.settings.render_scale), Counters::default());
        self.placed.update(frame.drawables);
        let placed = &self.placed;
        let memory = std::mem::take(&mut self.memory);
        let mut list = DrawList::new(frame, size, placed, memory, &mut counters);
        // The eye of a parallel projection has no distance that haze could thicken with.
        let has_haze = frame.settings.haze && !frame.camera.is_orthographic();
        let haze = frame.environment.haze.filter(|_| has_haze);
        let sky = self.sky.light(gpu, &Environment { haze, ..frame.environment }, frame.sky);
        let shadows = frame.settings.shadows.filter(|_| sky.sun.max_element() > 0.0);
        let shadows = shadows.map(|shadows| shadows.clamped(gpu.device.limits().max_texture_dimension_2d));
        let cascades = shadows.map(|shadows| shadows::of_frame(frame, &list, shadows));
        let cascades = cascades.unwrap_or_default();
        let mut casters: Vec<Casters<'_>> = Vec::new();
        if let Some(shadows) = shadows {
            casters = self.shadow_maps.casters((&cascades, shadows.map_side), frame, placed);
        }
        let floor_place = shadows
            .filter(|_| target.load == Load::Clear)
            .and_then(|_| FloorPlace::new(frame, placed, (sky.to_sun, sky.up, sky.side)));
        let ground = match frame.terrain {
            Some(terrain) => {
                Some(TileList::new(gpu, terrain, frame.camera.eye, &mut casters, &mut self.tiles)?)
            }
            None => None,
        };
        let ground = ground.filter(|ground| !ground.is_empty());
        let wireframe =
            frame.settings.wireframe && self.pipelines.meshes.wire(gpu, Features::default()).is_some();
        if frame.settings.wireframe && !wireframe && !self.warned_wireframe {
            tracing::warn!("{} cannot draw wireframes; they are left out", gpu.describe());
            self.warned_wireframe = true;
        }
        let ink = frame.settings.draws_ink(gpu);
        if frame.settings.asks_for_ink() && !ink && !self.warned_ink {
            tracing::warn!("{} cannot draw in ink; it is left out", gpu.describe());
            self.warned_ink = true;
        }
        let curved = frame.settings.curves(gpu);
        if frame.settings.asks_for_curves().is_some() && !gpu.can_curve() && !self.warned_patches {
            tracing::warn!("{} cannot draw curved patches; triangles stay flat", gpu.describe());
            self.warned_patches = true;
        }
        // Water is not drawn from below its surface.
        let water = frame.water.filter(|_| frame.settings.water);
        let water = water.and_then(|water| water.view_from(frame.camera.eye));
        let has_surfaces = !list.batches.is_empty() || ground.is_some() || water.is_some();
        let ambient = frame.settings.occlusion.filter(|o| o.strength > 0.0 && has_surfaces);
        let accumulated = self.accumulation.begin((frame, placed), ambient, size);
        let occlusion = ambient.is_some();
        let lit = !frame.lights.is_empty() && PunctualLightPass::is_possible(gpu);
        let through = frame.settings.transparency && list.blends;
        let culling = frame.settings.lights.filter(|_| lit);
        let punctual_lights = culling.map(|culling| PunctualLightList::new(frame, culling, size, through));
        let punctual_lights = punctual_lights.filter(|list| !list.punctual_lights.is_empty());
        let smoothed = match frame.settings.anti_aliasing {
            _ if target.depth.is_some() || target.load == Load::Keep => AntiAliasing::None,
            anti_aliasing => anti_aliasing,
        };
        let seen = frame.settings.debug_view == DebugView::Motion;
        let temporal = smoothed == AntiAliasing::Temporal && frame.settings.debug_view.is_lit();
        let (step, moving) = if has_surfaces && (temporal || seen) {
            let over = |water: &WaterView| [water.height, water.extinction.y].map(|x| x as f32);
            let water = water.as_ref().map_or([0.0; 2], over);
            self.temporal.begin(gpu, (frame, &list, placed), size, (temporal, water))?
        } else {
            self.temporal.forget();
            (TemporalStep::NONE, Vec::new())
        };
        let reflections = frame.settings.reflections;
        let there = [occlusion, !casters.is_empty(), punctual_lights.is_some(), !moving.is_empty()];
        let shown = debug::shown(frame.settings.debug_view, there);
        let plan = graph::plan(
            &graph::candidates(Needs {
                geometry: has_surfaces,
                sections: !frame.settings.sections.is_empty(),
                curved: curved.is_some(),
                specular: list.specular,
                occlusion,
                drawn_normals: accumulated.normals == OcclusionNormals::Drawn,
                half_occlusion: accumulated.half,
                still: (accumulated.number > 0).then_some(accumulated.done),
                shadows: !casters.is_empty(),
                floor: floor_place.is_some(),
                punctual_lights: punctual_lights.is_some(),
                emission: frame.settings.emission && list.emits,
                reflections: reflections.map(|reflections| reflections.method == ReflectionMethod::HiZ),
                bloom: frame.settings.bloom.and_then(Bloom::share).is_some(),
                water: water.is_some(),
                transparency: through,
                shown: shown.map(|(_, reads)| reads),
                ink,
                wireframe,
                motion: !moving.is_empty(),
                temporal,
                antialias: smoothed == AntiAliasing::Spatial,
                enlarged: size != target.size,
                depth: target.depth.is_some(),
                keep: target.load == Load::Keep,
            }),
            &[Resource::Target],
        );
        self.targets.ensure(gpu, size, &graph::resources(&plan))?;
        let mut redrawn = Vec::new();
        if let Some(shadows) = shadows.filter(|_| plan.iter().any(|pass| pass.id == PassId::ShadowMaps)) {
            let ground_px = frame.terrain.map(|terrain| terrain.error_px);
            redrawn = self.shadow_maps.begin(gpu, shadows, &casters, ground_px, &mut counters);
            for (casters, _) in casters.iter_mut().zip(&redrawn).filter(|(_, redrawn)| **redrawn) {
                casters.add_meshes(&mut list, frame, placed);
            }
        }
        let floor_place = floor_place.filter(|_| plan.iter().any(|pass| pass.id == PassId::Floor));
        let mut floor = floor_place.as_ref().map(|place| {
            let pass = self.floor.get_or_insert_with(|| FloorPass::new(gpu, &self.pipelines.frame_layout));
            pass.begin(gpu, place, (frame, placed), &mut counters)
        });
        if let Some(floor) = &mut floor {
            floor.redrawn_casters().for_each(|casters| casters.add_meshes(&mut list, frame, placed));
        }
        self.instances.write(gpu, 0, &list.instances)?;
        #[cfg(any(test, feature = "methods"))]
        self.patches.clear();
        #[cfg(any(test, feature = "methods"))]
        if let (Some(settings), Some(instances)) = (curved, self.instances.buffer()) {
            let before = self.temporal.before().filter(|_| !moving.is_empty());
            let on_floor = floor.iter().flat_map(|floor| floor.casters.iter().flatten());
            let casters = casters.iter().chain(on_floor).flat_map(|casters| &casters.batches);
            let seen = list.batches.iter().flat_map(|batch| batch.listed(true));
            let parts = seen.chain(casters.flat_map(|batch| batch.listed(false)));
            let inputs = PatchInputs { settings, instances, before };
            self.patches.plan(gpu, self.pipelines.patches(gpu, settings, false), inputs, parts)?;
        }
        self.calls.clear();
        let lists = curved.map(|_| &self.patches);
        let groups = DrawGroups::new(&list.batches, placed, lists, &mut self.calls);
        let moving_groups = DrawGroups::new(&moving, placed, lists, &mut self.calls);
        let on_floor = floor.iter_mut().flat_map(|floor| floor.casters.iter_mut().flatten());
        for casters in casters.iter_mut().chain(on_floor) {
            casters.groups = DrawGroups::new(&casters.batches, placed, lists, &mut self.calls);
        }
        self.calls.upload(gpu)?;
        if let Some(punctual_lights) = &punctual_lights {
            self.punctual_lights.prepare(gpu, punctual_lights)?;
        }
        if let Some(reflections) = reflections {
            self.tracer.prepare(gpu, reflections, size);
        }
        #[cfg(any(test, feature = "methods"))]
        if occlusion && accumulated.method.is_layered() {
            self.layers.prepare(gpu, size);
        }
        if frame.settings.bloom.is_some() {
            self.bloom.prepare(gpu, size);
        }
        #[cfg(any(test, feature = "methods"))]
        match frame.settings.ink.filter(|_| ink && plan.iter().any(|pass| pass.id == PassId::Ink)) {
            Some(ink) => {
                let seen = StrokeInputs { frame, batches: &list.batches, instances: self.instances.buffer() };
                self.ink.prepare(gpu, self.pipelines.ink(gpu), &ink, &seen)?;
            }
            None => self.ink.clear(),
        }
        if let Some(water) = &water {
            self.water.prepare(gpu, water);
        }
        let lookups = frame.settings.anisotropy.clamp(1, MAX_ANISOTROPY) as f32;
        let lookups = if gpu.has_anisotropic_filter() { -lookups } else { lookups };
        let uniform = FrameUniform::new(frame, &sky, size, target.size, &step, lookups, accumulated);
        gpu.queue.write_buffer(&self.frame_buffer, 0, bytemuck::bytes_of(&uniform));
        let runs = |id| plan.iter().any(|pass| pass.id == id);
        if let Some((shown, _)) = shown.filter(|_| runs(PassId::Debug)) {
            self.debug.ensure(gpu, self.target_format, shown, target);
        } else if runs(PassId::Composite) {
            self.composites.ensure(gpu, self.target_format, target);
        } else if target.load == Load::Clear {
            clear_depth(passes.encoder, target);
        }
        if casters.is_empty() && (runs(PassId::Transparency) || runs(PassId::Water)) {
            self.shadow_maps.none(gpu);
        }
        passes.planned();
        if let Some(shadows) = shadows
            && runs(PassId::ShadowMaps)
        {
            let sunken = frame.settings.relief && frame.settings.relief_in_depth;
            let eye = frame.camera.eye;
            let (cascades, redrawn) = (casters.as_slice(), redrawn.as_slice());
            let sun = Sun { shadows, cascades, redrawn, frame: &uniform, eye, sunken };
            let of_meshes = (&self.instances, &self.patches, &self.calls, &self.texture_tiles);
            let meshes = meshes(gpu, frame, &self.pipelines, of_meshes);
            self.shadow_maps.record(
                gpu,
                &mut passes,
                &sun,
                (meshes, &self.frame_group),
                |pass, cascade| match (&ground, self.tiles.buffer()) {
                    (Some(ground), Some(tiles)) => {
                        ground.cast(pass, self.pipelines.terrain(gpu).caster(gpu), tiles, cascade)
                    }
                    _ => 0,
                },
                &mut counters,
            );
            passes.recorded(PassId::ShadowMaps);
        }
        if let (Some(floor), Some(pass)) = (&floor, &mut self.floor) {
            let sunken = frame.settings.relief && frame.settings.relief_in_depth;
            let of_meshes = (&self.instances, &self.patches, &self.calls, &self.texture_tiles);
            let meshes = meshes(gpu, frame, &self.pipelines, of_meshes);
            let pipelines = (self.pipelines.floor(gpu), &mut passes);
            let seen = (floor, &uniform, frame.camera.eye, sunken);
            pass.record(gpu, pipelines, seen, (meshes, &self.frame_group), &mut counters);
        }
        for pass in &plan {
            let drawn = (&list, ground.as_ref(), [&groups, &moving_groups]);
            self.run(gpu, &mut passes, *pass, target, (frame, accumulated), drawn, &mut counters);
            passes.recorded(pass.id);
            counters.passes.push(pass.id);
        }
        counters.still_frames = if temporal && has_surfaces { self.temporal.still_frames() } else { 0 };
        counters.occlusion_frames_left = accumulated.left;
        passes.end(self.timer.as_mut());
        drop((groups, moving_groups));
        self.memory = list.into_memory();
        gpu.check()?;
        Ok(counters)
    }

    /// The shadow maps.
    #[cfg(test)]
    pub(crate) fn shadow_maps(&self) -> &ShadowMaps {
        &self.shadow_maps
    }

    /// The ground of a studio, once a frame has had one.
    #[cfg(test)]
    pub(crate) fn floor(&self) -> Option<&FloorPass> {
        self.floor.as_ref()
    }

    /// Memory of meshes.
    #[cfg(any(test, feature = "client"))]
    pub(crate) fn mesh_pools(&self) -> &MeshPools {
        &self.pools
    }

    /// Number of materials in use.
    #[cfg(test)]
    pub(crate) fn bound_materials(&self) -> usize {
        self.kit.cache.len()
    }

    /// Number of sky maps computed while a frame waited for them.
    #[cfg(test)]
    pub(crate) fn skies_computed(&self) -> u32 {
        self.sky.computed
    }

    #[cfg(any(test, feature = "methods"))]
    /// Number of meshes whose edges were extracted since ink was last off.
    #[cfg(test)]
    pub(crate) fn edges_found(&self) -> u32 {
        self.ink.found
    }

    /// Temporal step of the last frame.
    #[cfg(test)]
    pub(crate) fn temporal_step(&self) -> TemporalStep {
        self.temporal.step()
    }

    /// The intermediate texture of a resource, if the last frame's plan had it.
    pub(crate) fn intermediate(&self, resource: Resource) -> Option<&wgpu::Texture> {
        if resource == Resource::History { self.temporal.history() } else { self.targets.texture(resource) }
    }
}

/// Pipelines and buffers of a frame's meshes, if it has some.
fn meshes<'a>(
    gpu: &Gpu,
    frame: &Frame<'_>,
    pipelines: &'a Pipelines,
    (instances, lists, calls, tiles): (
        &'a GrowingBuffer<InstanceRaw>,
        &'a PatchLists,
        &'a DrawCalls,
        &'a wgpu::BindGroup,
    ),
) -> Option<Meshes<'a>> {
    let cut = !frame.settings.sections.is_empty();
    let curved = frame.settings.curves(gpu).map(|settings| (pipelines.patches(gpu, settings, cut), lists));
    Some(Meshes {
        plain: pipelines.meshes_of(gpu, cut),
        instances: instances.buffer()?,
        curved,
        calls,
        tiles,
    })
}

/// The render size for a target.
fn drawn_size(target: &Target<'_>, scale: f32) -> (u32, u32) {
    let enlarged = scale < 1.0;
    if target.depth.is_some() || target.load == Load::Keep || !enlarged {
        return target.size;
    }
    (drawn_side(target.size.0, scale), drawn_side(target.size.1, scale))
}

/// The side of a picture that is drawn at a scale: at least a pixel, at most the target's side.
fn drawn_side(side: u32, scale: f32) -> u32 {
    ((side as f32 * scale.max(MIN_RENDER_SCALE)).round() as u32).clamp(1.min(side), side)
}

/// Clears a target's depth when no surface is drawn.
fn clear_depth(encoder: &mut wgpu::CommandEncoder, target: &Target<'_>) {
    if target.depth.is_some() {
        // The pass only clears.
        drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("clear depth"),
            color_attachments: &[],
            depth_stencil_attachment: depth_attachment(target),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        }));
    }
}
