//! The scene in GPU memory: applies a client's changes to the renderer's assets and draws frames.

mod animation;
mod parts;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use glam::{DVec3, Vec3};
use lodestream_client::core::{Change, NewAsset, TextureChange};
use lodestream_scene::animation::{Animations, Moment};
use lodestream_scene::asset::tile_place;
use lodestream_scene::blob::Tile;
use lodestream_scene::description::SceneHeader;
use lodestream_scene::placement::Placement;
use lodestream_scene::pose::Pose;
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::surroundings::Surroundings;
use lodestream_scene::view::View;
use lodestream_threads::Task;

use crate::frame::counters::Counters;
use crate::frame::draw::{DrawList, ListMemory};
use crate::frame::placed::PlacedInstances;
use crate::frame::settings::{Drawable, Frame, Settings, Shadows};
use crate::frame::target::Target;
use crate::passes::shadows;
use crate::passes::sky::{SkyMaps, studio_white};
use crate::passes::water::Water;
use crate::renderer::Renderer;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::texture::{Texture, WeakTexture};
use crate::resources::texture_shape::TextureShape;
use crate::resources::uploads::Uploads;
use crate::scene::animated_placements;
use crate::scene::asset::AssetGpu;
use crate::scene::drawn_placements::DrawnPlacements;
use crate::scene::environment::{Atmosphere, Environment, GradientSky, Haze, Sky, Studio};
use crate::scene::held_texels::{HeldTexels, Texels};
use crate::scene::scene_parts::SceneParts;
use crate::scene::streamed_mesh::StreamedMeshChange;
use crate::scene::terrain_anchored::TerrainAnchored;
use crate::scene::terrain_renderer::{TerrainMeasurementTask, TerrainRenderer, TileSource};
use crate::scene::tile_generator::TileGenerator;
use crate::scene::vertical_exaggeration::{VerticalExaggeration, VerticalExaggerationError};

/// Terrain's screen error as a multiple of that of meshes. Its normals come from a surface twice as fine, so its
/// picture is as accurate as with the meshes' error and its own normals.
const GROUND_ERRORS: f64 = 2.4;

/// Exposed radiance of a white surface that faces the sun: near the upper end of the tone curve.
const SUNLIT_WHITE: f32 = 1.6;
/// Of one that faces a studio's key light: lower on the tone curve, so that the sides of pale objects differ.
const STUDIO_WHITE: f32 = 1.3;
/// Meteorological range as a multiple of half the terrain's side: a fifth of the contrast remains at the terrain's
/// border.
const HAZE_OVER_REACH: f64 = 2.0;

/// The scene in GPU memory, as far as it has arrived.
#[derive(Debug, Default)]
pub struct SceneView {
    header: Option<SceneHeader>,
    /// By asset number; `None` until the base mesh has arrived.
    assets: Vec<Option<AssetGpu>>,
    /// Textures in use, by the asset and texture under which they are sent.
    textures: BTreeMap<(u32, u16), WeakTexture>,
    /// Placements by asset number.
    instances: Vec<Vec<Placement>>,
    /// Parts that are hidden, tinted or isolated.
    parts: SceneParts,
    /// Placements that are drawn, if there are proxies.
    drawn: DrawnPlacements,
    /// Light and sky use the description's colours, without an atmosphere.
    plain: bool,
    /// Steps that wait for upload.
    waiting: VecDeque<VecDeque<Change>>,
    /// The mesh change before them that is partly staged.
    refining: Option<StreamedMeshChange>,
    /// Assets with buffers that have become too large.
    shrunk: BTreeSet<u32>,
    /// Staged mesh data that is not submitted yet.
    uploads: Uploads,
    /// Uploaded rows of the texture level at the front of `waiting`.
    rows: u32,
    /// Everything that the first frame needs is uploaded.
    whole: bool,
    /// Time of the last mesh change, in seconds of the core's clock.
    changed_s: f32,
    /// The scene has punctual lights, whether or not they have arrived.
    has_punctual_lights: bool,
    /// Arrived punctual lights by page: sums over them have one order, whatever the order of arrival.
    punctual_light_pages: BTreeMap<u32, Arc<[PunctualLight]>>,
    /// The same in one list.
    lights: Vec<PunctualLight>,
    /// The scene's terrain, if it has one.
    ground: Option<TerrainRenderer>,
    /// Vertical exaggeration.
    heights: VerticalExaggeration,
    /// Terrain-anchored objects, while heights are exaggerated.
    anchored: Option<TerrainAnchored>,
    tile_source: TileSource,
    /// Placements as they were when terrain was last prepared with shadows.
    placed: PlacedInstances,
    /// The terrain measurement of a scene that waits for upload.
    terrain_task: Option<TerrainMeasurementTask>,
    /// The sky maps of a scene that waits for upload, or of the current one.
    sky_task: Option<Task<SkyMaps>>,
    sky: Option<SkyMaps>,
    /// Texels that the host has decoded.
    held: HeldTexels,
    /// Animated models that have arrived.
    animations: Animations,
    /// What is shown of them.
    moment: Option<Moment>,
    /// Placements of the assets of which instances are moved by that, by asset number.
    animated: BTreeMap<u32, Vec<Placement>>,
}

