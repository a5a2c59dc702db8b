//! Pages: large GPU buffers that many small meshes share, so that their draws need no change of buffers.
//!
//! Ranges are whole blocks of [`BLOCK`] elements, allocated first fit. A block of vertices (52 bytes each) or faces (12)
//! is a multiple of 256 bytes, so that any device can bind a range as a storage buffer. Large ranges have a buffer of
//! their own.
//!
//! Meshes shrink too, and leave gaps. While more than half of what is in use is free, the page with the least in use is
//! *evacuated*: nothing more is allocated in it, and those who hold its ranges move them ([`PageRange::is_evacuated`]).

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::resources::gpu::{Gpu, RenderError};

/// Elements of a block.
pub(crate) const BLOCK: u64 = 64;

/// Blocks of the first and of the largest page; each adds half of what there is. Small scenes take little memory, large
/// ones have few pages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PageSizes {
    pub(crate) first: u32,
    pub(crate) largest: u32,
}

impl PageSizes {
    /// Most blocks of a range within a page: larger ones would leave gaps, and cost a draw call each without harm.
    const fn shared(self) -> u32 {
        self.largest / 8
    }
}

/// A buffer and its free ranges of blocks, ascending and apart.
#[derive(Debug)]
struct Page {
    buffer: wgpu::Buffer,
    blocks: u32,
    free: Vec<Range<u32>>,
}

impl Page {
    fn take(&mut self, blocks: u32) -> Option<u32> {
        take(&mut self.free, blocks)
    }

    fn is_empty(&self) -> bool {
        self.free.first() == Some(&(0..self.blocks))
    }

    #[cfg(feature = "client")]
    fn free_blocks(&self) -> u32 {
        self.free.iter().map(|range| range.end - range.start).sum()
    }
}

/// Takes the first free range of a length; returns its start.
pub(crate) fn take(free: &mut Vec<Range<u32>>, blocks: u32) -> Option<u32> {
    let at = free.iter().position(|range| range.end - range.start >= blocks)?;
    let start = free[at].start;
    free[at].start += blocks;
    if free[at].is_empty() {
        free.remove(at);
    }
    Some(start)
}

/// Gives a range back, joined with its neighbours.
pub(crate) fn give(free: &mut Vec<Range<u32>>, mut range: Range<u32>) {
    let at = free.partition_point(|other| other.end < range.start);
    let joined = free[at..].iter().take_while(|other| other.start <= range.end).count();
    for other in free.drain(at..at + joined) {
        range = range.start.min(other.start)..range.end.max(other.end);
    }
    free.insert(at, range);
}

#[derive(Debug, Default)]
struct PoolState {
    /// By number.
    pages: BTreeMap<u32, Page>,
    /// Number of the next page or own buffer.
    next: u32,
    /// Ranges given back since the last frame began, by page: a frame that is recorded but not submitted may name them.
    given_back: Vec<(u32, Range<u32>)>,
    /// Blocks of ranges with a buffer of their own.
    alone: u64,
    /// The page that is evacuated.
    evacuated: Option<u32>,
    /// More than half of what was in use was free, and no less than an eighth since.
    #[cfg(feature = "client")]
    sparse: bool,
    /// Blocks in use when a page could not be evacuated: none is while there are as many.
    #[cfg(feature = "client")]
    stuck: Option<u32>,
}

impl PoolState {
    /// Takes blocks of a page, neither of `other` nor of the one that is evacuated.
    fn take(&mut self, blocks: u32, other: Option<u32>) -> Option<(u32, wgpu::Buffer, u32)> {
        let evacuated = self.evacuated;
        self.pages
            .iter_mut()
            .filter(|(number, _)| Some(**number) != other && Some(**number) != evacuated)
            .find_map(|(&number, page)| page.take(blocks).map(|start| (number, page.buffer.clone(), start)))
    }

