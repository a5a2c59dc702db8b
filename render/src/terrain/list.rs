//! The tiles of a frame as the GPU gets them.

use super::atlas::{EyeCell, TerrainFrame, arrival, first_texel};
use super::grid::QUADRANT_INDICES;
use super::pipeline::TerrainPipelines;
use super::tile_raw::TileRaw;
use crate::buffer::GrowingBuffer;
use crate::counters::Counters;
use crate::gpu::{Gpu, RenderError};
use crate::tiles::TILE_CELLS;

/// What is drawn at once: a run of the index pattern, for a run of instances.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Batch {
    indices: std::ops::Range<u32>,
    instances: std::ops::Range<u32>,
}

/// A frame's terrain, ready to draw.
pub(crate) struct TileList<'a> {
    frame: TerrainFrame<'a>,
    batches: Vec<Batch>,
}

impl<'a> TileList<'a> {
    /// Writes the frame's tiles into `buffer`: whole ones first, then those of which single quadrants are drawn.
    pub(crate) fn new(
        gpu: &Gpu,
        frame: TerrainFrame<'a>,
        eye: glam::DVec3,
        buffer: &mut GrowingBuffer<TileRaw>,
    ) -> Result<Self, RenderError> {
        let at = EyeCell::new(eye, &frame.terrain.look);
        let mut tiles = Vec::with_capacity(frame.parts.len());
        let mut batches = Vec::new();
        let quadrant = |q: u32| q * QUADRANT_INDICES..(q + 1) * QUADRANT_INDICES;
        for run in 0..5 {
            let (indices, first) = match run {
                0 => (0..4 * QUADRANT_INDICES, tiles.len()),
                q => (quadrant(q - 1), tiles.len()),
            };
            let taken = |quadrants: u8| match run {
                0 => quadrants == 0b1111,
                q => quadrants != 0b1111 && quadrants & (1 << (q - 1)) != 0,
            };
            let parts = frame.parts.iter().filter(|part| taken(part.quadrants));
            tiles.extend(parts.filter_map(|part| raw(part, &at)));
            if tiles.len() > first {
                batches.push(Batch { indices, instances: first as u32..tiles.len() as u32 });
            }
        }
        buffer.write(gpu, 0, &tiles)?;
        frame.terrain.write_uniform(gpu, &at, eye, &frame);
        Ok(Self { frame, batches })
    }

    /// Whether there is something to draw.
    pub(crate) fn is_empty(&self) -> bool {
        self.batches.is_empty()
    }

    /// Draws the surfaces, or the edges over them.
    pub(crate) fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        pipelines: &TerrainPipelines,
        instances: &wgpu::Buffer,
        (wires, relief): (bool, bool),
        counters: &mut Counters,
    ) {
        let pipeline = match (wires, &pipelines.wire) {
            (true, Some(wire)) => wire,
            (true, None) => return,
            (false, _) if relief => &pipelines.relief,
            (false, _) => &pipelines.plain,
        };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(1, &self.frame.terrain.group, &[]);
        pass.set_vertex_buffer(0, instances.slice(..));
        pass.set_index_buffer(self.frame.terrain.indices.slice(..), wgpu::IndexFormat::Uint16);
        for batch in &self.batches {
            pass.draw_indexed(batch.indices.clone(), 0, batch.instances.clone());
            counters.draws += 1;
            let tiles = u64::from(batch.instances.end - batch.instances.start);
            let triangles = u64::from(batch.indices.end - batch.indices.start) / 3 * tiles;
            counters.triangles += triangles;
            counters.terrain_triangles += triangles;
            counters.terrain_tiles += batch.instances.end - batch.instances.start;
        }
    }
}

/// What the shader gets of a tile, unless it is too far from the eye for integers of 32 bits.
fn raw(part: &super::TerrainPart, eye: &EyeCell) -> Option<TileRaw> {
    let side = i64::from(TILE_CELLS) << part.spacing;
    let origin = [0, 1].map(|i| part.origin[i] - eye.cell[i]);
    let far = origin.iter().any(|&o| i32::try_from(o).is_err() || i32::try_from(o + side).is_err());
    if far {
        return None;
    }
    Some(TileRaw {
        origin: origin.map(|o| o as i32),
        atlas: first_texel(part.slot),
        morph: arrival(part.morph),
        spacing: u32::from(part.spacing),
        regions: part.regions,
    })
}
