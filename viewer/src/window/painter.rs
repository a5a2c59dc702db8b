//! Draws frames into the window: surface, renderer and overlay.

use std::sync::Arc;

use anyhow::Context;
use image::RgbaImage;
use winit::dpi::PhysicalSize;
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

use lodestream_render::{
    Compiler, Counters, EMPTY_WINDOW, Frame, Gpu, Renderer, Settings, Target, TargetCopy,
};

/// Interval of checks whether the device is open.
const OPENING_INTERVAL: std::time::Duration = std::time::Duration::from_millis(2);

/// Threads that compile the first frame's pipelines, besides the one that uploads it.
const COMPILING_THREADS: usize = 2;

/// A window's surface and what draws into it.
pub(super) struct Painter {
    pub(super) window: Arc<Window>,
    pub(super) gpu: Gpu,
    pub(super) renderer: Renderer,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    input: egui_winit::State,
    overlay: egui_wgpu::Renderer,
    /// Compilers for the pipelines of full quality and of all other steps.
    later: Vec<Compiler>,
    /// Whether frames are copied for [`Painted::copy`].
    copies: bool,
    /// Whether the next frame with the scene is copied for [`Painted::picture`].
    takes_picture: bool,
    /// Whether pictures are kept: where drawing one takes much longer than copying it.
    keeps: bool,
    /// The last picture of the scene that was kept, without the overlay.
    kept: Option<wgpu::Texture>,
}

/// What a frame shows below the overlay.
pub(super) enum Below<F> {
    /// Nothing.
    Nothing,
    /// The scene; the picture is kept for later frames if wanted.
    Scene {
        /// Draws it.
        draw: F,
        /// Whether it is kept.
        keep: bool,
    },
    /// The picture that was kept.
    Kept,
}

/// Draws a scene's frame into the window.
pub(super) type DrawScene<'a> = dyn FnMut(&Frame<'_>) -> anyhow::Result<Counters> + 'a;

/// The parts of a painter that can be made on any thread.
struct Device {
    gpu: Gpu,
    renderer: Renderer,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    overlay: egui_wgpu::Renderer,
    later: Vec<Compiler>,
    keeps: bool,
}

impl Device {
    fn open(
        instance: &wgpu::Instance,
        surface: wgpu::Surface<'static>,
        size: PhysicalSize<u32>,
        copies: bool,
        settings: impl FnOnce(&Gpu) -> [Vec<Settings>; 2],
    ) -> anyhow::Result<Self> {
        let gpu = Gpu::for_surface(instance, &surface)?;
        let capabilities = surface.get_capabilities(&gpu.adapter);
        let mut config = surface
            .get_default_config(&gpu.adapter, size.width.max(1), size.height.max(1))
            .context("the graphics device cannot draw into this window")?;
        // The overlay blends in sRGB space, so a format without conversion is right for both.
        let plain = capabilities.formats.iter().copied().find(|f| !f.is_srgb());
        config.format = plain.unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        if gpu.is_software() {
            // Queued frames would only show earlier camera positions.
            config.desired_maximum_frame_latency = 1;
        }
        if copies {
            allow_copies(&capabilities, &mut config)?;
        }
        let both_ways = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST;
        let keeps = gpu.is_software() && capabilities.usages.contains(both_ways);
        if keeps {
            config.usage |= both_ways;
        }
        surface.configure(&gpu.device, &config);
        let renderer = Renderer::without_pipelines(&gpu, config.format)?;
        // Compiled with ground: most scenes have one, and it is known only once the header arrives.
        let [first, later] = settings(&gpu).map(|all| {
            all.iter().map(|settings| renderer.compiler(&gpu, settings, true)).collect::<Vec<_>>()
        });
        for _ in 0..COMPILING_THREADS {
            let first = first.clone();
            std::thread::Builder::new()
                .name("pipelines".into())
                .spawn(move || first.iter().for_each(Compiler::compile))?;
        }
        let overlay = egui_wgpu::Renderer::new(&gpu.device, config.format, Default::default());
        Ok(Self { gpu, renderer, surface, config, overlay, later, keeps })
    }
}

