//! Arguments of a frame's draws: in a buffer where the device draws indirectly.

use std::ops::Range;

pub(crate) use wgpu::util::DrawIndexedIndirectArgs as DrawArguments;

use crate::resources::gpu::{Gpu, RenderError};

/// Arguments of a frame's draws, and the buffer that holds them if the device draws indirectly.
#[derive(Debug, Default)]
pub(crate) struct DrawCalls {
    pub(crate) arguments: Vec<DrawArguments>,
    buffer: Option<wgpu::Buffer>,
    uploaded: bool,
}

impl DrawCalls {
    /// Discards all draws.
    pub(crate) fn clear(&mut self) {
        self.arguments.clear();
        self.uploaded = false;
    }

    /// Uploads the arguments, where the device draws indirectly.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] for more draws than the device can hold.
    pub(crate) fn upload(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        // One draw needs no buffer.
        if !gpu.draws_indirectly() || self.arguments.len() < 2 {
            return Ok(());
        }
        let bytes: &[u8] = bytemuck::cast_slice(&self.arguments);
        let (needed, allowed) = (bytes.len() as u64, gpu.device.limits().max_buffer_size);
        if needed > allowed {
            return Err(RenderError::TooLarge { what: "list of draws", needed, allowed });
        }
        self.buffer.take_if(|buffer| buffer.size() < needed);
        let buffer = self.buffer.get_or_insert_with(|| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("draws"),
                size: needed.next_power_of_two().min(allowed),
                usage: wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        gpu.queue.write_buffer(buffer, 0, bytes);
        self.uploaded = true;
        Ok(())
    }

    /// Records draws; returns the number of calls.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, range: &Range<u32>) -> u32 {
        let (first, end) = (range.start as usize, range.end as usize);
        if let (Some(buffer), true) = (self.buffer.as_ref().filter(|_| self.uploaded), end > first + 1) {
            let offset = (first * size_of::<DrawArguments>()) as u64;
            pass.multi_draw_indexed_indirect(buffer, offset, range.end - range.start);
            return 1;
        }
        for &DrawArguments { index_count, instance_count, first_index, base_vertex, first_instance } in
            &self.arguments[first..end]
        {
            let instances = first_instance..first_instance + instance_count;
            pass.draw_indexed(first_index..first_index + index_count, base_vertex, instances);
        }
        range.end - range.start
    }
}
