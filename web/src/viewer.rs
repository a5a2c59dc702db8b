//! The page's half: device, scene in GPU memory, camera and frames.

mod animation;
mod memory;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use lodestream_client::core::TexturePixels;
use lodestream_render::{
    AmbientOcclusion, AntiAliasing, Counters, Gpu, LightCulling, OcclusionMethod, PartState, RenderError,
    Renderer, SceneView, Settings, Shadows, Target, Texels, Tint, upload_budget,
};
use lodestream_scene::description::Camera;
use lodestream_scene::encoding;
use lodestream_scene::parts::ScenePart;
use lodestream_viewing::{CameraController, FULL, Mode, Quality, Step};
use wasm_bindgen::prelude::*;

use crate::clips::Clips;
use crate::parts::{part_transform, scene_parts};
use crate::steps;

/// Time for terrain tiles in each of the browser's frames in which the device is busy.
const WAITING_BUDGET: Duration = Duration::from_millis(8);
/// Most bytes uploaded in one task of the page's thread: at slow frame rates, the native budget would take too long.
const MAX_UPLOAD_BYTES: usize = 2 << 20;

/// Draws a scene into a canvas.
#[wasm_bindgen]
#[derive(Debug)]
pub struct Viewer {
    gpu: Gpu,
    renderer: Renderer,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    scene: SceneView,
    controller: Option<CameraController>,
    /// Camera to start from, instead of the scene's.
    start: Option<Camera>,
    clips: Clips,
    quality: Quality,
    /// What was asked for.
    settings: Settings,
    /// The same, within the memory.
    fitted: Settings,
    /// Most bytes of heaps and GPU memory.
    memory_bytes: f64,
    target_px: f32,
    /// Whether frames are drawn in reduced quality while the camera moves.
    adapt: bool,
    /// Begin of the frame on the device, in milliseconds.
    begun_ms: f64,
    /// Set by the device when that frame is done.
    done: Arc<AtomicBool>,
    waits: bool,
    counters: Counters,
    frames: u32,
    frame_ms: f64,
    presented_ms: Option<f64>,
    most_uploaded: usize,
    /// Whether the last frame is final as far as the page can tell.
    is_final: bool,
    /// Whether the last frame lacked nothing but terrain tiles.
    only_tiles_missing: bool,
    /// Whether something changes the picture besides terrain tiles.
    dirty: bool,
}

fn text(error: RenderError) -> String {
    error.to_string()
}

#[wasm_bindgen]
impl Viewer {
    /// Opens a WebGPU device that draws into a canvas. `software`: the page knows that the CPU draws. `memory_bytes`
    /// bounds heaps and GPU memory; see [`Viewer::content_bytes`].
    ///
    /// # Errors
    /// There is none, or it lacks what is needed.
    pub async fn open(
        canvas: web_sys::HtmlCanvasElement,
        target_px: f32,
        software: bool,
        memory_bytes: f64,
    ) -> Result<Viewer, String> {
        let size = [canvas.width().max(1), canvas.height().max(1)];
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::BROWSER_WEBGPU,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let surface = instance
            .create_surface(wgpu::SurfaceTarget::Canvas(canvas))
            .map_err(|why| format!("the canvas cannot be drawn into: {why}"))?;
        let gpu = Gpu::request(&instance, Some(&surface)).await.map_err(text)?;
        let gpu = if software { gpu.as_software() } else { gpu };
        let mut config = surface
            .get_default_config(&gpu.adapter, size[0], size[1])
            .ok_or("the graphics device cannot draw into this canvas")?;
        let formats = surface.get_capabilities(&gpu.adapter).formats;
        config.format = formats.iter().copied().find(|format| !format.is_srgb()).unwrap_or(config.format);
        surface.configure(&gpu.device, &config);
        let renderer = Renderer::new(&gpu, config.format).map_err(text)?;
        let scene = SceneView::with_terrain_apart(|| {}).map_err(|why| why.to_string())?;
        let software = gpu.is_software();
        let mut this = Self {
            renderer,
            surface,
            config,
            scene,
            controller: None,
            start: None,
            clips: Clips::new(),
            quality: Quality::new(software, None),
            settings: settings(software),
            fitted: settings(software),
            memory_bytes,
            target_px,
            adapt: true,
            begun_ms: 0.0,
            done: Arc::default(),
            waits: false,
            counters: Counters::default(),
            frames: 0,
            frame_ms: 0.0,
            presented_ms: None,
            most_uploaded: 0,
            is_final: false,
            only_tiles_missing: false,
            dirty: true,
            gpu,
        };
        this.fit_targets();
        Ok(this)
    }

