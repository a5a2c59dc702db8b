//! Terrain in GPU memory: an atlas of tile heights, and the ground textures.
//!
//! All tiles share one index pattern; a tile is an instance with a place in the atlas. Heights stay integers until the
//! vertex shader has subtracted the eye's, so millimetres survive on a grid of thousands of kilometres.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::util::DeviceExt;

use super::pipeline::TerrainPipelines;
use super::slopes::slopes;
use super::{grid, layers, regions};
use crate::resources::descriptors::{SAMPLED_AND_COPIED, texture_2d};
use crate::resources::gpu::{Gpu, RenderError};
#[cfg(any(test, feature = "reference"))]
use crate::resources::readback::read_texture;
use lodestream_terrain::tiles::{MAX_REGIONS, TILE_MARGIN, TILE_SAMPLES, TileRegion};

/// Texels along a side of the atlas.
const ATLAS_SIDE: u32 = 2048;
/// Tiles along a side of the atlas.
const ATLAS_TILES: u32 = ATLAS_SIDE / TILE_SAMPLES;

/// Number of tiles in the atlas.
pub const TERRAIN_SLOTS: u32 = ATLAS_TILES * ATLAS_TILES;

/// Periods of the near and far ground textures in metres. Their ratio is no fraction of small integers.
const PERIODS: [f64; 2] = [4.0, 23.7];
/// Period of the far texture and of all coarser scales. The far texture is rotated by (0.8, 0.6), so its whole periods
/// are multiples of five; the coarsest scale is 64 times as long.
const FAR_REPEATS: f64 = PERIODS[1] * 5.0 * 64.0;
/// Depth of the ground's relief, world units.
const RELIEF_DEPTH: f32 = 0.12;

/// Largest drawn absolute height in height units; others are clamped.
pub const MAX_DRAWN_HEIGHT: i32 = (1 << 30) - 1;

/// Scale and ground zones of a terrain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainAppearance {
    /// World units per grid unit, above 0.
    pub unit: f64,
    /// World units per height unit, above 0.
    pub height_unit: f64,
    /// Heights in world units above which grass, hill and snow begin, ascending.
    pub zones: [f32; 3],
}

/// One tile to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainPart {
    /// First grid point, in grid units.
    pub origin: [i64; 2],
    /// Binary logarithm of the distance between points, in grid units.
    pub spacing: u8,
    /// Slot in the atlas.
    pub slot: u32,
    /// Quadrants drawn, as in [`lodestream_terrain::tiles::SelectedTile`].
    pub quadrants: u8,
    /// Distances at which its points begin and end to morph onto the next coarser surface, world units.
    pub morph: [f64; 2],
    /// Bit mask of the frame's rough regions that may affect its points.
    pub regions: u32,
}

/// Terrain of a frame.
#[derive(Clone, Copy, Debug)]
pub struct TerrainFrame<'a> {
    /// The terrain.
    pub terrain: &'a TerrainGpu,
    /// Its tiles.
    pub parts: &'a [TerrainPart],
    /// Tiles out of view that may cast shadows into it.
    pub casters: &'a [TerrainPart],
    /// Rough regions, where points morph later; at most [`MAX_REGIONS`].
    pub regions: &'a [TileRegion],
    /// Height of the eye over the highest ground around, world units, at least 0.
    pub above: f64,
    /// Screen error of the selection, in pixels.
    pub error_px: f64,
}

/// `Terrain` of `terrain.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct TerrainUniform {
    eye_fraction: [f32; 3],
    eye_height: i32,
    unit: f32,
    height_unit: f32,
    above: f32,
    relief_depth: f32,
    zones: [f32; 4],
    eye_in_near: [f32; 2],
    eye_in_far: [f32; 2],
    periods: [f32; 2],
    /// The vertical position of the eye within both periods.
    eye_up: [f32; 2],
}

/// Starts the zeroing of the textures early. A device zeroes a texture before its first write, which takes a software
/// driver some hundredths of a second; this overlaps with measuring the terrain. With the bytes per texel of each.
fn begin_zeroing(gpu: &Gpu, textures: [(&wgpu::Texture, u32); 2]) {
    for (texture, bytes) in textures {
        gpu.queue.write_texture(
            texture.as_image_copy(),
            &vec![0; bytes as usize],
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(bytes), rows_per_image: None },
            wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
        );
    }
    gpu.queue.submit([]);
}

/// The eye's position on the grid, split into an integer and a fractional part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct EyeCell {
    /// Corner of the eye's grid cell.
    pub(crate) cell: [i64; 2],
    /// Nearest height unit.
    pub(crate) height: i32,
    /// Offset from there to the eye, world units.
    pub(crate) fraction: DVec3,
}