    /// Chooses a page to evacuate: that with the smallest share in use of those whose ranges fit into the others, such that
    /// an eighth of what is in use stays free.
    #[cfg(feature = "client")]
    fn choose_evacuated(&mut self, first: u32) {
        let free: u32 = self.pages.values().map(Page::free_blocks).sum();
        let all: u32 = self.pages.values().map(|page| page.blocks).sum();
        let used = all - free;
        self.sparse = free > used / 2 + first || (self.sparse && free > used / 8);
        if self.stuck.is_some_and(|stuck| stuck != used) {
            self.stuck = None;
        }
        if !self.sparse || self.stuck.is_some() || self.evacuated.is_some() {
            return;
        }
        let fits = |page: &Page| free - page.free_blocks() >= page.blocks - page.free_blocks() + used / 8;
        let candidates = self.pages.iter().filter(|(_, page)| fits(page));
        let share =
            |page: &Page| u64::from(page.blocks - page.free_blocks()) * (1 << 20) / u64::from(page.blocks);
        self.evacuated = candidates.min_by_key(|(_, page)| share(page)).map(|(&number, _)| number);
    }
}

/// A pool of equal elements. Clones share it.
#[derive(Clone, Debug)]
pub(crate) struct PagePool {
    label: &'static str,
    usage: wgpu::BufferUsages,
    /// Bytes of an element.
    stride: u64,
    sizes: PageSizes,
    state: Arc<Mutex<PoolState>>,
}

/// A range of a page; dropping it gives it back.
#[derive(Debug)]
pub(crate) struct PageRange {
    pool: PagePool,
    buffer: wgpu::Buffer,
    page: u32,
    blocks: Range<u32>,
    alone: bool,
}

/// Pages and memory of a pool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PoolUse {
    /// Shared pages.
    pub(crate) pages: usize,
    /// Bytes of shared pages and of buffers with one range.
    pub(crate) bytes: u64,
}

impl PagePool {
    pub(crate) fn new(
        label: &'static str,
        usage: wgpu::BufferUsages,
        stride: usize,
        sizes: PageSizes,
    ) -> Self {
        let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        Self { label, usage, stride: stride as u64, sizes, state: Arc::default() }
    }

    // Each change is complete when the lock is released, so a poisoned one is consistent.
    fn state(&self) -> MutexGuard<'_, PoolState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn label(&self) -> &'static str {
        self.label
    }

    /// A range of at least `elements`, with any content, and not in the page of `other`: a buffer cannot be copied within
    /// itself.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] past the device's buffer limit.
    pub(crate) fn allocate(
        &self,
        gpu: &Gpu,
        elements: u64,
        other: Option<&PageRange>,
    ) -> Result<PageRange, RenderError> {
        let limit = gpu.device.limits().max_buffer_size / (self.stride * BLOCK);
        let limit = limit.min(u64::from(u32::MAX) / BLOCK);
        let blocks = elements.div_ceil(BLOCK).max(1);
        if blocks > limit {
            return Err(RenderError::TooLarge {
                what: self.label,
                needed: elements.saturating_mul(self.stride),
                allowed: limit * BLOCK * self.stride,
            });
        }
        let blocks = blocks as u32;
        let mut state = self.state();
        if blocks > self.sizes.shared() {
            state.next += 1;
            state.alone += u64::from(blocks);
            let (page, buffer) = (state.next, self.buffer(gpu, blocks));
            return Ok(PageRange { pool: self.clone(), buffer, page, blocks: 0..blocks, alone: true });
        }
        let other = other.filter(|other| !other.alone).map(|other| other.page);
        let (page, buffer, start) = state.take(blocks, other).unwrap_or_else(|| {
            let all: u32 = state.pages.values().map(|page| page.blocks).sum();
            let size = (all / 2).clamp(self.sizes.first, self.sizes.largest).max(blocks).min(limit as u32);
            let buffer = self.buffer(gpu, size);
            state.next += 1;
            let number = state.next;
            let free = std::iter::once(blocks..size).filter(|rest| !rest.is_empty()).collect();
            state.pages.insert(number, Page { buffer: buffer.clone(), blocks: size, free });
            (number, buffer, 0)
        });
        Ok(PageRange { pool: self.clone(), buffer, page, blocks: start..start + blocks, alone: false })
    }

