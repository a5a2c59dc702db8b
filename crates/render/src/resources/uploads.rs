//! Batches many small buffer writes into few submissions. A chunk of a mesh touches hundreds of runs of slots; with
//! one queue write each, a frame took five times as long.
//!
//! Pieces are gathered in reused memory and copied to the device through staging blocks that return after the copy.
//! Recorded commands may be submitted with a later frame; until then they have no effect.

use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Pod;

use crate::resources::gpu::{Gpu, RenderError};

/// Sizes of the largest staging block, the upload of a busy frame, and of the smallest: the first picture needs
/// little, and fresh memory costs time.
const BLOCK_BYTES: usize = 1 << 20;
const LEAST_BLOCK_BYTES: u64 = 64 << 10;
/// Most idle blocks kept: enough for consecutive frames.
const MAX_FREE_BLOCKS: usize = 4;

/// Buffer writes and copies, in order.
#[derive(Debug, Default)]
pub(crate) struct Uploads {
    /// Data of all writes.
    bytes: Vec<u8>,
    orders: Vec<Order>,
    recorded: Vec<wgpu::CommandBuffer>,
    /// Blocks in use by recorded commands.
    blocks: Vec<wgpu::Buffer>,
    /// Idle, mapped blocks.
    free: Arc<Mutex<Vec<wgpu::Buffer>>>,
}

#[derive(Debug)]
enum Order {
    /// Writes the next `len` bytes to a buffer.
    Write { to: wgpu::Buffer, offset: u64, len: u64 },
    /// Copies a range of a buffer to another.
    Copy { from: (wgpu::Buffer, u64), to: (wgpu::Buffer, u64), len: u64 },
    /// Fills a range of a buffer with zeros.
    Clear { buffer: wgpu::Buffer, offset: u64, len: u64 },
}

impl Uploads {
    /// Writes data, at most a block, at a byte offset of a buffer. Lengths and offsets must be multiples of 4.
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

    /// Copies bytes from an offset of a buffer to an offset of another one, after all earlier writes.
    pub(crate) fn copy(&mut self, from: (&wgpu::Buffer, u64), to: (&wgpu::Buffer, u64), len: u64) {
        let owned = |(buffer, offset): (&wgpu::Buffer, u64)| (buffer.clone(), offset);
        self.orders.push(Order::Copy { from: owned(from), to: owned(to), len });
    }

    /// Fills a range of a buffer with zeros, after all earlier writes.
    pub(crate) fn clear(&mut self, buffer: &wgpu::Buffer, offset: u64, len: u64) {
        self.orders.push(Order::Clear { buffer: buffer.clone(), offset, len });
    }

    /// Records commands for all pieces; [`Uploads::submit`] submits them.
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
                Order::Copy { from: (from, start), to: (to, at), len } => {
                    encoder.copy_buffer_to_buffer(&from, start, &to, at, len);
                }
                Order::Clear { buffer, offset, len } => encoder.clear_buffer(&buffer, offset, Some(len)),
            }
        }
        self.recorded.push(encoder.finish());
        self.blocks.push(block);
        Ok(())
    }

    /// Submits everything.
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

    /// The smallest idle block of at least `bytes`.
    fn free_block(&self, bytes: u64) -> Option<wgpu::Buffer> {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let index = free.iter().position(|block| block.size() >= bytes)?;
        Some(free.remove(index))
    }
}