impl SceneView {
    /// An empty scene.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// An empty scene whose terrain tiles are generated on their own thread, which calls `notify` after each tile.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub fn with_terrain_apart(notify: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        Ok(Self { tile_source: TileSource::Thread(TileGenerator::start(notify)?), ..Self::default() })
    }

    /// Queues one step of the core. Work for a new scene that needs no device begins at once.
    pub fn push(&mut self, step: Vec<Change>) {
        for change in &step {
            if let Change::Scene(header) = change {
                // If no thread can be started, the work is done on first use.
                self.terrain_task =
                    header.terrain.as_deref().and_then(|entry| TerrainMeasurementTask::start(entry).ok());
                let environment = environment(header, self.plain);
                self.sky_task = Task::start("sky", move || SkyMaps::new(&environment)).ok();
            }
        }
        self.waiting.push_back(step.into());
    }

    /// Takes texels that the host has decoded, which `uses` changes name by this number
    /// ([`lodestream_client::core::TexturePixels::Held`]). They must come before those changes, which are skipped without.
    pub fn hold(&mut self, number: u32, uses: u32, texels: Texels) {
        self.held.hold(number, uses, texels);
    }

    /// Number of steps that wait for upload.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Chooses the light of scenes with a sun but without ambient light or background: an atmosphere, with haze over
    /// terrain (the default), or the description's colours without haze.
    pub const fn show_air(&mut self, air: bool) {
        self.plain = !air;
    }

    /// Whether everything that the first frame needs is uploaded; before, pictures lack objects.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.whole
    }

    /// Uploads waiting steps, up to about `budget_bytes`. A mesh's change takes effect when all of it is uploaded, so
    /// that no frame shows half a chunk; a texture level when its last row is. Parts are uploaded ahead within the
    /// budget.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        renderer: &Renderer,
        budget_bytes: usize,
        now_s: f32,
    ) -> Result<usize, RenderError> {
        let (mut lit, was_whole) = (false, self.whole);
        let mut bytes = self.upload_steps(gpu, renderer, budget_bytes, now_s, &mut lit)?;
        if self.refining.is_some() {
            self.uploads.record(gpu)?;
        } else {
            bytes += self.repack(gpu, renderer, budget_bytes.saturating_sub(bytes))?;
            self.uploads.submit(gpu)?;
        }
        if lit {
            // Once per upload: there may be thousands of pages.
            self.lights = self.punctual_light_pages.values().flat_map(|page| page.iter()).copied().collect();
        }
        if self.whole && !was_whole {
            // Submit uploads now, while the first frame is planned.
            gpu.queue.submit([]);
        }
        // Take the sky maps once the first frame has all its data.
        if let Some(ahead) = self.sky_task.take_if(|ahead| self.whole || ahead.is_finished()) {
            self.sky = ahead.finish();
        }
        Ok(bytes)
    }

    /// Moves meshes out of pages that are evacuated, and out of buffers that have become too large, about `budget_bytes`
    /// of them. Returns the number of bytes.
    fn repack(&mut self, gpu: &Gpu, renderer: &Renderer, budget_bytes: usize) -> Result<usize, RenderError> {
        let mut bytes = 0;
        let pools = renderer.mesh_pools();
        let evacuates = pools.evacuate();
        let shrunk = std::mem::take(&mut self.shrunk);
        for (number, asset) in (0..).zip(&mut self.assets).filter(|_| evacuates || !shrunk.is_empty()) {
            let Some(asset) = asset.as_mut().filter(|_| evacuates || shrunk.contains(&number)) else {
                continue;
            };
            if bytes >= budget_bytes {
                self.shrunk = shrunk;
                return Ok(bytes);
            }
            bytes += usize::try_from(asset.repack(gpu, &mut self.uploads)?).unwrap_or(usize::MAX);
        }
        pools.end_evacuation();
        Ok(bytes)
    }

    /// Returns the number of bytes, and sets `lit` if punctual lights have changed.
    fn upload_steps(
        &mut self,
        gpu: &Gpu,
        renderer: &Renderer,
        budget_bytes: usize,
        now_s: f32,
        lit: &mut bool,
    ) -> Result<usize, RenderError> {
        let mut bytes = 0;
        while bytes < budget_bytes {
            let room = budget_bytes - bytes;
            if self.refining.is_some() {
                bytes += self.refine(gpu, room, now_s)?;
                continue;
            }
            let Some(step) = self.waiting.front_mut() else { break };
            let Some(change) = step.pop_front() else {
                self.waiting.pop_front();
                continue;
            };
            let needed = change.bytes();
            match change {
                Change::Mesh(mesh) => {
                    if needed > room {
                        // Complete uploads do not wait for partial ones.
                        self.uploads.submit(gpu)?;
                    }
                    self.refining = Some(StreamedMeshChange::new(mesh));
                }
                Change::Texture(texture) => {
                    bytes += self.paint(gpu, &texture, room)?;
                    if self.rows > 0
                        && let Some(step) = self.waiting.front_mut()
                    {
                        step.push_front(Change::Texture(texture));
                    }
                }
                change => {
                    bytes += needed;
                    *lit |= matches!(change, Change::Scene(_) | Change::PunctualLightPage { .. });
                    self.apply(gpu, renderer, change)?;
                }
            }
        }
        if self.refining.is_none() {
            self.waiting.pop_front_if(|step| step.is_empty());
        }
        Ok(bytes)
    }

    fn apply(&mut self, gpu: &Gpu, renderer: &Renderer, change: Change) -> Result<(), RenderError> {
        match change {
            Change::Scene(header) => {
                let waiting = std::mem::take(&mut self.waiting);
                let tile_source = std::mem::take(&mut self.tile_source);
                let begun = self.terrain_task.take();
                let ground = match &header.terrain {
                    Some(entry) => Some(TerrainRenderer::new(gpu, renderer, entry, begun)?),
                    None => None,
                };
                let (sky_task, sky, plain) = (self.sky_task.take(), self.sky.take(), self.plain);
                let uploads = std::mem::take(&mut self.uploads);
                let heights = self.heights;
                // Parts may be hidden before the scene arrives, but another scene has other parts.
                let parts = if self.header.is_none() {
                    std::mem::take(&mut self.parts)
                } else {
                    SceneParts::default()
                };
                let header = Some(*header);
                *self = Self {
                    header,
                    plain,
                    waiting,
                    uploads,
                    ground,
                    heights,
                    parts,
                    tile_source,
                    sky_task,
                    sky,
                    held: std::mem::take(&mut self.held),
                    moment: self.moment.take(),
                    ..Self::default()
                };
            }
            Change::Instances(instances) => {
                let mut concerned = BTreeSet::new();
                for instance in &instances {
                    let asset = instance.asset as usize;
                    if self.instances.len() <= asset {
                        self.instances.resize_with(asset + 1, Vec::new);
                    }
                    let placed = &mut self.instances[asset];
                    if self.parts.add_instance(instance.asset, placed.len() as u32) {
                        concerned.insert(instance.asset);
                    }
                    placed.push(instance.placement);
                }
                if !concerned.is_empty() {
                    self.write_part_states(gpu, |asset| concerned.contains(&asset))?;
                }
                self.follow_animations(gpu)?;
            }
            Change::Animation { number, model } => {
                self.animations.insert(number, model);
                self.follow_animations(gpu)?;
            }
            Change::Proxies(proxies) => {
                for proxy in &proxies {
                    let asset = proxy.asset as usize;
                    if self.instances.len() <= asset {
                        self.instances.resize_with(asset + 1, Vec::new);
                    }
                    self.instances[asset].push(Placement::at([0.0; 3]));
                }
                self.drawn.add_proxies(&proxies);
                self.update_drawn();
            }
            Change::Cut(cut) => {
                self.drawn.set_cut(&cut, self.parts.places());
                self.update_drawn();
                let changed = self.parts.set_proxies(self.drawn.hidden_parts(&cut));
                self.write_part_states(gpu, |asset| changed.contains(&asset))?;
            }
            Change::Asset(asset) => {
                self.add(gpu, renderer, &asset);
                self.write_part_states_of(gpu, asset.asset)?;
            }
            Change::PunctualLights { count } => self.has_punctual_lights = count > 0,
            Change::PunctualLightPage { page, punctual_lights } => {
                self.punctual_light_pages.insert(page, punctual_lights);
            }
            Change::FirstFrame => self.whole = true,
            Change::HeightOverrides { x, y, overrides: points } => {
                if let Some(ground) = &mut self.ground {
                    ground.set_points(x, y, points)?;
                    self.anchored.iter_mut().for_each(TerrainAnchored::invalidate);
                }
            }
            Change::TileRemoved { asset, tile } => {
                if let Some(asset) = self.assets.get(asset as usize).and_then(Option::as_ref) {
                    remove_tile(asset, tile)?;
                }
            }
            // Uploaded in pieces elsewhere.
            Change::Mesh(_) | Change::Texture(_) => {}
        }
        Ok(())
    }

    /// Tells assets which of their placements are drawn.
    fn update_drawn(&mut self) {
        for (number, asset) in (0..).zip(&mut self.assets) {
            if let Some(asset) = asset {
                asset.set_drawn(self.drawn.of(number));
            }
        }
    }

    /// Uploads missing rows of a texture level, about `budget_bytes` but at least one, and returns the number of
    /// bytes.
    fn paint(
        &mut self,
        gpu: &Gpu,
        texture: &TextureChange,
        budget_bytes: usize,
    ) -> Result<usize, RenderError> {
        let first = std::mem::take(&mut self.rows);
        let Some(texels) = self.held.texels(&texture.pixels) else { return Ok(0) };
        let Some(asset) = self.assets.get_mut(texture.asset as usize).and_then(Option::as_mut) else {
            return Ok(0);
        };
        let (index, level) = (usize::from(texture.texture), u32::from(texture.level));
        let shape = asset.textures().get(index).map(Texture::declared_shape);
        if let (Some(tile), Some(shape)) = (texture.tile, shape) {
            let place = tile_place(shape.level_size(level).into(), tile);
            match asset.update_texture_tile(gpu, index, level, place, texels) {
                // The selection's budget is for all texels; what it does not count is drawn coarser.
                Err(why @ RenderError::NoTileRoom { .. }) => tracing::debug!("a tile is left out: {why}"),
                painted => painted?,
            }
            self.held.used(&texture.pixels);
            return Ok(texture.pixels.bytes());
        }
        let height = shape.map_or(1, |shape| shape.level_size(level).1).max(1);
        let of_row = texture.pixels.bytes().div_ceil(height as usize).max(1);
        let rows = u32::try_from(budget_bytes / of_row).unwrap_or(u32::MAX).max(1).min(height - first);
        let end = first + rows;
        asset.update_texture_rows(gpu, index, level, texels, first..end)?;
        self.rows = if end < height { end } else { 0 };
        if self.rows == 0 {
            self.held.used(&texture.pixels);
        }
        Ok(rows as usize * of_row)
    }

    fn add(&mut self, gpu: &Gpu, renderer: &Renderer, asset: &NewAsset) {
        let sent_as = (0..).map(|texture| (asset.asset, texture)).zip(&asset.textures);
        let sent_as = sent_as.map(|(own, info)| {
            let first = asset.shared.iter().find(|shared| shared.texture == own.1);
            (first.map_or(own, |shared| (shared.asset, shared.of)), TextureShape::from(info))
        });
        let textures: Vec<Texture> = sent_as.map(|(id, shape)| self.texture(gpu, id, shape)).collect();
        let mut new = renderer.create_asset_with(gpu, DVec3::from(asset.origin), &asset.materials, textures);
        new.set_bounds(Vec3::from(asset.center).as_dvec3(), f64::from(asset.radius));
        new.set_drawn(self.drawn.of(asset.asset));
        let number = asset.asset as usize;
        if self.assets.len() <= number {
            self.assets.resize_with(number + 1, || None);
        }
        self.assets[number] = Some(new);
    }

    /// The texture that is sent under this id, or a new one. Also a new one if the shape differs, which only a faulty
    /// server sends.
    fn texture(&mut self, gpu: &Gpu, id: (u32, u16), shape: TextureShape) -> Texture {
        let there = self.textures.get(&id).and_then(WeakTexture::upgrade);
        there.filter(|texture| texture.declared_shape() == shape).unwrap_or_else(|| {
            let new = Texture::new(gpu, shape);
            self.textures.insert(id, new.downgrade());
            new
        })
    }

    /// Stages about `budget_bytes` of a mesh's change and returns the number of bytes.
    fn refine(&mut self, gpu: &Gpu, budget_bytes: usize, now_s: f32) -> Result<usize, RenderError> {
        let Some(mut refining) = self.refining.take() else { return Ok(0) };
        let Some(asset) = self.assets.get_mut(refining.asset as usize).and_then(Option::as_mut) else {
            return Ok(0);
        };
        let (bytes, all) = refining.stage(gpu, &mut self.uploads, asset, budget_bytes)?;
        if all {
            asset.commit();
            if asset.is_roomy() {
                self.shrunk.insert(refining.asset);
            }
            self.changed_s = now_s;
        } else {
            self.refining = Some(refining);
        }
        Ok(bytes)
    }

    /// The scene's header, once it has arrived.
    #[must_use]
    pub const fn header(&self) -> Option<&SceneHeader> {
        self.header.as_ref()
    }

    /// Time of the last mesh change in seconds: for `morph_s` after it, vertices move.
    #[must_use]
    pub const fn changed_s(&self) -> f32 {
        self.changed_s
    }

    /// GPU memory of all meshes, in bytes.
    #[must_use]
    pub fn geometry_bytes(&self) -> u64 {
        let assets: u64 = self.assets.iter().flatten().map(AssetGpu::geometry_bytes).sum();
        assets + self.terrain_bytes()
    }

    /// GPU memory of the terrain, in bytes: of fixed size, 0 without one.
    #[must_use]
    pub fn terrain_bytes(&self) -> u64 {
        self.ground.as_ref().map_or(0, TerrainRenderer::bytes)
    }

    /// Number of textures, shared ones counted once, and their GPU memory in bytes.
    #[must_use]
    pub fn textures(&self) -> (usize, u64) {
        let textures = self.textures.values().filter_map(WeakTexture::upgrade);
        textures.fold((0, 0), |(count, bytes), texture| (count + 1, bytes + texture.bytes()))
    }

    /// Animates the vertical exaggeration to `factor` over a number of seconds from `now_s`, in the clock of the
    /// changes; at once for 0 seconds. Terrain-anchored objects and water follow. Tiles stay valid. Call
    /// [`SceneView::move_ground`] for each frame. A scene that begins later starts at the current factor.
    ///
    /// # Errors
    /// An invalid factor or duration.
    pub fn set_vertical_exaggeration(
        &mut self,
        factor: f64,
        seconds: f64,
        now_s: f32,
    ) -> Result<(), VerticalExaggerationError> {
        self.heights = self.heights.towards(factor, seconds, now_s.into())?;
        Ok(())
    }

    /// The vertical exaggeration over time.
    #[must_use]
    pub const fn heights(&self) -> VerticalExaggeration {
        self.heights
    }

    /// Applies the vertical exaggeration at a time to terrain and anchored objects; call before
    /// [`SceneView::prepare_ground`]. Returns whether it is still changing. Does nothing at factor 1.
    pub fn move_ground(&mut self, now_s: f32) -> bool {
        let now_s = f64::from(now_s);
        let Some(ground) = &mut self.ground else { return false };
        ground.set_vertical_exaggeration(self.heights.at(now_s));
        if ground.vertical_exaggeration() == 1.0 {
            self.anchored = None;
        } else {
            let instances = animated_placements::all(&self.instances, &self.animated);
            self.anchored.get_or_insert_default().follow(ground, &instances, &self.lights);
        }
        self.heights.is_moving(now_s)
    }

    /// Rise of the terrain at a place over the scene's height, world units; a camera on it moves by that.
    pub fn ground_rise(&mut self, at: DVec3) -> f64 {
        let Some(ground) = &mut self.ground else { return 0.0 };
        let factor = ground.vertical_exaggeration();
        if factor == 1.0 { 0.0 } else { ground.height(at.x, at.z) * (1.0 - 1.0 / factor) }
    }

    /// Selects the terrain tiles for frames from `camera` with pictures of `size` pixels, where meshes have a screen
    /// error of `target_px`; terrain has 2.4 times that. With `shadows`, also selects tiles out of view that cast
    /// shadows into it. Scenes without terrain need no call.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub fn prepare_ground(
        &mut self,
        gpu: &Gpu,
        camera: &Pose,
        size: (u32, u32),
        target_px: f32,
        shadows: Option<Shadows>,
    ) -> Result<(), RenderError> {
        let Some(ground) = &mut self.ground else { return Ok(()) };
        ground.prepare(gpu, &self.tile_source, camera, size, GROUND_ERRORS * f64::from(target_px))?;
        let Some(shadows) = shadows else { return Ok(()) };
        let mut placed = std::mem::take(&mut self.placed);
        let cascades = self.with_frame(*camera, Settings::default(), f32::MAX, |frame| {
            placed.update(frame.drawables);
            let (memory, mut counters) = (ListMemory::default(), Counters::default());
            let list = DrawList::new(frame, size, &placed, memory, &mut counters);
            shadows::of_frame(frame, &list, shadows)
        });
        self.placed = placed;
        let Some(ground) = &mut self.ground else { return Ok(()) };
        ground.prepare_casters(gpu, &self.tile_source, &cascades)
    }

    /// Generates requested terrain tiles for about this time, where there is no thread for it: for the time in which a
    /// host waits for its device.
    #[cfg(target_family = "wasm")]
    pub fn generate_tiles(&self, budget: std::time::Duration) {
        if let TileSource::Thread(generator) = &self.tile_source {
            generator.work(budget);
        }
    }

    /// Number of tiles that the last frame lacked and replaced by coarser ones.
    #[must_use]
    pub fn missing_tiles(&self) -> usize {
        self.ground.as_ref().map_or(0, TerrainRenderer::missing)
    }

    /// Screen error of the last frame's terrain tiles in pixels; more than requested if that took too many tiles.
    /// `None` without terrain.
    #[must_use]
    pub fn ground_px(&self) -> Option<f64> {
        self.ground.as_ref().map(TerrainRenderer::drawn_px)
    }

    /// Records the current scene into a target for `view`: terrain tiles for its screen error, then the frame.
    /// `time_s` is in the clock of the changes; `f32::MAX` ends all morphs.
    ///
    /// # Errors
    /// As [`Renderer::record`].
    #[expect(
        clippy::too_many_arguments,
        reason = "the device's three, then what of the scene is drawn where"
    )]
    pub fn record(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        encoder: &mut wgpu::CommandEncoder,
        target: &Target<'_>,
        view: &View,
        settings: Settings,
        time_s: f32,
    ) -> Result<Counters, RenderError> {
        self.move_ground(time_s);
        self.prepare_ground(gpu, &view.pose(), target.size, view.target_px, settings.shadows)?;
        self.with_frame(view.pose(), settings, time_s, |frame| renderer.record(gpu, encoder, target, frame))
    }

    /// Builds the current frame and passes it to `draw`.
    pub fn with_frame<R>(
        &self,
        camera: Pose,
        settings: Settings,
        time_s: f32,
        draw: impl FnOnce(&Frame<'_>) -> R,
    ) -> R {
        // What is anchored has been moved already.
        let animated = self.anchored.is_none().then_some(&self.animated);
        let placed = self.anchored.as_ref().map_or(&self.instances, |anchored| &anchored.instances);
        let drawables: Vec<Drawable<'_>> = (0..)
            .zip(self.assets.iter().zip(placed))
            .filter_map(|(number, (asset, placed)): (u32, _)| {
                let instances = animated.and_then(|animated| animated.get(&number)).unwrap_or(placed);
                Some(Drawable { asset: asset.as_ref()?, instances })
            })
            .collect();
        let environment =
            self.header.as_ref().map_or_else(Environment::default, |header| environment(header, self.plain));
        let exposure = settings.exposure * exposure(&environment, self.has_punctual_lights);
        let settings = Settings { exposure, ..settings };
        let lights = self.anchored.as_ref().map_or(&self.lights, |anchored| &anchored.lights).as_slice();
        let terrain = self.ground.as_ref().map(TerrainRenderer::frame);
        // Without terrain there is no land.
        let water = self.ground.as_ref().zip(self.header.as_ref()).and_then(|(ground, header)| {
            let water = water(header)?;
            Some(Water { level: water.level * ground.vertical_exaggeration(), ..water })
        });
        let (drawables, sky) = (&drawables[..], self.sky.as_ref());
        draw(&Frame { camera, drawables, terrain, water, lights, environment, sky, settings, time_s })
    }
}