    /// A range of at least `elements` in a page that is there and that is not evacuated; `None` if it has no room, or if the
    /// range is large. A range of the page that is evacuated then stays, and the page with it.
    #[cfg(feature = "client")]
    pub(crate) fn allocate_there(&self, elements: u64) -> Option<PageRange> {
        let blocks = u32::try_from(elements.div_ceil(BLOCK).max(1)).unwrap_or(u32::MAX);
        let (page, buffer, start) = self.state().take(blocks, None)?;
        Some(PageRange { pool: self.clone(), buffer, page, blocks: start..start + blocks, alone: false })
    }

    /// Chooses a page to evacuate, if none is and one should be; returns whether one is.
    #[cfg(feature = "client")]
    pub(crate) fn evacuate(&self) -> bool {
        let mut state = self.state();
        state.choose_evacuated(self.sizes.first);
        state.evacuated.is_some()
    }

    /// Ends the evacuation of a page of which nothing can be moved any more: it goes with its last range, or is used
    /// again.
    #[cfg(feature = "client")]
    pub(crate) fn end_evacuation(&self) {
        let mut state = self.state();
        let Some(page) = state.evacuated.and_then(|number| Some((number, state.pages.get(&number)?))) else {
            return;
        };
        let leaving = state.given_back.iter().filter(|(number, _)| *number == page.0);
        let leaving: u32 = leaving.map(|(_, range)| range.end - range.start).sum();
        if leaving + page.1.free_blocks() < page.1.blocks {
            let used = state.pages.values().map(|page| page.blocks - page.free_blocks()).sum();
            state.stuck = Some(used);
            state.evacuated = None;
        }
    }

    fn buffer(&self, gpu: &Gpu, blocks: u32) -> wgpu::Buffer {
        gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(self.label),
            size: u64::from(blocks) * BLOCK * self.stride,
            usage: self.usage,
            mapped_at_creation: false,
        })
    }

    /// Begins a frame; all earlier ones are submitted or dropped, so ranges given back before can be used again. Pages
    /// without ranges are freed.
    pub(crate) fn begin_frame(&self) {
        let mut state = self.state();
        if state.given_back.is_empty() {
            return;
        }
        for (number, range) in std::mem::take(&mut state.given_back) {
            if let Some(page) = state.pages.get_mut(&number) {
                give(&mut page.free, range);
            }
        }
        state.pages.retain(|_, page| !page.is_empty());
        if state.evacuated.is_some_and(|number| !state.pages.contains_key(&number)) {
            state.evacuated = None;
        }
    }

    /// Pages and memory.
    pub(crate) fn used(&self) -> PoolUse {
        let state = self.state();
        let blocks = state.pages.values().map(|page| u64::from(page.blocks)).sum::<u64>() + state.alone;
        PoolUse { pages: state.pages.len(), bytes: blocks * BLOCK * self.stride }
    }
}

impl PageRange {
    pub(crate) fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Number of the page, unique within its pool.
    pub(crate) fn page(&self) -> u32 {
        self.page
    }

    /// First element within the buffer.
    pub(crate) fn first(&self) -> u64 {
        u64::from(self.blocks.start) * BLOCK
    }

    /// Number of elements that fit.
    pub(crate) fn capacity(&self) -> u64 {
        u64::from(self.blocks.end - self.blocks.start) * BLOCK
    }

    /// Byte offset of an element of the range.
    pub(crate) fn offset(&self, element: u64) -> u64 {
        (self.first() + element) * self.pool.stride
    }

    /// Whether its page is evacuated.
    #[cfg(feature = "client")]
    pub(crate) fn is_evacuated(&self) -> bool {
        !self.alone && self.pool.state().evacuated == Some(self.page)
    }

    /// Whether it has a buffer of its own, with room for other elements by more than half of so many.
    #[cfg(feature = "client")]
    pub(crate) fn is_roomy_buffer(&self, elements: u64) -> bool {
        self.alone && self.is_roomy(elements)
    }

    #[cfg(feature = "client")]
    fn is_roomy(&self, elements: u64) -> bool {
        2 * u64::from(self.blocks.end - self.blocks.start) > 3 * elements.div_ceil(BLOCK).max(1)
    }

