//! Streamed textures, whose mip levels arrive coarse to fine.
//!
//! GPU memory follows the received levels: the texture is allocated down to the finest received level, and replaced by
//! a larger one (levels copied on the GPU) when a finer one arrives. Views cover only the unbroken run of levels from
//! the coarsest up, so that trilinear filtering never reads a missing level.

use std::borrow::Cow;
use std::ops::Range;
#[cfg(any(test, feature = "client"))]
use std::sync::Weak;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use lodestream_scene::asset::{TextureInfo, TextureKind, level_size};

use crate::resources::descriptors::{SAMPLED_AND_COPIED, texture_2d};
use crate::resources::gpu::{Gpu, RenderError};
use crate::scene::relief_acceleration::ReliefAcceleration;

/// Browsers write pictures into textures by drawing.
const STREAMED: wgpu::TextureUsages = if cfg!(target_family = "wasm") {
    SAMPLED_AND_COPIED.union(wgpu::TextureUsages::RENDER_ATTACHMENT)
} else {
    SAMPLED_AND_COPIED
};
/// Longest allocated side; finer levels are dropped, so that a forged size cannot claim gigabytes.
const MAX_SIDE_PX: u32 = 8192;

/// Size and purpose of a texture, known before any of its levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureShape {
    /// Width of the finest level in texels.
    pub width: u32,
    /// Height of the finest level in texels.
    pub height: u32,
    /// Number of levels, each half as wide and high as the next finer one (at least 1; a chain
    /// need not go down to 1×1).
    pub levels: u32,
    /// Purpose.
    pub kind: TextureKind,
    /// Mean of the texels, colours linear: stands for a colour or surface texture until its coarsest level is here.
    pub mean: [f32; 3],
}

impl TextureShape {
    /// A shape with all levels down to 1×1, white until then.
    #[must_use]
    pub fn full(width: u32, height: u32, kind: TextureKind) -> Self {
        Self { width, height, levels: width.max(height).max(1).ilog2() + 1, kind, mean: [1.0; 3] }
    }

    /// Width and height of a level; level 0 is the coarsest, as on the wire.
    #[must_use]
    pub fn level_size(&self, level: u32) -> (u32, u32) {
        level_size([self.width, self.height], self.levels, level).into()
    }
}

