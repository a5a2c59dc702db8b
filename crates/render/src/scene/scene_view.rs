//! From the core's changes to the renderer's assets: the part of a viewer that owns GPU memory.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3};
use lodestream_client::core::{Change, NewAsset, TextureChange, TexturePixels};
use lodestream_scene::description::{InstanceEntry, SceneHeader};
use lodestream_scene::pose::Pose;
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::view::View;

use crate::frame::counters::Counters;
use crate::frame::draw::DrawList;
use crate::frame::settings::{Drawable, Frame, Settings, Shadows};
use crate::frame::target::Target;
use crate::passes::shadows;
use crate::passes::sky::{SkyMaps, SkyTask};
use crate::passes::water::Water;
use crate::renderer::Renderer;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::texture::{Texture, TextureData, TextureShape, WeakTexture};
use crate::resources::uploads::Uploads;
use crate::scene::asset::AssetGpu;
use crate::scene::environment::{Atmosphere, Environment, GradientSky, Haze, Sky};
use crate::scene::instance::Instance;
use crate::scene::lights::{Light, Spot};
use crate::scene::material::Material;
use crate::scene::streamed_mesh::Refining;
use crate::scene::terrain_anchored::TerrainAnchored;
use crate::scene::terrain_renderer::{TerrainMeasurementTask, TerrainRenderer, TileSource};
use crate::scene::tile_generator::TileGenerator;
use crate::scene::vertical_exaggeration::{VerticalExaggeration, VerticalExaggerationError};

/// Screen error of the ground's surface over that of meshes: since its normals are those of a surface twice as fine, its
/// picture is as near to the finest as with an error as small as theirs and normals of its own.
const GROUND_ERRORS: f64 = 2.4;

/// Exposed radiance of a white surface that faces the sun: near the upper end of the tone curve.
const SUNLIT_WHITE: f32 = 1.6;
/// Range of sight over half the ground's side: where the ground ends, a fifth of its contrast is left, and a seventh is
/// gone a tenth of the way.
const HAZE_OVER_REACH: f64 = 2.0;

/// The scene in GPU memory, as far as it has arrived.
#[derive(Debug, Default)]
pub struct SceneView {
    header: Option<SceneHeader>,
    /// By asset number; `None` until the base mesh is there.
    assets: Vec<Option<AssetGpu>>,
    /// The textures of all assets that are here, by the asset and texture that they are sent as.
    textures: BTreeMap<(u32, u16), WeakTexture>,
    /// By asset number.
    instances: Vec<Vec<Instance>>,
    /// Its light is as its description says, without air.
    plain: bool,
    /// Steps that wait for a frame with time to spare.
    waiting: VecDeque<VecDeque<Change>>,
    /// The change before the first of them, of which a part is staged.
    refining: Option<Refining>,
    /// What of meshes is not submitted yet.
    uploads: Uploads,
    /// Rows that are uploaded of the texture level with which the first of them begins.
    rows: u32,
    /// Everything that the first frame needs is uploaded.
    whole: bool,
    /// Last time that a mesh changed, in seconds of the core's clock.
    changed_s: f32,
    /// The scene has punctual lights, here or not.
    has_punctual_lights: bool,
    /// The punctual lights that are here, by page: sums over them have one order, whatever the order in which they came.
    punctual_light_pages: BTreeMap<u32, Arc<[PunctualLight]>>,
    /// The same for the renderer.
    lights: Vec<Light>,
    /// The scene's terrain, if it has one.
    ground: Option<TerrainRenderer>,
    /// What its heights are multiplied by.
    heights: VerticalExaggeration,
    /// What stands on it, where they are multiplied.
    standing: Option<TerrainAnchored>,
    tile_source: TileSource,
    /// The terrain of a scene that waits to be uploaded.
    measuring: Option<TerrainMeasurementTask>,
    /// The maps of the sky of a scene that waits to be uploaded, or of the one that is shown.
    computing: Option<SkyTask>,
    sky: Option<SkyMaps>,
}