    /// If a range of a shared page has room for other elements by more than half of so many, gives back what lies past
    /// `kept` elements.
    #[cfg(feature = "client")]
    pub(crate) fn shorten(&mut self, elements: u64, kept: u64) {
        let kept = u32::try_from(kept.div_ceil(BLOCK).max(1)).unwrap_or(u32::MAX);
        let end = self.blocks.start.saturating_add(kept);
        if !self.alone && end < self.blocks.end && self.is_roomy(elements) {
            self.pool.state().given_back.push((self.page, end..self.blocks.end));
            self.blocks.end = end;
        }
    }

    /// The range as a binding.
    #[cfg(any(test, feature = "methods"))]
    pub(crate) fn binding(&self) -> wgpu::BufferBinding<'_> {
        let size = wgpu::BufferSize::new(self.bytes());
        wgpu::BufferBinding { buffer: &self.buffer, offset: self.offset(0), size }
    }

    /// Size in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.capacity() * self.pool.stride
    }
}

impl Drop for PageRange {
    fn drop(&mut self) {
        let mut state = self.pool.state();
        if self.alone {
            // wgpu keeps the buffer as long as recorded commands name it.
            state.alone -= u64::from(self.blocks.end);
        } else {
            state.given_back.push((self.page, self.blocks.clone()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::headless;

    #[test]
    fn free_ranges_are_split_and_joined() {
        let whole = |end| Vec::from_iter(std::iter::once(0..end));
        let mut free = whole(10);
        assert_eq!([4, 3, 3, 1].map(|blocks| take(&mut free, blocks)), [Some(0), Some(4), Some(7), None]);
        give(&mut free, 4..7);
        give(&mut free, 0..2);
        assert_eq!(free, [0..2, 4..7]);
        assert_eq!(take(&mut free, 3), Some(4), "the first that is long enough");
        give(&mut free, 4..7);
        give(&mut free, 2..4);
        assert_eq!(free, whole(7));
        give(&mut free, 7..10);
        assert_eq!(free, whole(10));
    }

    #[test]
    fn ranges_never_overlap_and_freed_pages_return() {
        let Some(h) = headless(1, 1) else { return };
        let sizes = PageSizes { first: 4, largest: 64 };
        let pool = PagePool::new("test", wgpu::BufferUsages::VERTEX, 52, sizes);
        let mut held: Vec<PageRange> = Vec::new();
        let mut state = 1_u32;
        for _ in 0..2000 {
            // Numerical Recipes' generator.
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let elements = 1 + u64::from(state >> 8) % 900;
            if state >> 30 == 0 && !held.is_empty() {
                held.swap_remove(state as usize % held.len());
                pool.begin_frame();
            } else {
                let other = held.last();
                let new = pool.allocate(h.gpu(), elements, other).unwrap();
                assert!(new.capacity() >= elements && new.offset(0).is_multiple_of(256));
                assert!(other.is_none_or(|other| other.page != new.page));
                let clash = |other: &PageRange| {
                    other.page == new.page
                        && other.blocks.start < new.blocks.end
                        && new.blocks.start < other.blocks.end
                };
                assert!(!held.iter().any(clash));
                held.push(new);
            }
        }
        let used = pool.used();
        assert!(used.pages > 4 && used.bytes >= held.iter().map(PageRange::bytes).sum());
        drop(held);
        assert_eq!(pool.used().pages, used.pages, "not before the next frame");
        pool.begin_frame();
        assert_eq!(pool.used(), PoolUse::default());
    }

    #[test]
    fn a_large_range_has_its_own_buffer() {
        let Some(h) = headless(1, 1) else { return };
        let sizes = PageSizes { first: 4, largest: 64 };
        let pool = PagePool::new("test", wgpu::BufferUsages::INDEX, 12, sizes);
        let range = pool.allocate(h.gpu(), 8 * BLOCK + 1, None).unwrap();
        assert_eq!((range.first(), range.capacity()), (0, 9 * BLOCK));
        assert_eq!(pool.used(), PoolUse { pages: 0, bytes: 9 * BLOCK * 12 });
        drop(range);
        assert_eq!(pool.used(), PoolUse::default());
        let refused = pool.allocate(h.gpu(), u64::MAX, None);
        assert!(matches!(refused, Err(RenderError::TooLarge { what: "test", .. })));
    }
}
