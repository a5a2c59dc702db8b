//! States of an asset's parts in GPU memory.

use crate::resources::descriptors::texture_2d;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::vertex::MAX_PARTS;
use crate::scene::part_states::{PartStates, PartWords};

/// `PART_STATES_WIDTH` of `mesh_vertex.wgsl`.
const WIDTH: usize = 1024;

/// What [`PartTable::set`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Written {
    Nothing,
    InPlace,
    /// Into a new texture, to be bound.
    NewTexture,
}

/// A texture of states, one word a texel: vertex stages need no storage buffer then, which not every device has.
#[derive(Debug, Default)]
pub(crate) struct PartTable {
    states: PartStates,
    words: Option<PartWords>,
    texture: Option<wgpu::Texture>,
}

impl PartTable {
    /// Replaces all states. Cost: in proportion to the largest part listed of each instance, at most [`MAX_PARTS`].
    pub(crate) fn set(&mut self, gpu: &Gpu, states: PartStates) -> Result<Written, RenderError> {
        if states == self.states {
            return Ok(Written::Nothing);
        }
        let last = states.instances.values().filter_map(|instance| instance.parts.last_key_value());
        if let Some((&part, _)) = last.max_by_key(|(part, _)| **part).filter(|(part, _)| **part >= MAX_PARTS)
        {
            return Err(RenderError::NoSuch {
                what: "part",
                index: part as usize,
                count: MAX_PARTS as usize,
            });
        }
        let mut words = PartWords::new(&states);
        words.words.resize(words.words.len().next_multiple_of(WIDTH), 0);
        let rows = (words.words.len() / WIDTH) as u32;
        let allowed = gpu.device.limits().max_texture_dimension_2d;
        if rows > allowed {
            let bytes = |rows: u32| u64::from(rows) * 4 * WIDTH as u64;
            return Err(RenderError::TooLarge {
                what: "table of part states",
                needed: bytes(rows),
                allowed: bytes(allowed),
            });
        }
        self.texture.take_if(|texture| texture.height() < rows);
        let written = if self.texture.is_some() { Written::InPlace } else { Written::NewTexture };
        let texture = self.texture.get_or_insert_with(|| {
            let height = rows.next_power_of_two().min(allowed);
            let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
            let size = (WIDTH as u32, height);
            gpu.device.create_texture(&texture_2d("part states", size, wgpu::TextureFormat::R32Uint, usage))
        });
        gpu.queue.write_texture(
            texture.as_image_copy(),
            bytemuck::cast_slice(&words.words),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * WIDTH as u32),
                rows_per_image: None,
            },
            wgpu::Extent3d { width: WIDTH as u32, height: rows, depth_or_array_layers: 1 },
        );
        words.words = Vec::new();
        (self.states, self.words) = (states, Some(words));
        Ok(written)
    }

    /// The texture, once there are states.
    pub(crate) fn view(&self) -> Option<wgpu::TextureView> {
        self.texture.as_ref().map(|texture| texture.create_view(&Default::default()))
    }

    /// Where the states of an instance begin, 0 without any; `None` if nothing of it is drawn.
    pub(crate) fn start(&self, instance: usize) -> Option<u32> {
        self.words.as_ref().map_or(Some(0), |words| words.start(instance))
    }
}