impl EyeCell {
    pub(crate) fn new(eye: DVec3, look: &TerrainAppearance) -> Self {
        // Beyond 2^40 units no terrain is drawn.
        let limit = 1.1e12;
        let cell = [eye.x, eye.z].map(|x| (x / look.unit).clamp(-limit, limit).floor());
        let height = (eye.y / look.height_unit).round();
        let height = height.clamp(-f64::from(MAX_DRAWN_HEIGHT), f64::from(MAX_DRAWN_HEIGHT));
        Self {
            cell: cell.map(|x| x as i64),
            height: height as i32,
            fraction: DVec3::new(
                eye.x - cell[0] * look.unit,
                eye.y - height * look.height_unit,
                eye.z - cell[1] * look.unit,
            ),
        }
    }
}

/// A terrain's tiles in GPU memory.
#[derive(Debug)]
pub struct TerrainGpu {
    /// Current scale and zones.
    pub(crate) look: TerrainAppearance,
    /// Vertical exaggeration, which `look` includes.
    factor: f64,
    /// Scale and zones without exaggeration.
    made: TerrainAppearance,
    pub(crate) atlas: wgpu::Texture,
    /// Slopes of each tile and of the next coarser one, at the same places as the heights.
    pub(crate) slopes: wgpu::Texture,
    pub(crate) uniform: wgpu::Buffer,
    pub(crate) regions: wgpu::Buffer,
    pub(crate) group: wgpu::BindGroup,
    pub(crate) indices: wgpu::Buffer,
    /// Summary of each slot's content.
    slots: Vec<Slot>,
    written: u64,
}

/// Summary of a tile's heights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Slot {
    /// Lowest and highest, height units.
    pub(crate) heights: [i32; 2],
    /// Sequence number of the write.
    pub(crate) stamp: u64,
}