/// Radiance of a white surface lit with π lux, the least light for which a scene with punctual lights is exposed.
/// Exposure for a dark sky would overexpose what they light.
const LAMPLIT_WHITE: f32 = 1.0;

/// Exposure at which a white surface that faces the sun is just below white, for any strength of the sun.
fn exposure(environment: &Environment, punctual_lights: bool) -> f32 {
    // BT.709 luminance.
    let luminance = |c: Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    let (white, lit) = match &environment.sky {
        Sky::Studio(studio) => (STUDIO_WHITE, studio_white(studio)),
        Sky::Atmosphere(air) => (SUNLIT_WHITE, air.brightness),
        Sky::Plain(plain) => (SUNLIT_WHITE, luminance(plain.sun + 0.5 * (plain.zenith + plain.horizon))),
    };
    let lit = if punctual_lights { lit.max(LAMPLIT_WHITE) } else { lit };
    if lit > 0.0 { (white / lit).clamp(1e-3, 1e3) } else { 1.0 }
}

/// The scene's water. Ripples scale with the terrain's cells.
fn water(header: &SceneHeader) -> Option<Water> {
    let terrain = header.terrain.as_ref()?;
    let water = terrain.water?;
    Some(Water { level: water.level.into(), clarity: water.clarity.into(), ripples: terrain.unit.into() })
}

