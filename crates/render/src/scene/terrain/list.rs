//! Instances and draws of a frame's terrain tiles.

use glam::DVec3;

use super::TerrainPart;
use super::atlas::{EyeCell, TerrainFrame, TerrainGpu, first_texel};
use super::grid::QUADRANT_INDICES;
use super::regions::shader_morph;
use super::tile_raw::TileRaw;
use crate::frame::counters::Counters;
use crate::frame::receivers::Receivers;
use crate::passes::shadows::Casters;
use crate::resources::buffer::GrowingBuffer;
use crate::resources::gpu::{Gpu, RenderError};
use lodestream_terrain::tiles::TILE_CELLS;

/// One draw: a run of the index pattern, for a run of instances.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Batch {
    indices: std::ops::Range<u32>,
    instances: std::ops::Range<u32>,
}

/// A frame's terrain, ready to draw.
pub(crate) struct TileList<'a> {
    frame: TerrainFrame<'a>,
    batches: Vec<Batch>,
    /// Shadow casters by cascade.
    casters: Vec<Vec<Batch>>,
}

/// Extends `receivers` by the frame's terrain.
pub(crate) fn receivers(frame: &TerrainFrame<'_>, eye: DVec3, receivers: &mut Receivers) {
    let reach = |part: &TerrainPart| {
        let (centre, radius) = sphere(part, frame.terrain, eye);
        centre.length() + radius
    };
    let Some(farthest) = frame.parts.iter().map(reach).reduce(f64::max) else { return };
    // If the eye is below the highest ground around, the nearest distance is unknown.
    let nearest = if frame.above > 0.0 { frame.above } else { farthest };
    receivers.add_around(nearest, farthest);
}

/// A sphere around a tile, relative to the eye, world units.
fn sphere(part: &TerrainPart, terrain: &TerrainGpu, eye: DVec3) -> (DVec3, f64) {
    let look = terrain.look;
    let side = look.unit * (i64::from(TILE_CELLS) << part.spacing) as f64;
    let [low, high] = terrain.slot(part.slot).heights.map(|height| f64::from(height) * look.height_unit);
    let corner = DVec3::new(part.origin[0] as f64 * look.unit, low, part.origin[1] as f64 * look.unit);
    let box_ = DVec3::new(side, high - low, side);
    (corner + 0.5 * box_ - eye, 0.5 * box_.length())
}

impl<'a> TileList<'a> {
    /// Writes the frame's tiles into `buffer`, then for each cascade those that may cast shadows into its map.
    pub(crate) fn new(
        gpu: &Gpu,
        frame: TerrainFrame<'a>,
        eye: DVec3,
        cascades: &mut [Casters<'_>],
        buffer: &mut GrowingBuffer<TileRaw>,
    ) -> Result<Self, RenderError> {
        let at = EyeCell::new(eye, &frame.terrain.look);
        let mut tiles = Vec::with_capacity(frame.parts.len());
        let batches = batches(frame.parts.iter(), &at, &mut tiles);
        let mut casters = Vec::with_capacity(cascades.len());
        for into in cascades {
            into.key.push(frame.terrain.look.height_unit.to_bits());
            let parts: Vec<_> = frame
                .parts
                .iter()
                .chain(frame.casters)
                .filter(|part| {
                    let (centre, radius) = sphere(part, frame.terrain, eye);
                    let top = into.top_of(eye, centre, radius);
                    if let Some(top) = top {
                        into.tile(part, frame.terrain.slot(part.slot).stamp, top);
                    }
                    top.is_some()
                })
                .collect();
            casters.push(self::batches(parts.into_iter(), &at, &mut tiles));
        }
        buffer.write(gpu, 0, &tiles)?;
        frame.terrain.write_uniform(gpu, &at, eye, &frame);
        Ok(Self { frame, batches, casters })
    }

    /// Whether there is something to draw.
    pub(crate) fn is_empty(&self) -> bool {
        self.batches.is_empty() && self.casters.iter().all(Vec::is_empty)
    }

    /// Draws surfaces, wireframe or overdraw.
    pub(crate) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        pipeline: &wgpu::RenderPipeline,
        instances: &wgpu::Buffer,
        counters: &mut Counters,
    ) {
        pass.set_pipeline(pipeline);
        let triangles = self.run(pass, instances, &self.batches);
        counters.draws += self.batches.len() as u32;
        counters.triangles += triangles;
        counters.terrain_triangles += triangles;
        counters.terrain_tiles +=
            self.batches.iter().map(|b| b.instances.end - b.instances.start).sum::<u32>();
    }

    /// Draws the shadow casters of a cascade. Returns the number of triangles.
    pub(crate) fn cast(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        pipeline: &wgpu::RenderPipeline,
        instances: &wgpu::Buffer,
        cascade: usize,
    ) -> u64 {
        pass.set_pipeline(pipeline);
        self.casters.get(cascade).map_or(0, |batches| self.run(pass, instances, batches))
    }

    fn run(&self, pass: &mut wgpu::RenderPass<'_>, instances: &wgpu::Buffer, batches: &[Batch]) -> u64 {
        pass.set_bind_group(1, &self.frame.terrain.group, &[]);
        pass.set_vertex_buffer(0, instances.slice(..));
        pass.set_index_buffer(self.frame.terrain.indices.slice(..), wgpu::IndexFormat::Uint16);
        let draw = |batch: &Batch| {
            pass.draw_indexed(batch.indices.clone(), 0, batch.instances.clone());
            let tiles = u64::from(batch.instances.end - batch.instances.start);
            u64::from(batch.indices.end - batch.indices.start) / 3 * tiles
        };
        batches.iter().map(draw).sum()
    }
}

/// Adds tiles to a list, whole tiles first, then those with single quadrants, and returns their draws.
fn batches<'p>(
    parts: impl Iterator<Item = &'p TerrainPart> + Clone,
    eye: &EyeCell,
    tiles: &mut Vec<TileRaw>,
) -> Vec<Batch> {
    let quadrant = |q: u32| q * QUADRANT_INDICES..(q + 1) * QUADRANT_INDICES;
    let mut batches = Vec::new();
    for run in 0..5 {
        let (indices, first) = match run {
            0 => (0..4 * QUADRANT_INDICES, tiles.len()),
            q => (quadrant(q - 1), tiles.len()),
        };
        let taken = |quadrants: u8| match run {
            0 => quadrants == 0b1111,
            q => quadrants != 0b1111 && quadrants & (1 << (q - 1)) != 0,
        };
        let parts = parts.clone().filter(|part| taken(part.quadrants));
        tiles.extend(parts.filter_map(|part| raw(part, eye)));
        if tiles.len() > first {
            batches.push(Batch { indices, instances: first as u32..tiles.len() as u32 });
        }
    }
    batches
}

/// The instance of a tile; `None` if it is too far from the eye for 32-bit integers.
fn raw(part: &TerrainPart, eye: &EyeCell) -> Option<TileRaw> {
    let side = i64::from(TILE_CELLS) << part.spacing;
    let from_eye = [0, 1].map(|i| part.origin[i] - eye.cell[i]);
    let far = from_eye.iter().any(|&o| i32::try_from(o).is_err() || i32::try_from(o + side).is_err());
    if far {
        return None;
    }
    Some(TileRaw {
        from_eye: from_eye.map(|o| o as i32),
        atlas: first_texel(part.slot),
        morph: shader_morph(part.morph),
        spacing: u32::from(part.spacing),
        regions: part.regions,
    })
}