impl TerrainGpu {
    pub(crate) fn new(
        gpu: &Gpu,
        pipelines: &TerrainPipelines,
        look: TerrainAppearance,
    ) -> Result<Self, RenderError> {
        let device = &gpu.device;
        let allowed = device.limits().max_texture_dimension_2d;
        if allowed < ATLAS_SIDE {
            let what = "the atlas of terrain tiles (side in texels)";
            return Err(RenderError::TooLarge { what, needed: ATLAS_SIDE.into(), allowed: allowed.into() });
        }
        // Heights are read back for reference rays.
        let atlas = |label, format| {
            let size = (ATLAS_SIDE, ATLAS_SIDE);
            device.create_texture(&texture_2d(label, size, format, SAMPLED_AND_COPIED))
        };
        let slopes = atlas("terrain slopes", wgpu::TextureFormat::Rgba16Float);
        let atlas = atlas("terrain heights", wgpu::TextureFormat::R32Sint);
        begin_zeroing(gpu, [(&atlas, 4), (&slopes, 8)]);
        let ground = device.create_texture_with_data(
            &gpu.queue,
            &wgpu::TextureDescriptor {
                label: Some("ground"),
                size: wgpu::Extent3d {
                    width: layers::SIDE,
                    height: layers::SIDE,
                    depth_or_array_layers: layers::LAYERS,
                },
                mip_level_count: layers::LEVELS,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: wgpu::TextureFormat::Rgba8UnormSrgb,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
            wgpu::util::TextureDataOrder::LayerMajor,
            layers::texels(),
        );
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("terrain"),
            size: size_of::<TerrainUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let regions = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("terrain regions"),
            size: size_of::<regions::RegionsUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("ground"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp: gpu.anisotropy_clamp(),
            ..Default::default()
        });
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        let (heights, ground, slope_view) = (view(&atlas), view(&ground), view(&slopes));
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("terrain"),
            layout: &pipelines.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&heights) },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(&ground) },
                wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::Sampler(&sampler) },
                wgpu::BindGroupEntry { binding: 4, resource: regions.as_entire_binding() },
                wgpu::BindGroupEntry {
                    binding: 5,
                    resource: wgpu::BindingResource::TextureView(&slope_view),
                },
            ],
        });
        let indices = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("terrain indices"),
            contents: bytemuck::cast_slice(&grid::indices()),
            usage: wgpu::BufferUsages::INDEX,
        });
        gpu.check()?;
        let slots = vec![Slot::default(); TERRAIN_SLOTS as usize];
        Ok(Self {
            look,
            factor: 1.0,
            made: look,
            atlas,
            slopes,
            uniform,
            regions,
            group,
            indices,
            slots,
            written: 0,
        })
    }

    /// Sets the vertical exaggeration, above 0. Ground cover follows the heights.
    pub fn set_vertical_exaggeration(&mut self, factor: f64) {
        let made = self.made;
        let zones = made.zones.map(|zone| zone * factor as f32);
        self.factor = factor;
        self.look = TerrainAppearance { height_unit: made.height_unit * factor, zones, ..made };
    }

    /// Current scale and zones.
    #[must_use]
    pub fn look(&self) -> TerrainAppearance {
        self.look
    }

    /// Writes a tile's heights (rows of `TILE_SAMPLES`, margin included) into a slot.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`] for a slot at or past [`TERRAIN_SLOTS`], [`RenderError::LevelSize`] for another number of
    /// heights.
    pub fn upload(&mut self, gpu: &Gpu, slot: u32, heights: &[i32]) -> Result<(), RenderError> {
        if slot >= TERRAIN_SLOTS {
            return Err(RenderError::NoSuch {
                what: "terrain slot",
                index: slot as usize,
                count: TERRAIN_SLOTS as usize,
            });
        }
        let expected = (TILE_SAMPLES * TILE_SAMPLES) as usize;
        if heights.len() != expected {
            let (width, height) = (TILE_SAMPLES, TILE_SAMPLES);
            return Err(RenderError::LevelSize { level: 0, width, height, expected, got: heights.len() });
        }
        let heights: Vec<i32> =
            heights.iter().map(|h| (*h).clamp(-MAX_DRAWN_HEIGHT, MAX_DRAWN_HEIGHT)).collect();
        self.written += 1;
        let ends = [heights.iter().min(), heights.iter().max()].map(|end| end.copied().unwrap_or(0));
        self.slots[slot as usize] = Slot { heights: ends, stamp: self.written };
        let [x, y] = texel(slot);
        let write = |texture, bytes: &[u8]| {
            gpu.queue.write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture,
                    mip_level: 0,
                    origin: wgpu::Origin3d { x, y, z: 0 },
                    aspect: wgpu::TextureAspect::All,
                },
                bytes,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(bytes.len() as u32 / TILE_SAMPLES),
                    rows_per_image: Some(TILE_SAMPLES),
                },
                wgpu::Extent3d { width: TILE_SAMPLES, height: TILE_SAMPLES, depth_or_array_layers: 1 },
            );
        };
        write(&self.atlas, bytemuck::cast_slice(&heights));
        write(&self.slopes, bytemuck::cast_slice(&slopes(&heights)));
        Ok(())
    }

    #[cfg(any(test, feature = "reference"))]
    /// Reads back the heights of all slots, in rows of `TILE_SAMPLES`. Waits for the device.
    pub(crate) fn heights(&self, gpu: &Gpu) -> Result<impl Fn(u32) -> Vec<i32>, RenderError> {
        let all: Vec<i32> = bytemuck::pod_collect_to_vec(&read_texture(gpu, &self.atlas, 4)?);
        Ok(move |slot| {
            let [x, y] = texel(slot).map(|at| at as usize);
            let row = |row| (y + row) * ATLAS_SIDE as usize + x;
            let side = TILE_SAMPLES as usize;
            (0..side).flat_map(|i| &all[row(i)..row(i) + side]).copied().collect()
        })
    }

    /// Summary of a slot.
    pub(crate) fn slot(&self, slot: u32) -> Slot {
        self.slots.get(slot as usize).copied().unwrap_or_default()
    }

    /// Bytes in GPU memory.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        // Four bytes of height and eight of slopes a sample.
        u64::from(ATLAS_SIDE) * u64::from(ATLAS_SIDE) * 12 + layers::BYTES
    }

    /// Uploads the frame's uniforms.
    pub(crate) fn write_uniform(&self, gpu: &Gpu, eye: &EyeCell, position: DVec3, frame: &TerrainFrame<'_>) {
        let within = |period: f64| [position.x, position.z].map(|x| x.rem_euclid(period) as f32);
        let [sand, grass, hill] = self.made.zones;
        let width = 0.08 * ((grass - sand).min(hill - grass)).max(1e-3) * self.factor as f32;
        let [sand, grass, hill] = self.look.zones;
        let uniform = TerrainUniform {
            eye_fraction: eye.fraction.as_vec3().to_array(),
            eye_height: eye.height,
            unit: self.look.unit as f32,
            height_unit: self.look.height_unit as f32,
            above: frame.above.max(0.0) as f32,
            relief_depth: RELIEF_DEPTH,
            zones: [sand, grass, hill, width],
            eye_in_near: within(PERIODS[0]),
            eye_in_far: within(FAR_REPEATS),
            periods: PERIODS.map(|p| p as f32),
            eye_up: [PERIODS[0], FAR_REPEATS].map(|period| position.y.rem_euclid(period) as f32),
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        if !frame.regions.is_empty() {
            let regions = regions::RegionsUniform::new(
                &frame.regions[..frame.regions.len().min(MAX_REGIONS)],
                position,
            );
            gpu.queue.write_buffer(&self.regions, 0, bytemuck::bytes_of(&regions));
        }
    }
}

/// Texel of a slot's first point, margin included.
fn texel(slot: u32) -> [u32; 2] {
    [slot % ATLAS_TILES * TILE_SAMPLES, slot / ATLAS_TILES * TILE_SAMPLES]
}

/// Texel of a slot's first point without its margin.
pub(crate) fn first_texel(slot: u32) -> [i32; 2] {
    texel(slot).map(|x| (x + TILE_MARGIN) as i32)
}