/// The scene's light. A studio stays one. A scene with a sun but without ambient light or background has an atmosphere,
/// unless `plain` colours are chosen. Else the background gives the sky, brighter towards the horizon, and the ambient
/// light comes from below. Terrain has haze. [`exposure`] compensates the sun's strength.
fn environment(header: &SceneHeader, plain: bool) -> Environment {
    let light = &header.light;
    let (sun, background) = (Vec3::from(light.color), Vec3::from(header.background));
    let sky = match header.surroundings() {
        Surroundings::Studio if !plain => Sky::Studio(Studio { key: sun, ..Studio::default() }),
        Surroundings::Sky if !plain && sun.max_element() > 0.0 => Sky::Atmosphere(Atmosphere::default()),
        _ => Sky::Plain(GradientSky {
            sun,
            zenith: background * 0.7,
            horizon: background * 1.3,
            ground: Vec3::from(light.ambient),
        }),
    };
    Environment {
        to_sun: Vec3::from(light.direction).as_dvec3(),
        up: Vec3::from(header.camera.up).as_dvec3(),
        sky,
        haze: header.terrain.as_ref().filter(|_| !plain).map(|terrain| {
            let parameters = &terrain.parameters;
            let half = f64::from(u32::from(parameters.finest_level + parameters.extent_log2)).exp2();
            Haze { visibility: HAZE_OVER_REACH * half * f64::from(terrain.unit) }
        }),
    }
}

fn remove_tile(asset: &AssetGpu, tile: Tile) -> Result<(), RenderError> {
    let (texture, level) = (usize::from(tile.texture), u32::from(tile.level));
    if let Some(shape) = asset.textures().get(texture).map(Texture::declared_shape) {
        asset.remove_texture_tile(texture, level, tile_place(shape.level_size(level).into(), tile.tile))?;
    }
    Ok(())
}
