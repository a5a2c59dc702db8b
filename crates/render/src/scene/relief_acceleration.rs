//! Acceleration textures of relief mapping: cones, or a pyramid of maximum heights. Built on the CPU from the device's
//! height map, on first use.

use crate::cpu_reference::relief::ReliefMap;
use crate::cpu_reference::relief::cones::Cones;
use crate::cpu_reference::relief::pyramid::Pyramid;
use crate::resources::descriptors::{group_layout, layout_entry, texture_2d, texture_binding};
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::readback::read_texture;

/// Most texels of a map with cones: twice the side takes sixteen times as long.
const MAX_CONE_TEXELS: u64 = 256 * 256;
/// Most texels of a map with a pyramid.
const MAX_PYRAMID_TEXELS: u64 = 2048 * 2048;

/// Kind of acceleration texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReliefAcceleration {
    /// Relaxed cones, one per texel.
    Cones,
    /// Maximum heights of ever larger cells.
    Pyramid,
}

impl ReliefAcceleration {
    /// Number of kinds.
    pub(crate) const COUNT: usize = 2;

    /// Index of the kind.
    pub(crate) const fn number(self) -> usize {
        match self {
            Self::Cones => 0,
            Self::Pyramid => 1,
        }
    }

    /// Whether maps of this size can have one.
    fn suits(self, [width, height]: [u32; 2]) -> bool {
        let most = match self {
            Self::Cones => MAX_CONE_TEXELS,
            Self::Pyramid => MAX_PYRAMID_TEXELS,
        };
        u64::from(width) * u64::from(height) <= most
    }

    /// Layout of group 3: the acceleration texture.
    pub(crate) fn layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
        let texture = texture_binding(false, wgpu::TextureViewDimension::D2);
        group_layout(gpu, "relief acceleration", &[layout_entry(0, wgpu::ShaderStages::FRAGMENT, texture)])
    }

    /// Builds the texture from a mip level of heights; `None` for maps that are too large. Waits for the device.
    ///
    /// # Errors
    /// Errors of reading the heights back.
    pub(crate) fn make(
        self,
        gpu: &Gpu,
        heights: &wgpu::Texture,
        level: u32,
    ) -> Result<Option<wgpu::Texture>, RenderError> {
        let size = [heights.width(), heights.height()].map(|side| (side >> level).max(1));
        if !self.suits(size) {
            return Ok(None);
        }
        let map = read_heights(gpu, heights, level, size)?;
        Ok(Some(match self {
            Self::Cones => upload(gpu, &[(size, Cones::relaxed(&map).ratios())]),
            Self::Pyramid => {
                let pyramid = Pyramid::new(&map);
                let level = |level: &'_ ReliefMap| [level.width as u32, level.height as u32];
                let levels: Vec<_> = pyramid.levels().iter().map(|of| (level(of), &of.texels[..])).collect();
                upload(gpu, &levels)
            }
        }))
    }
}

/// Reads back a mip level of heights.
fn read_heights(
    gpu: &Gpu,
    heights: &wgpu::Texture,
    level: u32,
    [width, height]: [u32; 2],
) -> Result<ReliefMap, RenderError> {
    let format = heights.format();
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let usage = wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC;
    let descriptor = texture_2d("heights to read back", (width, height), format, usage);
    let copy = gpu.device.create_texture(&descriptor);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let from = wgpu::TexelCopyTextureInfo { mip_level: level, ..heights.as_image_copy() };
    encoder.copy_texture_to_texture(from, copy.as_image_copy(), size);
    gpu.queue.submit([encoder.finish()]);
    let texels = if format == wgpu::TextureFormat::R16Unorm {
        let bytes = read_texture(gpu, &copy, 2)?;
        let texel = |pair: &[u8; 2]| f64::from(u16::from_le_bytes(*pair)) / 65535.0;
        bytes.as_chunks().0.iter().map(texel).collect()
    } else {
        read_texture(gpu, &copy, 1)?.into_iter().map(|byte| f64::from(byte) / 255.0).collect()
    };
    Ok(ReliefMap { width: width as usize, height: height as usize, texels })
}

/// Uploads an f32 texture with these levels, finest first, each half the size of the previous.
fn upload(gpu: &Gpu, levels: &[([u32; 2], &[f64])]) -> wgpu::Texture {
    let extent = |[width, height]: [u32; 2]| wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let finest = levels.first().map_or([1; 2], |(size, _)| *size);
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        mip_level_count: levels.len().max(1) as u32,
        ..texture_2d("relief acceleration", finest.into(), wgpu::TextureFormat::R32Float, usage)
    });
    for (level, (size, values)) in (0..).zip(levels) {
        let texels: Vec<u8> = values.iter().flat_map(|value| (*value as f32).to_le_bytes()).collect();
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level: level, ..texture.as_image_copy() },
            &texels,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size[0]), rows_per_image: None },
            extent(*size),
        );
    }
    texture
}