/// Linear light of an sRGB byte (IEC 61966-2-1).
fn from_srgb(encoded: u8) -> f32 {
    let encoded = f32::from(encoded) / 255.0;
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

impl From<&TextureInfo> for TextureShape {
    fn from(info: &TextureInfo) -> Self {
        let &TextureInfo { kind, width, height, mean, ref levels } = info;
        let decode = |encoded| match kind {
            TextureKind::Color => from_srgb(encoded),
            TextureKind::Height | TextureKind::Normal | TextureKind::Surface => f32::from(encoded) / 255.0,
        };
        let mean = mean.map_or([1.0; 3], |mean| mean.map(decode));
        Self { width, height, levels: levels.len() as u32, kind, mean }
    }
}

/// Decoded pixels of one mip level, rows from the top, tightly packed.
#[derive(Clone, Copy, Debug)]
pub enum TextureData<'a> {
    /// Four bytes per texel. A height texture takes the red channel.
    Rgba8(&'a [u8]),
    /// One byte per texel. A colour texture takes it as grey.
    R8(&'a [u8]),
    /// One 16-bit value per texel. A colour texture takes the high byte as grey.
    R16(&'a [u16]),
    /// A picture that the browser has decoded.
    #[cfg(target_family = "wasm")]
    Bitmap(&'a web_sys::ImageBitmap),
}

impl<'a> TextureData<'a> {
    /// The given rows, of `width` texels each.
    fn rows(self, width: u32, rows: &Range<u32>) -> Self {
        let [first, end] = [rows.start, rows.end].map(|row| row as usize * width as usize);
        match self {
            Self::Rgba8(d) => Self::Rgba8(&d[4 * first..4 * end]),
            Self::R8(d) => Self::R8(&d[first..end]),
            Self::R16(d) => Self::R16(&d[first..end]),
            #[cfg(target_family = "wasm")]
            Self::Bitmap(_) => self,
        }
    }

    fn texels(&self) -> usize {
        match self {
            Self::Rgba8(d) if d.len().is_multiple_of(4) => d.len() / 4,
            Self::Rgba8(_) => 0,
            Self::R8(d) => d.len(),
            Self::R16(d) => d.len(),
            #[cfg(target_family = "wasm")]
            Self::Bitmap(picture) => picture.width() as usize * picture.height() as usize,
        }
    }

    fn convert(self, format: wgpu::TextureFormat) -> Cow<'a, [u8]> {
        let grey = |g: u8| [g, g, g, 255];
        use wgpu::TextureFormat::{R16Unorm, Rgba8Unorm, Rgba8UnormSrgb};
        match (format, self) {
            (Rgba8UnormSrgb | Rgba8Unorm, Self::Rgba8(d)) => d.into(),
            (Rgba8UnormSrgb | Rgba8Unorm, Self::R8(d)) => d.iter().flat_map(|&g| grey(g)).collect(),
            (Rgba8UnormSrgb | Rgba8Unorm, Self::R16(d)) => {
                d.iter().flat_map(|&g| grey((g >> 8) as u8)).collect()
            }
            // × 257 maps 0..=255 onto 0..=65535 exactly.
            (R16Unorm, Self::Rgba8(d)) => {
                d.chunks_exact(4).flat_map(|p| (u16::from(p[0]) * 257).to_le_bytes()).collect()
            }
            (R16Unorm, Self::R8(d)) => d.iter().flat_map(|&g| (u16::from(g) * 257).to_le_bytes()).collect(),
            (R16Unorm, Self::R16(d)) => d.iter().flat_map(|g| g.to_le_bytes()).collect(),
            (_, Self::Rgba8(d)) => d.chunks_exact(4).map(|p| p[0]).collect(),
            (_, Self::R8(d)) => d.into(),
            (_, Self::R16(d)) => d.iter().map(|g| (g >> 8) as u8).collect(),
            // Not read by the CPU.
            #[cfg(target_family = "wasm")]
            (_, Self::Bitmap(_)) => Cow::default(),
        }
    }
}

/// Copies rows of a picture, as its file has them: neither colour space nor alpha is converted. They begin at the
/// target's row.
#[cfg(target_family = "wasm")]
fn copy_bitmap(
    gpu: &Gpu,
    picture: &web_sys::ImageBitmap,
    to: wgpu::TexelCopyTextureInfo<'_>,
    [width, height]: [u32; 2],
) {
    let from = wgpu::CopyExternalImageSourceInfo {
        source: wgpu::ExternalImageSource::ImageBitmap(picture.clone()),
        origin: wgpu::Origin2d { x: 0, y: to.origin.y },
        flip_y: false,
    };
    let to = to.to_tagged(wgpu::PredefinedColorSpace::Srgb, false);
    gpu.queue.copy_external_image_to_texture(
        &from,
        to,
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
}

/// The finest level of the unbroken run from the coarsest; `None` while the coarsest is missing.
fn finest_usable(present: &[bool]) -> Option<u32> {
    (present.iter().take_while(|p| **p).count() as u32).checked_sub(1)
}

/// A texture whose levels arrive.
#[derive(Debug)]
struct StreamedTexture {
    declared: TextureShape,
    /// Shape with all its levels.
    shape: TextureShape,
    format: wgpu::TextureFormat,
    present: Vec<bool>,
    /// Finest level that may be allocated on this device, if any.
    limit: Option<u32>,
    /// The texture and its finest level: the GPU's mip level 0.
    allocated: Option<(wgpu::Texture, u32)>,
    /// Relief acceleration textures, with the level that they were built from; the inner `None` marks height maps that
    /// are too large.
    accelerations: [Option<(u32, Option<wgpu::Texture>)>; ReliefAcceleration::COUNT],
}

impl StreamedTexture {
    fn new(gpu: &Gpu, declared: TextureShape) -> Self {
        let shape = declared;
        let full = TextureShape::full(shape.width, shape.height, shape.kind).levels;
        let shape = TextureShape { levels: shape.levels.clamp(1, full), ..shape };
        let side = gpu.device.limits().max_texture_dimension_2d.min(MAX_SIDE_PX);
        let fits = |level: &u32| {
            let (w, h) = shape.level_size(*level);
            w.max(h) <= side
        };
        let limit = (0..shape.levels).rev().find(fits);
        let format = match shape.kind {
            TextureKind::Color => wgpu::TextureFormat::Rgba8UnormSrgb,
            TextureKind::Normal | TextureKind::Surface => wgpu::TextureFormat::Rgba8Unorm,
            TextureKind::Height
                if gpu.device.features().contains(wgpu::Features::TEXTURE_FORMAT_16BIT_NORM) =>
            {
                wgpu::TextureFormat::R16Unorm
            }
            TextureKind::Height => wgpu::TextureFormat::R8Unorm,
        };
        let present = vec![false; shape.levels as usize];
        Self { declared, shape, format, present, limit, allocated: None, accelerations: Default::default() }
    }

    /// Bytes of the allocated levels.
    fn bytes(&self) -> u64 {
        let texel = u64::from(self.format.block_copy_size(None).unwrap_or(1));
        let level = |level| {
            let (width, height) = self.shape.level_size(level);
            u64::from(width) * u64::from(height) * texel
        };
        self.allocated.as_ref().map_or(0, |(_, top)| (0..=*top).map(level).sum())
    }

    /// Finest level in use, once the coarsest has arrived.
    fn finest(&self) -> Option<u32> {
        finest_usable(&self.present)
    }

    /// Uploads some rows of one level; `data` holds the whole level, and earlier rows were uploaded before. Returns
    /// whether the picture changes: once the last row is uploaded.
    fn upload(
        &mut self,
        gpu: &Gpu,
        level: u32,
        data: TextureData<'_>,
        rows: &Range<u32>,
    ) -> Result<bool, RenderError> {
        let count = self.present.len();
        let Some(slot) = self.present.get_mut(level as usize) else {
            return Err(RenderError::NoSuch { what: "texture level", index: level as usize, count });
        };
        let (width, height) = self.shape.level_size(level);
        let expected = width as usize * height as usize;
        if data.texels() != expected {
            return Err(RenderError::LevelSize { level, width, height, expected, got: data.texels() });
        }
        if self.limit.is_none_or(|limit| level > limit) {
            return Ok(false);
        }
        let rows = rows.start.min(height)..rows.end.min(height);
        let whole = rows.end == height;
        *slot |= whole;
        self.reach(gpu, level);
        if let Some((texture, top)) = self.allocated.as_ref().filter(|_| !rows.is_empty()) {
            let to = wgpu::TexelCopyTextureInfo {
                texture,
                mip_level: top - level,
                origin: wgpu::Origin3d { x: 0, y: rows.start, z: 0 },
                aspect: wgpu::TextureAspect::All,
            };
            #[cfg(target_family = "wasm")]
            if let TextureData::Bitmap(picture) = data {
                copy_bitmap(gpu, picture, to, [width, rows.end - rows.start]);
                return Ok(whole);
            }
            let pixels = data.rows(width, &rows).convert(self.format);
            gpu.queue.write_texture(
                to,
                &pixels,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(width * self.format.block_copy_size(None).unwrap_or(1)),
                    rows_per_image: None,
                },
                wgpu::Extent3d { width, height: rows.end - rows.start, depth_or_array_layers: 1 },
            );
        }
        Ok(whole)
    }

    /// Allocates `level`, and copies the coarser levels.
    fn reach(&mut self, gpu: &Gpu, level: u32) {
        if self.allocated.as_ref().is_some_and(|(_, top)| *top >= level) {
            return;
        }
        let usage = STREAMED;
        let new = gpu.device.create_texture(&wgpu::TextureDescriptor {
            mip_level_count: level + 1,
            ..texture_2d("streamed texture", self.shape.level_size(level), self.format, usage)
        });
        if let Some((old, top)) = &self.allocated {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            for l in 0..=*top {
                let (width, height) = self.shape.level_size(l);
                let side = |texture, base| wgpu::TexelCopyTextureInfo {
                    texture,
                    mip_level: base - l,
                    origin: wgpu::Origin3d::ZERO,
                    aspect: wgpu::TextureAspect::All,
                };
                encoder.copy_texture_to_texture(
                    side(old, *top),
                    side(&new, level),
                    wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                );
            }
            gpu.queue.submit([encoder.finish()]);
        }
        self.allocated = Some((new, level));
    }

    /// A view of the usable levels.
    fn view(&self) -> Option<wgpu::TextureView> {
        let finest = self.finest()?;
        let (texture, top) = self.allocated.as_ref()?;
        Some(
            texture.create_view(&wgpu::TextureViewDescriptor {
                base_mip_level: top - finest,
                ..Default::default()
            }),
        )
    }

    /// The allocated texture, and the finest level in use.
    fn used_levels(&self) -> Option<(wgpu::Texture, u32)> {
        Some((self.allocated.as_ref()?.0.clone(), self.finest()?))
    }

    /// The relief acceleration texture of the finest level in use. Built once per level, which waits for the device;
    /// `None` for maps that are too large, without a level, or if readback fails.
    fn acceleration(&mut self, gpu: &Gpu, acceleration: ReliefAcceleration) -> Option<wgpu::TextureView> {
        let finest = self.finest()?;
        let kept = &mut self.accelerations[acceleration.number()];
        if kept.as_ref().is_none_or(|(level, _)| *level != finest) {
            let (texture, top) = self.allocated.as_ref()?;
            let made = acceleration.make(gpu, texture, top - finest);
            let made = made.inspect_err(|why| tracing::warn!("relief is found by equal steps: {why}"));
            *kept = Some((finest, made.ok().flatten()));
        }
        let (_, made) = kept.as_ref()?;
        made.as_ref().map(|texture| texture.create_view(&Default::default()))
    }
}

/// A texture in GPU memory for [`crate::Renderer::create_asset_with`]. Clones share one texture, so that several
/// assets may use it; the last clone frees it.
#[derive(Clone, Debug)]
pub struct Texture(Arc<Mutex<StreamedTexture>>);

impl Texture {
    /// A texture without levels.
    #[must_use]
    pub fn new(gpu: &Gpu, shape: TextureShape) -> Self {
        Self(Arc::new(Mutex::new(StreamedTexture::new(gpu, shape))))
    }

    /// Size and purpose, as given.
    #[must_use]
    pub fn declared_shape(&self) -> TextureShape {
        self.streamed().declared
    }

    /// GPU memory of the levels that are allocated, in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.streamed().bytes()
    }

    #[cfg(any(test, feature = "client"))]
    /// A weak reference.
    pub(crate) fn downgrade(&self) -> WeakTexture {
        WeakTexture(Arc::downgrade(&self.0))
    }

    // No panic can happen between changes that belong together, so a poisoned lock is consistent.
    fn streamed(&self) -> MutexGuard<'_, StreamedTexture> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Mean colour, linear, used while there is no level.
    pub(crate) fn mean(&self) -> [f32; 3] {
        self.streamed().shape.mean
    }

    pub(crate) fn kind(&self) -> TextureKind {
        self.streamed().shape.kind
    }

    /// Finest level in use, once the coarsest has arrived.
    pub(crate) fn finest(&self) -> Option<u32> {
        self.streamed().finest()
    }

    /// A view of the usable levels.
    pub(crate) fn view(&self) -> Option<wgpu::TextureView> {
        self.streamed().view()
    }

    /// What [`Texture::view`] shows: the allocated texture, and the finest level in use.
    pub(crate) fn used_levels(&self) -> Option<(wgpu::Texture, u32)> {
        self.streamed().used_levels()
    }

    /// The relief acceleration texture ([`StreamedTexture::acceleration`]).
    pub(crate) fn acceleration(
        &self,
        gpu: &Gpu,
        acceleration: ReliefAcceleration,
    ) -> Option<wgpu::TextureView> {
        self.streamed().acceleration(gpu, acceleration)
    }

    /// Uploads some rows of one level, whole in `data`. A texture shared by several assets takes each level once.
    /// Returns whether the picture may change.
    pub(crate) fn upload(
        &self,
        gpu: &Gpu,
        level: u32,
        data: TextureData<'_>,
        rows: &Range<u32>,
    ) -> Result<bool, RenderError> {
        let shared = Arc::strong_count(&self.0) > 1;
        let mut streamed = self.streamed();
        if shared && streamed.present.get(level as usize) == Some(&true) {
            return Ok(true);
        }
        streamed.upload(gpu, level, data, rows)
    }
}

#[cfg(any(test, feature = "client"))]
/// A weak reference to a [`Texture`].
#[derive(Clone, Debug)]
pub(crate) struct WeakTexture(Weak<Mutex<StreamedTexture>>);

#[cfg(any(test, feature = "client"))]
impl WeakTexture {
    pub(crate) fn upgrade(&self) -> Option<Texture> {
        self.0.upgrade().map(Texture)
    }
}

#[cfg(test)]
mod tests {
    use lodestream_scene::asset::{TextureFormat, TextureLevel};

    use super::*;

    #[test]
    fn only_an_unbroken_run_of_levels_is_used() {
        assert_eq!(finest_usable(&[false, false, false]), None);
        assert_eq!(finest_usable(&[false, true, true]), None);
        assert_eq!(finest_usable(&[true, false, false]), Some(0));
        assert_eq!(finest_usable(&[true, false, true]), Some(0));
        assert_eq!(finest_usable(&[true, true, true]), Some(2));
    }

    #[test]
    fn level_sizes_follow_the_halving_rule() {
        let shape = TextureShape::full(300, 7, TextureKind::Color);
        assert_eq!(shape.levels, 9);
        assert_eq!(shape.level_size(8), (300, 7));
        assert_eq!(shape.level_size(7), (150, 3));
        assert_eq!(shape.level_size(0), (1, 1));
        let short = TextureShape { levels: 2, ..shape };
        assert_eq!((short.level_size(0), short.level_size(1)), ((150, 3), (300, 7)));
    }

    #[test]
    fn conversions_keep_the_extremes() {
        let r16 = TextureData::R8(&[0, 255]).convert(wgpu::TextureFormat::R16Unorm);
        assert_eq!(*r16, [0, 0, 255, 255]);
        let rgba = TextureData::R16(&[0xffff]).convert(wgpu::TextureFormat::Rgba8UnormSrgb);
        assert_eq!(*rgba, [255; 4]);
        assert_eq!(TextureData::Rgba8(&[1, 2, 3]).texels(), 0);
    }

    #[test]
    fn the_mean_colour_is_linear_and_white_where_none_is_said() {
        let info = |mean| TextureInfo {
            kind: TextureKind::Color,
            width: 8,
            height: 8,
            mean,
            levels: vec![TextureLevel { width: 8, height: 8, bytes: 100, format: TextureFormat::Png }],
        };
        assert_eq!(TextureShape::from(&info(None)).mean, [1.0; 3]);
        let [r, g, b] = TextureShape::from(&info(Some([255, 188, 10]))).mean;
        assert!(
            (r - 1.0).abs() < 1e-6 && (g - 0.5029).abs() < 1e-4 && (b - 0.003_035).abs() < 1e-6,
            "{r} {g} {b}"
        );
    }
}