/// Result of painting a frame.
pub(super) struct Painted {
    /// Counters of the scene's passes; `None` if no frame with the scene was shown.
    pub(super) counters: Option<Counters>,
    /// Whether the frame shows the picture that was kept.
    pub(super) shows_kept: bool,
    /// Copy of the frame, if frames are captured.
    pub(super) copy: Option<TargetCopy>,
    /// Copy of the scene without the overlay, if [`Painter::take_picture`] asked for it.
    pub(super) picture: Option<TargetCopy>,
    /// When the overlay wants to be drawn again.
    pub(super) repaint_after: std::time::Duration,
}

impl Painter {
    /// Opens the window's device on a thread of its own and calls `meanwhile` repeatedly until it is open. Then threads
    /// compile the pipelines for the first frame's `settings`, while the first frame is uploaded; a frame waits for
    /// missing pipelines. `copies`: frames are captured.
    pub(super) fn new(
        window: Arc<Window>,
        display: OwnedDisplayHandle,
        copies: bool,
        settings: impl FnOnce(&Gpu) -> [Vec<Settings>; 2] + Send + 'static,
        mut meanwhile: impl FnMut(),
    ) -> anyhow::Result<Self> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::from_env().unwrap_or(wgpu::Backends::PRIMARY),
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_with_display_handle(Box::new(display))
        });
        let surface = instance.create_surface(window.clone()).context("the window cannot be drawn into")?;
        let size = window.inner_size();
        let opening = std::thread::Builder::new()
            .name("device".into())
            .spawn(move || Device::open(&instance, surface, size, copies, settings))?;
        while !opening.is_finished() {
            meanwhile();
            std::thread::sleep(OPENING_INTERVAL);
        }
        let device = opening.join().map_err(|_| anyhow::anyhow!("opening the graphics device failed"))??;
        let Device { gpu, renderer, surface, config, overlay, later, keeps } = device;
        let context = egui::Context::default();
        // A picture takes long to draw with a software driver: a panel that fades in would only be late.
        context.all_styles_mut(|style| style.animation_time = 0.0);
        let input = egui_winit::State::new(context, egui::ViewportId::ROOT, &window, None, None, None);
        Ok(Self {
            window,
            gpu,
            renderer,
            surface,
            config,
            input,
            overlay,
            later,
            copies,
            takes_picture: false,
            keeps,
            kept: None,
        })
    }

    /// Copies the next frame that shows the scene, for [`Painted::picture`].
    ///
    /// # Errors
    /// A surface that cannot be copied from.
    pub(super) fn take_picture(&mut self) -> anyhow::Result<()> {
        if !self.config.usage.contains(wgpu::TextureUsages::COPY_SRC) {
            allow_copies(&self.surface.get_capabilities(&self.gpu.adapter), &mut self.config)?;
            self.surface.configure(&self.gpu.device, &self.config);
        }
        self.takes_picture = true;
        Ok(())
    }

    /// Starts compiling the remaining pipelines. Called after the first frame, so as not to delay it.
    pub(super) fn compile_rest(&mut self) {
        let later = std::mem::take(&mut self.later);
        if !later.is_empty() {
            // If there is no thread, frames compile their missing pipelines.
            let compile = move || later.iter().for_each(Compiler::compile);
            let _ = std::thread::Builder::new().name("pipelines".into()).spawn(compile);
        }
    }

    /// Whether the device is a software driver.
    pub(super) fn is_software(&self) -> bool {
        self.gpu.is_software()
    }

    /// Width and height in pixels.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.config.width, self.config.height]
    }

    pub(super) fn resize(&mut self, size: PhysicalSize<u32>) {
        if size.width > 0 && size.height > 0 {
            let limit = self.gpu.device.limits().max_texture_dimension_2d;
            self.config.width = size.width.min(limit);
            self.config.height = size.height.min(limit);
            self.surface.configure(&self.gpu.device, &self.config);
        }
    }

    /// Passes an event to the overlay; returns whether the overlay consumed it, and whether it must be redrawn.
    pub(super) fn pass_event(&mut self, event: &winit::event::WindowEvent) -> (bool, bool) {
        let response = self.input.on_window_event(&self.window, event);
        (response.consumed, response.repaint)
    }

    /// Draws a picture of any size that the device allows, until nothing of it is unfinished.
    pub(super) fn draw_apart(
        &mut self,
        [width, height]: [u32; 2],
        mut draw: impl FnMut(&mut DrawScene<'_>) -> anyhow::Result<Counters>,
    ) -> anyhow::Result<RgbaImage> {
        let device = &self.gpu.device;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture = target(device, "picture", size, self.config.format, usage);
        let view = texture.create_view(&Default::default());
        loop {
            let mut encoder = device.create_command_encoder(&Default::default());
            let (gpu, renderer) = (&self.gpu, &mut self.renderer);
            let counters = draw(&mut |frame| {
                Ok(renderer.record(gpu, &mut encoder, &Target::colour(&view, (width, height)), frame)?)
            })?;
            let copy = match counters.is_unfinished() {
                true => None,
                false => Some(TargetCopy::record(gpu, &mut encoder, &texture)?),
            };
            gpu.queue.submit([encoder.finish()]);
            if let Some(copy) = copy {
                return Ok(copy.picture(gpu)?);
            }
        }
    }

    /// Whether [`Below::Kept`] would show a picture of the present size.
    pub(super) fn has_kept(&self) -> bool {
        let size = self.size();
        let is_wanted = |kept: &wgpu::Texture| [kept.width(), kept.height()] == size;
        !self.takes_picture && !self.copies && self.kept.as_ref().is_some_and(is_wanted)
    }

    /// Draws what is below the overlay, and the overlay over it.
    pub(super) fn paint<F>(
        &mut self,
        overlay: impl FnMut(&mut egui::Ui),
        below: Below<F>,
    ) -> anyhow::Result<Painted>
    where
        F: FnOnce(&mut DrawScene<'_>) -> anyhow::Result<Counters>,
    {
        let raw = self.input.take_egui_input(&self.window);
        let context = self.input.egui_ctx().clone();
        let mut output = context.run_ui(raw, overlay);
        // Taken out, because egui panics if they are dropped unused.
        let new_textures = std::mem::take(&mut output.textures_delta.set);
        let old_textures = std::mem::take(&mut output.textures_delta.free);
        self.input.handle_platform_output(&self.window, output.platform_output);
        let repaint_after = output
            .viewport_output
            .values()
            .map(|v| v.repaint_delay)
            .min()
            .unwrap_or(std::time::Duration::MAX);
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        for (id, deltas) in &new_textures {
            for delta in deltas {
                self.overlay.update_texture(device, queue, *id, delta);
            }
        }
        let (mut copy, mut picture, mut shows_kept) = (None, None, false);
        let counters = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) | wgpu::CurrentSurfaceTexture::Suboptimal(frame) => {
                let view = frame.texture.create_view(&Default::default());
                let mut encoder = device.create_command_encoder(&Default::default());
                let size = (self.config.width, self.config.height);
                let (gpu, renderer) = (&self.gpu, &mut self.renderer);
                let mut record = |frame: &Frame<'_>| {
                    Ok(renderer.record(gpu, &mut encoder, &Target::colour(&view, size), frame)?)
                };
                let (mut counters, mut shows) = (None, false);
                match below {
                    Below::Nothing => {}
                    Below::Scene { draw, keep } => {
                        counters = Some(draw(&mut record)?);
                        shows = true;
                        if keep && self.keeps {
                            let kept = self.kept.take().filter(|kept| kept.size() == frame.texture.size());
                            let kept = kept.unwrap_or_else(|| keeping(device, &frame.texture));
                            copy_whole(&mut encoder, &frame.texture, &kept);
                            self.kept = Some(kept);
                        }
                    }
                    Below::Kept => {
                        if let Some(kept) = &self.kept {
                            copy_whole(&mut encoder, kept, &frame.texture);
                            (shows, shows_kept) = (true, true);
                        }
                    }
                }
                if counters.is_some() && std::mem::take(&mut self.takes_picture) {
                    picture = Some(TargetCopy::record(&self.gpu, &mut encoder, &frame.texture)?);
                }
                let load = if shows {
                    wgpu::LoadOp::Load
                } else {
                    wgpu::LoadOp::Clear(empty_color(self.config.format))
                };
                let screen = egui_wgpu::ScreenDescriptor {
                    size_in_pixels: self.size(),
                    pixels_per_point: output.pixels_per_point,
                };
                let jobs = context.tessellate(output.shapes, output.pixels_per_point);
                let first = self.overlay.update_buffers(device, queue, &mut encoder, &jobs, &screen);
                // A pass without draws still loads and stores the whole picture.
                if !(shows && jobs.is_empty()) {
                    let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                        label: Some("overlay"),
                        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                            view: &view,
                            depth_slice: None,
                            resolve_target: None,
                            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
                        })],
                        depth_stencil_attachment: None,
                        timestamp_writes: None,
                        occlusion_query_set: None,
                        multiview_mask: None,
                    });
                    self.overlay.render(&mut pass.forget_lifetime(), &jobs, &screen);
                }
                if self.copies && counters.is_some() {
                    copy = Some(TargetCopy::record(&self.gpu, &mut encoder, &frame.texture)?);
                }
                queue.submit(first.into_iter().chain([encoder.finish()]));
                self.window.pre_present_notify();
                queue.present(frame);
                counters
            }
            wgpu::CurrentSurfaceTexture::Outdated | wgpu::CurrentSurfaceTexture::Lost => {
                self.surface.configure(device, &self.config);
                self.window.request_redraw();
                None
            }
            // Hidden, or busy: another frame will come.
            _ => None,
        };
        for id in &old_textures {
            self.overlay.free_texture(id);
        }
        Ok(Painted { counters, shows_kept, copy, picture, repaint_after })
    }
}

