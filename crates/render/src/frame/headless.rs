//! Headless rendering: draws into a texture and reads it back.

use image::RgbaImage;

use crate::frame::counters::Counters;
use crate::frame::graph::{PassId, Resource};
use crate::frame::settings::Frame;
use crate::frame::target::Target;
use crate::frame::timing::Timings;
use crate::renderer::Renderer;
use crate::resources::descriptors::texture_2d;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::readback::read_texture;

/// Format of the pictures: plain bytes; the shader applies the sRGB curve.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// A renderer with its own target texture.
///
/// The same frames give bit-identical pictures on the same driver.
#[derive(Debug)]
pub struct Headless {
    gpu: Gpu,
    renderer: Renderer,
    target: wgpu::Texture,
    /// Whether the last frame had surfaces (else the depth texture is stale or absent).
    has_surfaces: bool,
}

impl Headless {
    /// Draws pictures of `width` × `height` pixels.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] for sizes the device cannot hold (or 0).
    pub fn new(gpu: Gpu, width: u32, height: u32) -> Result<Self, RenderError> {
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if width.max(height) > limit || width.min(height) == 0 {
            return Err(RenderError::TooLarge {
                what: "a picture's side in pixels (at least 1)",
                needed: u64::from(width.max(height)),
                allowed: u64::from(limit),
            });
        }
        let renderer = Renderer::new(&gpu, FORMAT)?;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let target = gpu.device.create_texture(&texture_2d("picture", (width, height), FORMAT, usage));
        gpu.check()?;
        Ok(Self { gpu, renderer, target, has_surfaces: false })
    }

    /// The device.
    #[must_use]
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The renderer, for creating assets.
    #[must_use]
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.target.width(), self.target.height())
    }

    /// Draws a frame and waits until it is done.
    ///
    /// # Errors
    /// As [`Renderer::record`].
    pub fn frame(&mut self, frame: &Frame<'_>) -> Result<Counters, RenderError> {
        let view = self.target.create_view(&Default::default());
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let size = self.size();
        let counters = self.renderer.record(&self.gpu, &mut encoder, &Target::colour(&view, size), frame)?;
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu
            .device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| RenderError::Device(e.to_string()))?;
        self.gpu.check()?;
        self.has_surfaces =
            counters.passes.iter().any(|pass| [PassId::GBuffer, PassId::Overdraw].contains(pass));
        Ok(counters)
    }

    /// Submits pending uploads, as a frame does, without drawing, and reclaims finished staging memory.
    ///
    /// # Errors
    /// [`RenderError::Device`] if it is lost.
    pub fn flush(&self) -> Result<(), RenderError> {
        self.gpu.queue.submit([]);
        self.gpu.device.poll(wgpu::PollType::Poll).map_err(|e| RenderError::Device(e.to_string()))?;
        self.gpu.check()
    }

    /// As [`Renderer::time_passes`].
    pub fn time_passes(&mut self, on: bool) {
        self.renderer.time_passes(&self.gpu, on);
    }

    /// As [`Renderer::timings`].
    pub fn timings(&mut self) -> Timings {
        self.renderer.timings()
    }

    /// The last picture, sRGB.
    ///
    /// # Errors
    /// [`RenderError::Picture`] or [`RenderError::Device`] if it cannot be read back.
    pub fn picture(&self) -> Result<RgbaImage, RenderError> {
        let pixels = read_texture(&self.gpu, &self.target, 4)?;
        let (width, height) = self.size();
        RgbaImage::from_raw(width, height, pixels)
            .ok_or_else(|| RenderError::Picture("size and pixels disagree".into()))
    }

    /// Reversed depth of the last frame (near / view depth), rows from the top; 0 = no surface.
    ///
    /// # Errors
    /// As [`Headless::picture`].
    pub fn depth(&self) -> Result<Vec<f32>, RenderError> {
        match self.renderer.intermediate(Resource::Depth) {
            Some(texture) if self.has_surfaces => {
                Ok(bytemuck::pod_collect_to_vec(&read_texture(&self.gpu, texture, 4)?))
            }
            _ => Ok(vec![0.0; self.target.width() as usize * self.target.height() as usize]),
        }
    }

    /// Which pixels of the last frame show a surface, rows from the top.
    ///
    /// # Errors
    /// As [`Headless::picture`].
    pub fn coverage(&self) -> Result<Vec<bool>, RenderError> {
        Ok(self.depth()?.into_iter().map(|d| d > 0.0).collect())
    }

    /// The renderer, for drawing elsewhere.
    #[cfg(test)]
    pub(crate) fn renderer_mut(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// A view of the target, for drawing without waiting.
    #[cfg(test)]
    pub(crate) fn target_view(&self) -> wgpu::TextureView {
        self.target.create_view(&Default::default())
    }

    /// Bytes of an intermediate texture of the last frame, if it has been drawn.
    #[cfg(test)]
    pub(crate) fn intermediate(&self, resource: Resource, bytes_per_texel: u32) -> Option<Vec<u8>> {
        let texture = self.renderer.intermediate(resource)?;
        read_texture(&self.gpu, texture, bytes_per_texel).ok()
    }
}