impl SceneView {
    /// An empty scene.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// An empty scene whose terrain is made on a thread of its own; `notify` is called there after each tile.
    ///
    /// # Errors
    /// Fails where the system gives no thread.
    pub fn with_terrain_apart(notify: impl Fn() + Send + 'static) -> std::io::Result<Self> {
        Ok(Self { tile_source: TileSource::Thread(TileGenerator::start(notify)?), ..Self::default() })
    }

    /// Takes one step of the core. What needs no device of a scene that begins is begun at once.
    pub fn push(&mut self, step: Vec<Change>) {
        for change in &step {
            if let Change::Scene(header) = change {
                // Without a thread it is done when it is needed.
                self.measuring =
                    header.terrain.as_deref().and_then(|entry| TerrainMeasurementTask::start(entry).ok());
                self.computing = SkyTask::start(environment(header, self.plain)).ok();
            }
        }
        self.waiting.push_back(step.into());
    }

    /// Steps that were not uploaded yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Whether the sun of a scene that states no ambient light and no background shines through an atmosphere, and ground
    /// ends in haze (as it does from the start); or light and sky have the description's colours and nothing is hazy.
    pub const fn show_air(&mut self, air: bool) {
        self.plain = !air;
    }

    /// Whether everything that the first frame needs is uploaded: before that, a picture lacks objects.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.whole
    }

    /// Uploads waiting steps until they came to about `budget_bytes`. What is said of a mesh is seen once all of it is
    /// here, so that no frame shows half a chunk, and a level of a texture once its last row is; of either as much is
    /// uploaded ahead as the budget has.
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
        let bytes = self.upload_steps(gpu, renderer, budget_bytes, now_s, &mut lit)?;
        if self.refining.is_some() {
            self.uploads.record(gpu)?;
        } else {
            self.uploads.submit(gpu)?;
        }
        if lit {
            // Once, however many pages came: there may be thousands.
            self.lights =
                self.punctual_light_pages.values().flat_map(|page| page.iter()).map(Light::from).collect();
        }
        if self.whole && !was_whole {
            // What was written goes to the device while the first frame is planned.
            gpu.queue.submit([]);
        }
        // Once everything is there that the first frame means, it is drawn.
        if let Some(ahead) = self.computing.take_if(|ahead| self.whole || ahead.is_finished()) {
            self.sky = ahead.finish();
        }
        Ok(bytes)
    }

    /// Answers how many bytes that were, and sets `lit` where punctual lights have changed.
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
                        // What is whole is not kept waiting for what is not.
                        self.uploads.submit(gpu)?;
                    }
                    self.refining = Some(Refining::new(mesh));
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
                let begun = self.measuring.take();
                let ground = match &header.terrain {
                    Some(entry) => Some(TerrainRenderer::new(gpu, renderer, entry, begun)?),
                    None => None,
                };
                let (computing, sky, plain) = (self.computing.take(), self.sky.take(), self.plain);
                let uploads = std::mem::take(&mut self.uploads);
                let heights = self.heights;
                let header = Some(*header);
                *self = Self {
                    header,
                    plain,
                    waiting,
                    uploads,
                    ground,
                    heights,
                    tile_source,
                    computing,
                    sky,
                    ..Self::default()
                };
            }
            Change::Instances(entries) => {
                for entry in &entries {
                    let asset = entry.asset as usize;
                    if self.instances.len() <= asset {
                        self.instances.resize_with(asset + 1, Vec::new);
                    }
                    self.instances[asset].push(place(entry));
                }
            }
            Change::Asset(asset) => self.add(gpu, renderer, &asset),
            Change::PunctualLights { count } => self.has_punctual_lights = count > 0,
            Change::PunctualLightPage { page, punctual_lights } => {
                self.punctual_light_pages.insert(page, punctual_lights);
            }
            Change::FirstFrame => self.whole = true,
            Change::TerrainPoints { x, y, points } => {
                if let Some(ground) = &mut self.ground {
                    ground.set_points(x, y, points)?;
                    self.standing.iter_mut().for_each(TerrainAnchored::forget);
                }
            }
            // Piece by piece.
            Change::Mesh(_) | Change::Texture(_) => {}
        }
        Ok(())
    }

    /// Uploads as many of a texture level's rows that are not there as come to about `budget_bytes`, at least one; answers
    /// how many bytes that were. Where all are there, none are begun.
    fn paint(
        &mut self,
        gpu: &Gpu,
        texture: &TextureChange,
        budget_bytes: usize,
    ) -> Result<usize, RenderError> {
        let first = std::mem::take(&mut self.rows);
        let Some(asset) = self.assets.get_mut(texture.asset as usize).and_then(Option::as_mut) else {
            return Ok(0);
        };
        let (index, level) = (usize::from(texture.texture), u32::from(texture.level));
        let shape = asset.textures().get(index).map(Texture::declared_shape);
        let height = shape.map_or(1, |shape| shape.level_size(level).1).max(1);
        let of_row = texture.pixels.bytes().div_ceil(height as usize).max(1);
        let rows = u32::try_from(budget_bytes / of_row).unwrap_or(u32::MAX).max(1).min(height - first);
        let end = first + rows;
        asset.update_texture_rows(gpu, index, level, texels(&texture.pixels), first..end)?;
        self.rows = if end < height { end } else { 0 };
        Ok(rows as usize * of_row)
    }

    fn add(&mut self, gpu: &Gpu, renderer: &Renderer, asset: &NewAsset) {
        let materials: Vec<Material> = asset.materials.iter().map(Material::from).collect();
        let sent_as = (0..).map(|texture| (asset.asset, texture)).zip(&asset.textures);
        let sent_as = sent_as.map(|(own, info)| {
            let first = asset.shared.iter().find(|shared| shared.texture == own.1);
            (first.map_or(own, |shared| (shared.asset, shared.of)), TextureShape::from(info))
        });
        let textures: Vec<Texture> = sent_as.map(|(id, shape)| self.texture(gpu, id, shape)).collect();
        let mut new = renderer.create_asset_with(gpu, DVec3::from(asset.origin), &materials, textures);
        new.set_bounds(Vec3::from(asset.center).as_dvec3(), f64::from(asset.radius));
        let number = asset.asset as usize;
        if self.assets.len() <= number {
            self.assets.resize_with(number + 1, || None);
        }
        self.assets[number] = Some(new);
    }

    /// The texture that is sent under this name, or a new one; also where its shape is another, which a server that says
    /// what is true does not send.
    fn texture(&mut self, gpu: &Gpu, id: (u32, u16), shape: TextureShape) -> Texture {
        let there = self.textures.get(&id).and_then(WeakTexture::upgrade);
        there.filter(|texture| texture.declared_shape() == shape).unwrap_or_else(|| {
            let new = Texture::new(gpu, shape);
            self.textures.insert(id, new.downgrade());
            new
        })
    }

    /// Stages as much of a mesh's change as comes to about `budget_bytes`; answers how many bytes that were.
    fn refine(&mut self, gpu: &Gpu, budget_bytes: usize, now_s: f32) -> Result<usize, RenderError> {
        let Some(mut refining) = self.refining.take() else { return Ok(0) };
        let Some(asset) = self.assets.get_mut(refining.asset as usize).and_then(Option::as_mut) else {
            return Ok(0);
        };
        let (bytes, all) = refining.stage(gpu, &mut self.uploads, asset, budget_bytes)?;
        if all {
            asset.commit();
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

    /// When a mesh was last changed, in seconds: for `morph_s` after that, vertices move.
    #[must_use]
    pub const fn changed_s(&self) -> f32 {
        self.changed_s
    }

    /// GPU memory of all meshes, in bytes.
    #[must_use]
    pub fn geometry_bytes(&self) -> u64 {
        let assets: u64 = self.assets.iter().flatten().map(AssetGpu::geometry_bytes).sum();
        assets + self.ground.as_ref().map_or(0, TerrainRenderer::bytes)
    }

    /// How many textures the assets have, those that several share counted once, and their GPU memory in bytes.
    #[must_use]
    pub fn textures(&self) -> (usize, u64) {
        let textures = self.textures.values().filter_map(WeakTexture::upgrade);
        textures.fold((0, 0), |(count, bytes), texture| (count + 1, bytes + texture.bytes()))
    }

    /// Lets the ground's heights go to `factor` times what the scene has, within so many seconds from `now_s` on, of the
    /// clock of the changes; at once where these are 0. What stands on it and the water go with it. Tiles of the scene's
    /// terrain are not made anew. Calls of [`SceneView::move_ground`] follow; a scene that comes later begins where it is
    /// then.
    ///
    /// # Errors
    /// A factor or a time that there is not.
    pub fn set_vertical_exaggeration(
        &mut self,
        factor: f64,
        seconds: f64,
        now_s: f32,
    ) -> Result<(), VerticalExaggerationError> {
        self.heights = self.heights.towards(factor, seconds, now_s.into())?;
        Ok(())
    }

    /// Where they go, and when.
    #[must_use]
    pub const fn heights(&self) -> VerticalExaggeration {
        self.heights
    }

    /// Puts the ground's heights where they are at a time, with what stands on it, before [`SceneView::prepare_ground`] of
    /// the frame. Answers whether they are on their way: the next frame is another one. Where heights are the scene's own
    /// this does nothing.
    pub fn move_ground(&mut self, now_s: f32) -> bool {
        let now_s = f64::from(now_s);
        let Some(ground) = &mut self.ground else { return false };
        ground.set_vertical_exaggeration(self.heights.at(now_s));
        if ground.vertical_exaggeration() == 1.0 {
            self.standing = None;
        } else {
            self.standing.get_or_insert_default().follow(ground, &self.instances, &self.lights);
        }
        self.heights.is_moving(now_s)
    }

    /// By how much ground lies higher at a place than in the scene, world units: what follows it from there moves by that.
    pub fn ground_rise(&mut self, at: DVec3) -> f64 {
        let Some(ground) = &mut self.ground else { return 0.0 };
        let factor = ground.vertical_exaggeration();
        if factor == 1.0 { 0.0 } else { ground.height(at.x, at.z) * (1.0 - 1.0 / factor) }
    }

    /// Chooses the terrain's tiles for the frames that follow from `camera`, into pictures of `size` pixels, where meshes
    /// have a screen error of `target_px`: the ground's surface has 2.4 times that, and normals of a finer one. Where
    /// there are to be `shadows`, also tiles out of view that cast some into it. Scenes without terrain need no call.
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
        let cascades = self.with_frame(*camera, Settings::default(), f32::MAX, |frame| {
            let list = DrawList::new(frame, size, &mut Counters::default());
            shadows::of_frame(frame, &list, shadows)
        });
        let Some(ground) = &mut self.ground else { return Ok(()) };
        ground.prepare_casters(gpu, &self.tile_source, &cascades)
    }

    /// Terrain tiles that the last frame lacked; coarser ones were drawn in their place.
    #[must_use]
    pub fn missing_tiles(&self) -> usize {
        self.ground.as_ref().map_or(0, TerrainRenderer::missing)
    }

    /// Screen error that the last frame's terrain tiles were chosen for, in pixels: more than was asked for where that would
    /// have taken too many. `None` without terrain.
    #[must_use]
    pub fn ground_px(&self) -> Option<f64> {
        self.ground.as_ref().map(TerrainRenderer::drawn_px)
    }

    /// Records the scene as it is now into a target, as `view` sees it: terrain tiles for its screen error, then
    /// the frame. `time_s` is of the clock of the changes; `f32::MAX` puts every vertex where it belongs.
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

    /// Draws the scene as it is now: hands the frame to `draw`.
    pub fn with_frame<R>(
        &self,
        camera: Pose,
        settings: Settings,
        time_s: f32,
        draw: impl FnOnce(&Frame<'_>) -> R,
    ) -> R {
        let drawables: Vec<Drawable<'_>> = self
            .assets
            .iter()
            .zip(self.standing.as_ref().map_or(&self.instances, |standing| &standing.instances))
            .filter_map(|(asset, instances)| Some(Drawable { asset: asset.as_ref()?, instances }))
            .collect();
        let environment =
            self.header.as_ref().map_or_else(Environment::default, |header| environment(header, self.plain));
        let exposure = settings.exposure * exposure(&environment, self.has_punctual_lights);
        let settings = Settings { exposure, ..settings };
        let lights = self.standing.as_ref().map_or(&self.lights, |standing| &standing.lights).as_slice();
        let terrain = self.ground.as_ref().map(TerrainRenderer::frame);
        // Before there is ground nothing would rise over it.
        let water = self.ground.as_ref().zip(self.header.as_ref()).and_then(|(ground, header)| {
            let water = water(header)?;
            Some(Water { level: water.level * ground.vertical_exaggeration(), ..water })
        });
        let (drawables, sky) = (&drawables[..], self.sky.as_ref());
        draw(&Frame { camera, drawables, terrain, water, lights, environment, sky, settings, time_s })
    }
}

fn texels(pixels: &TexturePixels) -> TextureData<'_> {
    match pixels {
        TexturePixels::Rgba8(texels) => TextureData::Rgba8(texels),
        TexturePixels::R8(texels) => TextureData::R8(texels),
        TexturePixels::R16(texels) => TextureData::R16(texels),
    }
}