/// A texture that a picture of this kind can be copied to and from.
fn keeping(device: &wgpu::Device, like: &wgpu::Texture) -> wgpu::Texture {
    let usage = wgpu::TextureUsages::COPY_SRC | wgpu::TextureUsages::COPY_DST;
    target(device, "kept picture", like.size(), like.format(), usage)
}

fn target(
    device: &wgpu::Device,
    label: &'static str,
    size: wgpu::Extent3d,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

fn copy_whole(encoder: &mut wgpu::CommandEncoder, from: &wgpu::Texture, to: &wgpu::Texture) {
    encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), to.size());
}

/// Makes frames readable after they are drawn.
fn allow_copies(
    capabilities: &wgpu::SurfaceCapabilities,
    config: &mut wgpu::SurfaceConfiguration,
) -> anyhow::Result<()> {
    anyhow::ensure!(
        capabilities.usages.contains(wgpu::TextureUsages::COPY_SRC),
        "this window's frames cannot be kept: its surface cannot be copied from"
    );
    config.usage |= wgpu::TextureUsages::COPY_SRC;
    Ok(())
}

/// [`EMPTY_WINDOW`] as a clear colour for a target of this format.
fn empty_color(format: wgpu::TextureFormat) -> wgpu::Color {
    let [r, g, b] = EMPTY_WINDOW.map(|value| {
        let encoded = f64::from(value) / 255.0;
        // The sRGB curve (IEC 61966-2-1).
        if format.is_srgb() { ((encoded + 0.055) / 1.055).powf(2.4) } else { encoded }
    });
    wgpu::Color { r, g, b, a: 1.0 }
}