    /// Name of the graphics device.
    #[must_use]
    pub fn adapter(&self) -> String {
        self.gpu.describe()
    }

    /// Takes a step of changes from the worker.
    ///
    /// # Errors
    /// Bytes that the worker's streamer did not write.
    pub fn push(&mut self, step: &[u8]) -> Result<(), String> {
        self.scene.push(steps::decode(step).map_err(|why| why.to_string())?);
        self.is_final = false;
        self.dirty = true;
        Ok(())
    }

    /// Takes a decoded picture before the step that names it.
    pub fn hold_picture(&mut self, number: u32, uses: u32, picture: web_sys::ImageBitmap) {
        self.scene.hold(number, uses, Texels::Bitmap(picture));
    }

    /// Takes decoded texels before the step that names them: heights of 8 or 16 bits (little-endian), or four bytes each.
    pub fn hold_texels(&mut self, number: u32, uses: u32, bits: u32, texels: Vec<u8>) {
        let pixels = match bits {
            8 => TexturePixels::R8(texels),
            16 => {
                let heights = texels.chunks_exact(2).map(|texel| u16::from_le_bytes([texel[0], texel[1]]));
                TexturePixels::R16(heights.collect())
            }
            _ => TexturePixels::Rgba8(texels),
        };
        self.scene.hold(number, uses, Texels::Pixels(pixels));
    }

