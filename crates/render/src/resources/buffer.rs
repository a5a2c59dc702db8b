//! A GPU buffer of equal elements that grows geometrically and takes dirty ranges.

use std::marker::PhantomData;

use bytemuck::Pod;

use crate::resources::gpu::{Gpu, RenderError};

/// Elements that the smallest buffer holds; an empty buffer cannot be bound.
const MIN_ELEMENTS: u64 = 64;

/// A growing array of `T` in GPU memory.
#[derive(Debug)]
pub(crate) struct GrowingBuffer<T> {
    label: &'static str,
    usage: wgpu::BufferUsages,
    shown: Contents,
    kind: PhantomData<T>,
}

#[derive(Clone, Debug, Default)]
struct Contents {
    buffer: Option<wgpu::Buffer>,
    capacity: u64,
    len: u64,
}

impl<T: Pod> GrowingBuffer<T> {
    pub(crate) fn new(label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Self { label, usage, shown: Contents::default(), kind: PhantomData }
    }

    /// Number of elements, counted to the end of the furthest write.
    pub(crate) fn len(&self) -> u64 {
        self.shown.len
    }

    /// The buffer, once something was written.
    pub(crate) fn buffer(&self) -> Option<&wgpu::Buffer> {
        self.shown.buffer.as_ref()
    }

    /// Writes `data` from element `first`, growing as needed. Elements between the old end and
    /// `first` are zero.
    pub(crate) fn write(&mut self, gpu: &Gpu, first: u64, data: &[T]) -> Result<(), RenderError> {
        if data.is_empty() {
            return Ok(());
        }
        let stride = size_of::<T>() as u64;
        let end = first.saturating_add(data.len() as u64);
        if let Some((old, new)) = self.make_room(gpu, self.shown.clone(), end)? {
            if let (Some(old), Some(new)) = (&old, &new.buffer) {
                let mut encoder = gpu.device.create_command_encoder(&Default::default());
                encoder.copy_buffer_to_buffer(old, 0, new, 0, self.shown.len * stride);
                // Submitting also flushes writes still queued for the old buffer, before the copy.
                gpu.queue.submit([encoder.finish()]);
            }
            self.shown = new;
        }
        if let Some(buffer) = &self.shown.buffer {
            gpu.queue.write_buffer(buffer, first * stride, bytemuck::cast_slice(data));
            self.shown.len = self.shown.len.max(end);
        }
        Ok(())
    }

    /// Contents with room up to element `end`, if `now` has not; with the buffer to copy from, if there is one.
    fn make_room(
        &self,
        gpu: &Gpu,
        now: Contents,
        end: u64,
    ) -> Result<Option<(Option<wgpu::Buffer>, Contents)>, RenderError> {
        if end <= now.capacity {
            return Ok(None);
        }
        let stride = size_of::<T>() as u64;
        let limit = gpu.device.limits().max_buffer_size / stride;
        if end > limit {
            return Err(RenderError::TooLarge {
                what: self.label,
                needed: end.saturating_mul(stride),
                allowed: limit * stride,
            });
        }
        let capacity = end.max(now.capacity * 2).max(MIN_ELEMENTS).min(limit);
        let new = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(self.label),
            size: capacity * stride,
            usage: self.usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let old = now.buffer.filter(|_| now.len > 0);
        Ok(Some((old, Contents { buffer: Some(new), capacity, len: now.len })))
    }
}

/// A buffer of at least `bytes`, filled by the device only; growing discards its contents.
#[cfg(any(test, feature = "methods"))]
pub(crate) fn room<'a>(
    gpu: &Gpu,
    slot: &'a mut Option<wgpu::Buffer>,
    what: &'static str,
    bytes: u64,
    usage: wgpu::BufferUsages,
) -> Result<&'a wgpu::Buffer, RenderError> {
    let limits = gpu.device.limits();
    let allowed = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
    if bytes > allowed {
        return Err(RenderError::TooLarge { what, needed: bytes, allowed });
    }
    slot.take_if(|buffer| buffer.size() < bytes);
    Ok(slot.get_or_insert_with(|| {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(what),
            size: bytes.next_power_of_two().min(allowed),
            usage,
            mapped_at_creation: false,
        })
    }))
}
