//! Many small pieces for buffers, handed to the device at once. A chunk of a mesh touches some hundred runs of slots, and
//! each write to a queue by itself takes memory of the device: that took a frame five times as long.
//!
//! Pieces are gathered in memory that stays, and go to the device through blocks that it gives back once it has copied
//! them. What is recorded may wait for a later frame to be submitted: until then nothing of it is seen.

use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Pod;

use crate::resources::gpu::{Gpu, RenderError};

/// Sizes of the largest block, which is what a frame uploads while others are to be in time, and of the smallest: the
/// first picture needs little, and memory that is new is not had for nothing.
const BLOCK_BYTES: usize = 1 << 20;
const LEAST_BLOCK_BYTES: u64 = 64 << 10;
/// Blocks that are kept: what is under way where frames follow one another.
const MAX_FREE_BLOCKS: usize = 4;

/// Pieces in the order in which they are to be written.
#[derive(Debug, Default)]
pub(crate) struct Uploads {
    /// What is written, piece after piece.
    bytes: Vec<u8>,
    orders: Vec<Order>,
    recorded: Vec<wgpu::CommandBuffer>,
    /// Blocks that recorded commands read.
    blocks: Vec<wgpu::Buffer>,
    /// Blocks that can be written.
    free: Arc<Mutex<Vec<wgpu::Buffer>>>,
}

#[derive(Debug)]
enum Order {
    /// The next so many bytes go to a place in a buffer.
    Write { to: wgpu::Buffer, offset: u64, len: u64 },
    /// The beginning of a buffer goes to the beginning of another.
    Copy { from: wgpu::Buffer, to: wgpu::Buffer, len: u64 },
}

impl Uploads {
    /// Writes data, a block at most, to a buffer from a byte on. Lengths and offsets are multiples of 4, as the device asks
    /// for.
    pub(crate) fn write<T: Pod>(
        &mut self,
        gpu: &Gpu,
        to: &wgpu::Buffer,
        offset: u64,
        data: impl ExactSizeIterator<Item = T>,
    ) -> Result<(), RenderError> {
        let more = data.len() * size_of::<T>();
        if self.bytes.len() + more > BLOCK_BYTES {
            self.record(gpu)?;
        }
        self.bytes.reserve(more);
        for one in data {
            self.bytes.extend_from_slice(bytemuck::bytes_of(&one));
        }
        let more = more as u64;
        if let Some(Order::Write { to: last, offset: start, len }) = self.orders.last_mut()
            && last == to
            && *start + *len == offset
        {
            *len += more;
            return Ok(());
        }
        self.orders.push(Order::Write { to: to.clone(), offset, len: more });
        Ok(())
    }

    /// Copies the beginning of a buffer, as it is after what was written before.
    pub(crate) fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, len: u64) {
        self.orders.push(Order::Copy { from: from.clone(), to: to.clone(), len });
    }

    /// Makes commands of what was written, which [`Uploads::submit`] hands to the device.
    pub(crate) fn record(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        if self.orders.is_empty() {
            return Ok(());
        }
        let len = self.bytes.len() as u64;
        let free = self.free_block(len);
        let block = free.unwrap_or_else(|| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("uploads"),
                size: len.next_power_of_two().max(LEAST_BLOCK_BYTES),
                usage: wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: true,
            })
        });
        if len > 0 {
            let view = block.slice(..len).get_mapped_range_mut();
            view.map_err(|why| RenderError::Device(why.to_string()))?.copy_from_slice(&self.bytes);
        }
        block.unmap();
        self.bytes.clear();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut at = 0;
        for order in self.orders.drain(..) {
            match order {
                Order::Write { to, offset, len } => {
                    encoder.copy_buffer_to_buffer(&block, at, &to, offset, len);
                    at += len;
                }
                Order::Copy { from, to, len } => encoder.copy_buffer_to_buffer(&from, 0, &to, 0, len),
            }
        }
        self.recorded.push(encoder.finish());
        self.blocks.push(block);
        Ok(())
    }

    /// Hands all of it to the device.
    pub(crate) fn submit(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        self.record(gpu)?;
        if self.recorded.is_empty() {
            return Ok(());
        }
        gpu.queue.submit(self.recorded.drain(..));
        for block in self.blocks.drain(..) {
            let (back, free) = (block.clone(), self.free.clone());
            // Called by a later submission, once the device has read it.
            block.map_async(wgpu::MapMode::Write, .., move |mapped| {
                let mut free = free.lock().unwrap_or_else(PoisonError::into_inner);
                if mapped.is_ok() {
                    free.push(back);
                    free.sort_by_key(wgpu::Buffer::size);
                    let too_many = free.len().saturating_sub(MAX_FREE_BLOCKS);
                    free.drain(..too_many);
                }
            });
        }
        Ok(())
    }

    /// The smallest that holds so many bytes.
    fn free_block(&self, bytes: u64) -> Option<wgpu::Buffer> {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let index = free.iter().position(|block| block.size() >= bytes)?;
        Some(free.remove(index))
    }
}