    /// Number of steps that are not in GPU memory yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.scene.waiting()
    }

    /// Whether a frame is being drawn by the device: another one would only queue behind it.
    pub fn is_busy(&mut self, now_ms: f64) -> bool {
        if self.waits && self.done.load(Ordering::Acquire) {
            self.waits = false;
            self.frame_ms = now_ms - self.begun_ms;
            self.quality.drawn(seconds(self.begun_ms), self.frame_ms / 1e3);
        }
        if self.waits {
            self.scene.generate_tiles(WAITING_BUDGET);
        }
        self.waits
    }

    /// Takes the device's first error since the last call: it is lost or out of memory, and another viewer is needed.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.gpu.take_error()
    }

    /// Moves waiting steps into GPU memory: all of the first frame's, later ones up to a bound.
    ///
    /// # Errors
    /// As [`Viewer::frame`].
    pub fn upload(&mut self, now_ms: f64) -> Result<(), String> {
        let now_s = seconds(now_ms).as_secs_f32();
        let budget = if self.presented_ms.is_some() {
            upload_budget(seconds(self.frame_ms)).min(MAX_UPLOAD_BYTES)
        } else {
            usize::MAX
        };
        self.bound_tiles();
        let bytes = self.scene.upload(&self.gpu, &self.renderer, budget, now_s).map_err(text)?;
        if self.presented_ms.is_some() {
            self.most_uploaded = self.most_uploaded.max(bytes);
        }
        Ok(())
    }

    /// Most bytes that one [`Viewer::upload`] has moved since the first picture; rows of textures and vertices are not
    /// split.
    #[must_use]
    pub fn most_uploaded(&self) -> f64 {
        self.most_uploaded as f64
    }

    /// Draws a frame; whether another is needed without an event.
    ///
    /// # Errors
    /// Errors of the graphics device; after a lost device, open another viewer.
    pub fn frame(&mut self, now_ms: f64) -> Result<bool, String> {
        let now_s = seconds(now_ms).as_secs_f32();
        let plays = self.play(seconds(now_ms)).map_err(text)?;
        let moves = self.quality.is_moving(seconds(now_ms));
        if self.controller.is_none() {
            let camera = self.start.or(self.scene.header().map(|header| header.camera));
            self.controller = camera.filter(|_| self.scene.header().is_some()).map(CameraController::new);
        }
        let Some(controller) = self.controller.filter(|_| self.scene.is_whole()) else { return Ok(true) };
        let step = self.step();
        if !plays && self.is_unchanged(&controller)? {
            self.scene.generate_tiles(WAITING_BUDGET);
            return Ok(true);
        }
        self.dirty = false;
        let limited = step.limit(&self.fitted);
        let settings = Settings {
            shadows: limited.shadows.map(|shadows| Shadows {
                max_staleness: if plays { 0 } else { step.late_shadows.max(self.quality.late_shadows()) },
                ..shadows
            }),
            // A step sets the scale, whatever the memory allows.
            render_scale: limited.render_scale.min(self.fitted.render_scale),
            ..limited
        };
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => {
                frame
            }
            wgpu::CurrentSurfaceTexture::Outdated | wgpu::CurrentSurfaceTexture::Lost => {
                self.surface.configure(&self.gpu.device, &self.config);
                return Ok(true);
            }
            _ => return Ok(true),
        };
        let size = (self.config.width, self.config.height);
        let colour = frame.texture.create_view(&Default::default());
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let view = controller.view(size.into(), self.target_px * step.ground);
        let target = Target::colour(&colour, size);
        let counters = self
            .scene
            .record(&self.gpu, &mut self.renderer, &mut encoder, &target, &view, settings, now_s)
            .map_err(text)?;
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.queue.present(frame);
        self.note_submitted(now_ms);
        let morphs =
            now_s - self.scene.changed_s() <= self.settings.morph_s || self.renderer.fades_texture_tiles();
        let full = !self.adapt || self.quality.is_full();
        let complete = !morphs
            && (plays || !moves && full)
            && !counters.is_unfinished()
            && counters.late_shadow_maps == 0
            && self.scene.waiting() == 0;
        self.is_final = complete && self.scene.missing_tiles() == 0;
        self.only_tiles_missing = complete && !self.is_final;
        self.counters = counters;
        Ok(!self.is_final || plays)
    }

    /// Whether the next picture would equal the last: only terrain tiles are missing, and the new ones do not suffice for
    /// finer terrain.
    fn is_unchanged(&mut self, controller: &CameraController) -> Result<bool, String> {
        if self.dirty || !self.only_tiles_missing {
            return Ok(false);
        }
        let before = self.scene.ground_px();
        let size = (self.config.width, self.config.height);
        let step = self.step();
        let shadows = step.limit(&self.fitted).shadows;
        let (camera, px) = (controller.pose(), self.target_px * step.ground);
        self.scene.prepare_ground(&self.gpu, &camera, size, px, shadows).map_err(text)?;
        Ok(self.scene.missing_tiles() > 0 && self.scene.ground_px() == before)
    }

    fn note_submitted(&mut self, now_ms: f64) {
        self.begun_ms = now_ms;
        self.waits = true;
        self.done = Arc::default();
        let done = Arc::clone(&self.done);
        self.gpu.queue.on_submitted_work_done(move || done.store(true, Ordering::Release));
        self.frames += 1;
        self.presented_ms.get_or_insert(now_ms);
    }

    fn step(&self) -> Step {
        if self.adapt { self.quality.step() } else { FULL }
    }

    /// Changes the size of the picture, in pixels of the device.
    pub fn resize(&mut self, width: u32, height: u32) {
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        let size = [width, height].map(|side| side.clamp(1, limit));
        if size != [self.config.width, self.config.height] {
            [self.config.width, self.config.height] = size;
            self.surface.configure(&self.gpu.device, &self.config);
            self.fit_targets();
            self.is_final = false;
            self.dirty = true;
        }
    }

    /// Turns the view by a drag, in pixels right and down.
    pub fn turn(&mut self, now_ms: f64, dx: f64, dy: f64) {
        self.moved(now_ms, |controller, _| controller.turn(dx, dy));
    }

    /// Moves the scene with a drag.
    pub fn pan(&mut self, now_ms: f64, dx: f64, dy: f64) {
        self.moved(now_ms, |controller, height| controller.pan(dx, dy, height));
    }

    /// Comes nearer or goes away, by lines of a wheel.
    pub fn wheel(&mut self, now_ms: f64, lines: f64) {
        self.moved(now_ms, |controller, _| controller.wheel(lines));
    }

    /// Flies right, up and forward, each −1 to 1, for a number of seconds.
    pub fn fly(&mut self, now_ms: f64, right: f64, up: f64, forward: f64, fast: bool, seconds: f64) {
        self.moved(now_ms, |controller, _| controller.push([right, up, forward], fast, seconds));
    }

    /// Changes between orbit and free flight; whether it is flight.
    pub fn toggle(&mut self) -> bool {
        let Some(controller) = &mut self.controller else { return false };
        controller.toggle();
        controller.mode == Mode::Fly
    }

    /// Returns to the start.
    pub fn reset(&mut self, now_ms: f64) {
        self.moved(now_ms, |controller, _| controller.reset());
    }

    /// Hides a part, tints it with an sRGB colour `0xrrggbb` of a strength from 0 to 1, and moves it within its instance by
    /// a matrix of 16 numbers, column after column; without all of these it is shown as it is. Parts may be named before
    /// they arrive. The worker must know what is moved ([`crate::Streamer::move_parts`]).
    ///
    /// # Errors
    /// A part that no asset can have, a matrix that is no similarity, or errors of the graphics device.
    pub fn set_part(
        &mut self,
        instance: u32,
        part: u32,
        hidden: bool,
        colour: Option<u32>,
        strength: f32,
        matrix: Option<Vec<f64>>,
    ) -> Result<(), String> {
        let tint = colour.map(|colour| {
            let [_, r, g, b] = colour.to_be_bytes();
            Tint { colour: [r, g, b], strength }
        });
        let transform = matrix.as_deref().map(part_transform).transpose()?;
        let state = (ScenePart { instance, part }, PartState { hidden, tint, transform });
        self.scene.set_parts(&self.gpu, &[state]).map_err(text)?;
        self.scene_changed();
        Ok(())
    }

    /// Draws these parts alone, given as pairs of instance and part; none ends the isolation.
    ///
    /// # Errors
    /// As [`Viewer::set_part`].
    pub fn isolate_parts(&mut self, pairs: Option<Vec<u32>>) -> Result<(), String> {
        let parts = pairs.map(|pairs| scene_parts(&pairs));
        self.scene.isolate_parts(&self.gpu, parts.as_deref()).map_err(text)?;
        self.scene_changed();
        Ok(())
    }

    /// Shows all parts as they are.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub fn clear_parts(&mut self) -> Result<(), String> {
        self.scene.clear_parts(&self.gpu).map_err(text)?;
        self.scene_changed();
        Ok(())
    }

    fn scene_changed(&mut self) {
        self.is_final = false;
        self.dirty = true;
    }

    /// The ray through a place of the picture, in pixels of the device from its upper left corner: origin and direction
    /// for [`crate::Streamer::pick`]. None before the scene has begun.
    #[must_use]
    pub fn ray(&self, x: f64, y: f64) -> Option<Vec<f64>> {
        let pose = self.controller?.pose();
        let direction = pose.direction([x, y], (self.config.width, self.config.height));
        Some([pose.eye.to_array(), direction.to_array()].concat())
    }

    /// Moves, without turning, to where a sphere just fits into the picture.
    pub fn fit(&mut self, now_ms: f64, x: f64, y: f64, z: f64, radius: f64) {
        let aspect = f64::from(self.config.width) / f64::from(self.config.height);
        self.moved(now_ms, |controller, _| controller.fit([x, y, z].into(), radius, aspect));
    }

    fn moved(&mut self, now_ms: f64, change: impl FnOnce(&mut CameraController, f64)) {
        if let Some(controller) = &mut self.controller {
            change(controller, self.config.height.into());
            self.quality.moved(seconds(now_ms));
            self.is_final = false;
            self.dirty = true;
        }
    }

    /// The view for the worker; none before the scene has begun.
    #[must_use]
    pub fn view(&self, now_ms: f64) -> Option<Vec<u8>> {
        let moves = self.quality.is_moving(seconds(now_ms));
        let meshes = if moves { self.step().meshes } else { 1.0 };
        let view = self.controller?.view([self.config.width, self.config.height], self.target_px * meshes);
        encoding::encode(&view).ok()
    }

    /// The camera as numbers: eye, target, up, vertical field of view in radians.
    #[must_use]
    pub fn camera(&self) -> Option<Vec<f64>> {
        let Camera { eye, target, up, fov_y } = self.controller?.camera();
        Some([&eye[..], &target, &up.map(f64::from), &[fov_y.into()]].concat())
    }

    /// Moves to a camera as [`Viewer::camera`] gives it, or starts from it.
    ///
    /// # Errors
    /// Other numbers.
    pub fn set_camera(&mut self, now_ms: f64, numbers: &[f64]) -> Result<(), String> {
        let &[ex, ey, ez, tx, ty, tz, ux, uy, uz, fov] = numbers else {
            return Err("a camera has ten numbers: eye, target, up, field of view".into());
        };
        let camera = Camera {
            eye: [ex, ey, ez],
            target: [tx, ty, tz],
            up: [ux, uy, uz].map(|part| part as f32),
            fov_y: fov as f32,
        };
        let view = camera.view([self.config.width, self.config.height], self.target_px);
        view.check().map_err(|why| format!("camera: {why}"))?;
        match self.controller {
            Some(_) => self.moved(now_ms, |controller, _| controller.place(camera)),
            None => self.start = Some(camera),
        }
        Ok(())
    }

    /// Sets the screen error to refine to, in pixels.
    pub fn set_target_px(&mut self, target_px: f32) {
        self.target_px = target_px.clamp(0.1, 64.0);
        self.is_final = false;
        self.dirty = true;
    }

    /// Switches a technique on or off: `occlusion`, `shadows`, `relief`, `lights`, `water`, `haze`, `smoothing`, or
    /// `adapt` (reduced quality while the camera moves).
    ///
    /// # Errors
    /// Another name.
    pub fn switch(&mut self, technique: &str, on: bool) -> Result<(), String> {
        let usual = settings(self.gpu.is_software());
        let settings = &mut self.settings;
        match technique {
            "occlusion" => settings.occlusion = usual.occlusion.filter(|_| on),
            "shadows" => settings.shadows = usual.shadows.filter(|_| on),
            "lights" => settings.lights = usual.lights.filter(|_| on),
            "relief" => settings.relief = on,
            "water" => settings.water = on,
            "haze" => settings.haze = on,
            "smoothing" if on => settings.anti_aliasing = usual.anti_aliasing,
            "smoothing" => settings.anti_aliasing = AntiAliasing::None,
            "adapt" => self.adapt = on,
            other => return Err(format!("there is no technique {other:?}")),
        }
        self.fit_targets();
        self.is_final = false;
        self.dirty = true;
        Ok(())
    }

    /// Whether the last frame needs no other.
    #[must_use]
    pub fn is_final(&self) -> bool {
        self.is_final
    }

    /// Time of the first frame, in milliseconds since the navigation.
    #[must_use]
    pub fn presented_ms(&self) -> Option<f64> {
        self.presented_ms
    }

    /// Number of frames drawn.
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// Time of the last frame that the device has finished, in milliseconds.
    #[must_use]
    pub fn frame_ms(&self) -> f64 {
        self.frame_ms
    }

    /// The step of quality, in words.
    #[must_use]
    pub fn quality(&self) -> String {
        self.quality.describe()
    }

    /// Frees the device and its memory at once, not when the browser collects it.
    pub fn close(self) {
        self.gpu.device.destroy();
    }
}

fn seconds(ms: f64) -> Duration {
    Duration::try_from_secs_f64(ms / 1e3).unwrap_or_default()
}

/// The window's default settings for a device.
fn settings(software: bool) -> Settings {
    let still = (!software).then_some(OcclusionMethod::Gtao);
    Settings {
        occlusion: Some(AmbientOcclusion { still, ..AmbientOcclusion::default() }),
        shadows: Some(Shadows::default()),
        lights: Some(LightCulling::default()),
        anti_aliasing: if software { AntiAliasing::Spatial } else { AntiAliasing::Temporal },
        ..Settings::default()
    }
}
