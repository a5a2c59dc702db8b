//! A growing array in a range of shared pages, which takes dirty ranges.

use std::marker::PhantomData;
use std::sync::Arc;

use bytemuck::Pod;

use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::pages::{PagePool, PageRange};
#[cfg(any(test, feature = "reference"))]
use crate::resources::readback::read_buffer;
#[cfg(feature = "client")]
use crate::resources::uploads::Uploads;

/// A growing array of `T` in GPU memory.
#[derive(Debug)]
pub(crate) struct PagedBuffer<T> {
    pool: PagePool,
    /// Current contents.
    shown: Contents,
    /// Contents from the next [`PagedBuffer::commit`] on, if anything is staged.
    staged: Option<Contents>,
    /// Ranges that staged contents have outgrown; recorded uploads still name them.
    #[cfg(feature = "client")]
    outgrown: Vec<Arc<PageRange>>,
    kind: PhantomData<T>,
}

#[derive(Clone, Debug, Default)]
struct Contents {
    range: Option<Arc<PageRange>>,
    len: u64,
}

impl Contents {
    fn capacity(&self) -> u64 {
        self.range.as_ref().map_or(0, |range| range.capacity())
    }
}

impl<T: Pod> PagedBuffer<T> {
    pub(crate) fn new(pool: &PagePool) -> Self {
        Self {
            pool: pool.clone(),
            shown: Contents::default(),
            staged: None,
            #[cfg(feature = "client")]
            outgrown: Vec::new(),
            kind: PhantomData,
        }
    }

    /// Number of elements, counted to the end of the furthest write.
    pub(crate) fn len(&self) -> u64 {
        self.shown.len
    }

    /// Bytes allocated on the GPU.
    pub(crate) fn bytes(&self) -> u64 {
        self.shown.range.as_ref().map_or(0, |range| range.bytes())
    }

    /// The range, once something was written.
    pub(crate) fn range(&self) -> Option<&PageRange> {
        self.shown.range.as_deref()
    }

    #[cfg(any(test, feature = "reference"))]
    /// Reads the elements back. Waits for the device.
    pub(crate) fn read(&self, gpu: &Gpu) -> Result<Vec<T>, RenderError> {
        match &self.shown.range {
            Some(range) if self.shown.len > 0 => {
                let (first, bytes) = (range.offset(0), self.shown.len * size_of::<T>() as u64);
                let all = read_buffer(gpu, range.buffer(), first + bytes)?;
                Ok(bytemuck::pod_collect_to_vec(&all[first as usize..]))
            }
            _ => Ok(Vec::new()),
        }
    }

    /// Forgets elements past `len`; memory is kept.
    pub(crate) fn truncate(&mut self, len: u64) {
        self.shown.len = self.shown.len.min(len);
    }

    /// Writes `data` from element `first`, growing as needed. Elements between the old end and
    /// `first` are zero. Nothing may be staged.
    pub(crate) fn write(&mut self, gpu: &Gpu, first: u64, data: &[T]) -> Result<(), RenderError> {
        debug_assert!(self.staged.is_none(), "{}: written while something is staged", self.pool.label());
        if data.is_empty() {
            return Ok(());
        }
        let stride = size_of::<T>() as u64;
        let end = first.saturating_add(data.len() as u64);
        let (len, old) = (self.shown.len, self.shown.range.clone());
        let grown = self.grown(gpu, &self.shown, end)?;
        let Some(range) = grown.as_ref().or(old.as_ref()) else { return Ok(()) };
        let gap = first.saturating_sub(len);
        if gap > 0 || grown.is_some() {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            if let (Some(new), Some(old)) = (&grown, &old)
                && len > 0
            {
                let (from, to) = (old.offset(0), new.offset(0));
                encoder.copy_buffer_to_buffer(old.buffer(), from, new.buffer(), to, len * stride);
            }
            if gap > 0 {
                encoder.clear_buffer(range.buffer(), range.offset(len), Some(gap * stride));
            }
            // Submitting also flushes writes still queued for the old range, before the copy.
            gpu.queue.submit([encoder.finish()]);
        }
        gpu.queue.write_buffer(range.buffer(), range.offset(first), bytemuck::cast_slice(data));
        self.shown = Contents { range: Some(Arc::clone(range)), len: len.max(end) };
        Ok(())
    }

    /// Stages `data` among other uploads. The current contents stay in use until the uploads are submitted and
    /// [`PagedBuffer::commit`] is called.
    #[cfg(feature = "client")]
    pub(crate) fn stage(
        &mut self,
        gpu: &Gpu,
        uploads: &mut Uploads,
        first: u64,
        data: impl ExactSizeIterator<Item = T>,
    ) -> Result<(), RenderError> {
        if data.len() == 0 {
            return Ok(());
        }
        let stride = size_of::<T>() as u64;
        let end = first.saturating_add(data.len() as u64);
        let mut staged = self.staged.take().unwrap_or_else(|| self.shown.clone());
        if let Some(new) = self.grown(gpu, &staged, end)?
            && let Some(old) = staged.range.replace(Arc::clone(&new))
        {
            if staged.len > 0 {
                let from = (old.buffer(), old.offset(0));
                uploads.copy(from, (new.buffer(), new.offset(0)), staged.len * stride);
            }
            self.outgrown.push(old);
        }
        if let Some(range) = &staged.range {
            if first > staged.len {
                uploads.clear(range.buffer(), range.offset(staged.len), (first - staged.len) * stride);
            }
            uploads.write(gpu, range.buffer(), range.offset(first), data)?;
        }
        staged.len = staged.len.max(end);
        self.staged = Some(staged);
        Ok(())
    }