impl From<&PunctualLight> for Light {
    fn from(punctual_light: &PunctualLight) -> Self {
        let vector = |v: [f32; 3]| Vec3::from(v).as_dvec3();
        Self {
            position: DVec3::from(punctual_light.position),
            intensity: Vec3::from(punctual_light.intensity),
            range: f64::from(punctual_light.range),
            spot: punctual_light.spot.map(|spot| Spot {
                direction: vector(spot.direction),
                inner: f64::from(spot.inner),
                outer: f64::from(spot.outer),
            }),
        }
    }
}

fn place(entry: &InstanceEntry) -> Instance {
    let rotation: DQuat = entry.orientation().as_dquat();
    Instance { translation: DVec3::from(entry.translation), rotation, scale: f64::from(entry.scale) }
}

/// Radiance of a white surface that punctual lights light by π lux: scenes that have some are not exposed for less. An exposure made
/// for a dark sky would burn out what they light.
const LAMPLIT_WHITE: f32 = 1.0;

/// Exposure at which a white surface that faces the sun comes out just below white, however strong the
/// scene's sun is.
fn exposure(environment: &Environment, punctual_lights: bool) -> f32 {
    // BT.709 luminance.
    let luminance = |c: Vec3| c.dot(Vec3::new(0.2126, 0.7152, 0.0722));
    let lit = match &environment.sky {
        Sky::Atmosphere(air) => air.brightness,
        Sky::Plain(plain) => luminance(plain.sun + 0.5 * (plain.zenith + plain.horizon)),
    };
    let lit = if punctual_lights { lit.max(LAMPLIT_WHITE) } else { lit };
    if lit > 0.0 { (SUNLIT_WHITE / lit).clamp(1e-3, 1e3) } else { 1.0 }
}

/// The scene's water. Ripples are as long as its ground has cells.
fn water(header: &SceneHeader) -> Option<Water> {
    let terrain = header.terrain.as_ref()?;
    let water = terrain.water?;
    Some(Water { level: water.level.into(), clarity: water.clarity.into(), ripples: terrain.unit.into() })
}

/// The scene's light. A scene with a sun that states no ambient light and no background has an atmosphere, unless `plain`
/// colours are asked for. Else the background gives the sky, which is brighter towards the horizon and lights surfaces
/// from above, and the ambient light is what comes from below. Ground ends in haze. How strong the sun is, [`exposure`] makes up for.
fn environment(header: &SceneHeader, plain: bool) -> Environment {
    let light = &header.light;
    let (sun, background) = (Vec3::from(light.color), Vec3::from(header.background));
    let sky = if plain || header.states_sky() || sun.max_element() <= 0.0 {
        Sky::Plain(GradientSky {
            sun,
            zenith: background * 0.7,
            horizon: background * 1.3,
            ground: Vec3::from(light.ambient),
        })
    } else {
        Sky::Atmosphere(Atmosphere::default())
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
