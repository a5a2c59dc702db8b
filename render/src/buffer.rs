//! A GPU buffer of equal elements that grows geometrically and takes dirty ranges.

use std::marker::PhantomData;

use bytemuck::Pod;

use super::gpu::{Gpu, RenderError};
use super::readback::read_buffer;

/// Elements that the smallest buffer holds; an empty buffer cannot be bound.
const MIN_ELEMENTS: u64 = 64;

/// A growing array of `T` in GPU memory.
#[derive(Debug)]
pub(crate) struct GrowingBuffer<T> {
    label: &'static str,
    usage: wgpu::BufferUsages,
    buffer: Option<wgpu::Buffer>,
    capacity: u64,
    len: u64,
    kind: PhantomData<T>,
}

impl<T: Pod> GrowingBuffer<T> {
    pub(crate) fn new(label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Self { label, usage, buffer: None, capacity: 0, len: 0, kind: PhantomData }
    }

    /// Number of elements, counted to the end of the furthest write.
    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// Bytes allocated on the GPU.
    pub(crate) fn bytes(&self) -> u64 {
        self.capacity * size_of::<T>() as u64
    }

    /// The buffer, once something was written.
    pub(crate) fn buffer(&self) -> Option<&wgpu::Buffer> {
        self.buffer.as_ref()
    }

    /// What it holds, read back. Waits for the device.
    pub(crate) fn read(&self, gpu: &Gpu) -> Result<Vec<T>, RenderError> {
        match &self.buffer {
            Some(buffer) if self.len > 0 => {
                let bytes = read_buffer(gpu, buffer, self.len * size_of::<T>() as u64)?;
                Ok(bytemuck::pod_collect_to_vec(&bytes))
            }
            _ => Ok(Vec::new()),
        }
    }

    /// Forgets elements past `len`; memory is kept.
    pub(crate) fn truncate(&mut self, len: u64) {
        self.len = self.len.min(len);
    }

    /// Writes `data` from element `first`, growing as needed. Elements between the old end and
    /// `first` are zero.
    pub(crate) fn write(&mut self, gpu: &Gpu, first: u64, data: &[T]) -> Result<(), RenderError> {
        if data.is_empty() {
            return Ok(());
        }
        let stride = size_of::<T>() as u64;
        let limit = gpu.device.limits().max_buffer_size / stride;
        let end = first.saturating_add(data.len() as u64);
        if end > limit {
            return Err(RenderError::TooLarge {
                what: self.label,
                needed: end.saturating_mul(stride),
                allowed: limit * stride,
            });
        }
        if end > self.capacity {
            self.grow(gpu, end.max(self.capacity * 2).max(MIN_ELEMENTS).min(limit));
        }
        if let Some(buffer) = &self.buffer {
            gpu.queue.write_buffer(buffer, first * stride, bytemuck::cast_slice(data));
            self.len = self.len.max(end);
        }
        Ok(())
    }

    fn grow(&mut self, gpu: &Gpu, capacity: u64) {
        let stride = size_of::<T>() as u64;
        let new = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(self.label),
            size: capacity * stride,
            usage: self.usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        if let Some(old) = &self.buffer
            && self.len > 0
        {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(old, 0, &new, 0, self.len * stride);
            // Submitting also flushes writes still queued for the old buffer, before the copy.
            gpu.queue.submit([encoder.finish()]);
        }
        self.buffer = Some(new);
        self.capacity = capacity;
    }
}