    /// Forgets elements past `len` with the next [`PagedBuffer::commit`].
    #[cfg(feature = "client")]
    pub(crate) fn stage_len(&mut self, len: u64) {
        if self.staged.as_ref().unwrap_or(&self.shown).len > len {
            self.staged.get_or_insert_with(|| self.shown.clone()).len = len;
        }
    }

    /// Makes the staged contents current. A range that is half as long again as they are, or longer, gives its end back.
    #[cfg(feature = "client")]
    pub(crate) fn commit(&mut self) {
        if let Some(staged) = self.staged.take() {
            self.shown = staged;
        }
        self.outgrown.clear();
        let len = self.shown.len;
        if len == 0 {
            self.shown.range = None;
        } else if let Some(range) = self.shown.range.as_mut().and_then(Arc::get_mut) {
            range.shorten(len, with_reserve(len));
        }
    }

    /// Whether it has a buffer of its own that has become too large.
    #[cfg(feature = "client")]
    pub(crate) fn is_roomy(&self) -> bool {
        self.shown.range.as_ref().is_some_and(|range| range.is_roomy_buffer(self.shown.len))
    }

    /// Stages a copy to another range, if the present one is in a page that is evacuated, or has a buffer of its own that is
    /// half as long again as the contents, or longer. Returns the number of bytes, 0 if there is nothing to do or no room.
    #[cfg(feature = "client")]
    pub(crate) fn stage_repacked(&mut self, gpu: &Gpu, uploads: &mut Uploads) -> Result<u64, RenderError> {
        let len = self.shown.len;
        let (Some(old), None, 1..) = (&self.shown.range, &self.staged, len) else { return Ok(0) };
        let new = if old.is_evacuated() {
            self.pool.allocate_there(old.capacity().min(with_reserve(len)))
        } else if old.is_roomy_buffer(len) {
            Some(self.pool.allocate(gpu, with_reserve(len), Some(old))?)
        } else {
            None
        };
        let Some(new) = new else { return Ok(0) };
        let bytes = len * size_of::<T>() as u64;
        uploads.copy((old.buffer(), old.offset(0)), (new.buffer(), new.offset(0)), bytes);
        self.outgrown.push(Arc::clone(old));
        self.staged = Some(Contents { range: Some(Arc::new(new)), len });
        Ok(bytes)
    }

    /// A larger range, at least half as large again, if `end` lies beyond what there is.
    fn grown(&self, gpu: &Gpu, now: &Contents, end: u64) -> Result<Option<Arc<PageRange>>, RenderError> {
        let capacity = now.capacity();
        if end <= capacity {
            return Ok(None);
        }
        let old = now.range.as_deref();
        // Near the device's limit, without reserve.
        let roomy = self.pool.allocate(gpu, end.max(capacity + capacity / 2), old);
        Ok(Some(Arc::new(roomy.or_else(|_| self.pool.allocate(gpu, end, old))?)))
    }
}

/// Elements to allocate for so many where others may follow.
#[cfg(feature = "client")]
const fn with_reserve(len: u64) -> u64 {
    len + len / 4
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resources::pages::PageSizes;
    use crate::tests::headless;

    /// Writes of every kind leave what the same writes to a list do, in ranges that others have used before.
    #[test]
    fn writes_beyond_the_end_leave_zeros_whatever_a_range_held_before() {
        let Some(h) = headless(1, 1) else { return };
        let sizes = PageSizes { first: 4, largest: 64 };
        let pool = PagePool::new("test", wgpu::BufferUsages::INDEX, 12, sizes);
        for round in 0..3 {
            let mut buffers = [(); 3].map(|()| (PagedBuffer::new(&pool), Vec::<[u32; 3]>::new()));
            for (step, first) in [0_usize, 3, 80, 200, 10, 700].into_iter().enumerate() {
                for (number, (buffer, want)) in buffers.iter_mut().enumerate() {
                    let data: Vec<_> = (0..50).map(|i| [7 + round, number as u32, i]).collect();
                    if step == 4 {
                        buffer.truncate(5);
                        want.truncate(5);
                    }
                    buffer.write(h.gpu(), first as u64, &data).unwrap();
                    want.resize(want.len().max(first + data.len()), [0; 3]);
                    want[first..first + data.len()].copy_from_slice(&data);
                }
            }
            for (buffer, want) in &buffers {
                assert!(buffer.read(h.gpu()).unwrap() == *want, "round {round}");
                assert_eq!(buffer.len(), want.len() as u64);
            }
            pool.begin_frame();
        }
        pool.begin_frame();
        assert_eq!(pool.used().pages, 0);
    }
}
