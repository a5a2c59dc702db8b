//! An allocator for lists larger than memory: while a [`Mapping`] exists, every large allocation of the program is a
//! memory-mapped file, so that the system pages unused parts out to disk.
//!
//! Preparation traverses its lists region by region, a few dozen times a level, with locality that suits paging. The
//! output is the same, since only the location of the lists differs. Other builders of multiresolution meshes map their
//! arrays too (Ponchio, "Multiresolution structures for interactive visualization of very large 3D datasets", 2008).
//!
//! Files are unnamed (`O_TMPFILE`), so they disappear with the process. Their blocks are reserved in advance: a full disk
//! makes an allocation fall back to memory, instead of raising a signal at a later write.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;

/// The program's allocator. The system's allocator serves small lists, and all lists without a [`Mapping`].
#[derive(Clone, Copy, Debug, Default)]
pub struct MappingAllocator;

/// Least size of mapped lists, in bytes. Smaller lists are numerous, and each mapping costs three system calls.
pub const FROM_BYTES: usize = 4 << 20;

/// A folder that cannot hold mapped lists.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The folder is on a file system in memory.
    #[error("{}: is a file system in memory (tmpfs); name a folder on a disk", .0.display())]
    InMemory(std::path::PathBuf),
    /// The system refuses to create or map files there.
    #[error("{}: no file there can be mapped into memory: {source}", path.display())]
    System {
        /// The folder.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Files are not mapped on this system, or the program was built with another allocator.
    #[error("files are not mapped into memory by this program on this system")]
    Unsupported,
    /// Only one folder can be in use.
    #[error("another folder is in use for this already")]
    InUse,
}

/// While this exists, new large lists are files of its folder.
#[derive(Debug)]
pub struct Mapping(());

impl MappingAllocator {
    /// Maps new lists of at least `from_bytes` ([`FROM_BYTES`]), of all threads, to files in `folder`.
    ///
    /// # Errors
    /// See [`MapError`].
    pub fn into(folder: &Path, from_bytes: usize) -> Result<Mapping, MapError> {
        files::open(folder, from_bytes).map(|()| Mapping(()))
    }

    /// Free bytes on the folder's disk plus the bytes of mapped lists; `None` without a [`Mapping`].
    #[must_use]
    pub fn free_bytes() -> Option<u64> {
        files::free_bytes()
    }

    /// Peak of the mapped bytes.
    #[must_use]
    pub fn most_bytes() -> usize {
        files::most_bytes()
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        files::close();
    }
}

// Returns memory of the system's allocator, or a page-aligned mapping of at least the requested size; `dealloc` looks up
// which of the two it is.
#[allow(unsafe_code, reason = "an allocator cannot be written without")]
unsafe impl GlobalAlloc for MappingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if let Some(mapped) = files::map(layout) {
            return mapped;
        }
        // SAFETY: the caller upholds the same contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // New blocks of a file read as zeros.
        if let Some(mapped) = files::map(layout) {
            return mapped;
        }
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        if !files::unmap(at, layout) {
            // SAFETY: as above; the system's allocator returned it.
            unsafe { System.dealloc(at, layout) }
        }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if files::may_be_mapped(layout.size().max(size)) {
            // SAFETY: the caller guarantees a valid alignment and size.
            let new = unsafe { self.alloc(Layout::from_size_align_unchecked(size, layout.align())) };
            if !new.is_null() {
                // SAFETY: the lists do not overlap, and each has at least the copied length.
                unsafe { std::ptr::copy_nonoverlapping(at, new, layout.size().min(size)) };
                // SAFETY: the caller gives up the old list.
                unsafe { self.dealloc(at, layout) };
            }
            return new;
        }
        // SAFETY: as above.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[cfg(target_os = "linux")]
mod files {
    use std::alloc::Layout;
    use std::fs::File;
    use std::os::fd::{AsFd, BorrowedFd, IntoRawFd as _};
    use std::path::Path;
    use std::ptr::null_mut;
    use std::sync::atomic::{AtomicBool, AtomicI32, AtomicUsize, Ordering};

    use rustix::fs::{FallocateFlags, Mode, OFlags, fallocate, fstatfs, fstatvfs, openat};
    use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

    use super::MapError;

    /// Most lists mapped at one time; further ones are in memory.
    const MOST: usize = 1024;
    const TMPFS_MAGIC: u64 = 0x0102_1994;
    const NO_FOLDER: i32 = -1;
    /// Pages are no larger than this; alignments beyond are the system allocator's.
    const PAGE_BYTES: usize = 4096;

    /// The folder's descriptor, never closed, since another thread may be using it.
    static FOLDER: AtomicI32 = AtomicI32::new(NO_FOLDER);
    static IN_USE: AtomicBool = AtomicBool::new(false);
    static FROM_BYTES: AtomicUsize = AtomicUsize::new(usize::MAX);
    /// Addresses of mapped lists; 0 for a free slot.
    static AT: [AtomicUsize; MOST] = [const { AtomicUsize::new(0) }; MOST];
    /// A slot that is taken but has no address yet.
    const TAKEN: usize = 1;
    static BYTES: AtomicUsize = AtomicUsize::new(0);
    static MOST_BYTES: AtomicUsize = AtomicUsize::new(0);
    /// Least size that was ever mapped: smaller lists need no look-up.
    static LEAST: AtomicUsize = AtomicUsize::new(usize::MAX);

    pub(super) fn open(folder: &Path, from_bytes: usize) -> Result<(), MapError> {
        let failed = |source: std::io::Error| MapError::System { path: folder.to_owned(), source };
        let directory = File::open(folder).map_err(failed)?;
        if u64::try_from(fstatfs(&directory).map_err(|e| failed(e.into()))?.f_type) == Ok(TMPFS_MAGIC) {
            return Err(MapError::InMemory(folder.to_owned()));
        }
        let from_bytes = from_bytes.max(PAGE_BYTES);
        let probe = mapping(directory.as_fd(), from_bytes).map_err(|e| failed(e.into()))?;
        // SAFETY: the mapping is new and not shared.
        #[allow(unsafe_code, reason = "see above")]
        let _ = unsafe { munmap(probe.cast(), from_bytes) };
        if IN_USE.swap(true, Ordering::AcqRel) {
            return Err(MapError::InUse);
        }
        LEAST.fetch_min(from_bytes, Ordering::Relaxed);
        FOLDER.store(directory.into_raw_fd(), Ordering::Release);
        FROM_BYTES.store(from_bytes, Ordering::Release);
        // Only a trial allocation shows whether this is the program's allocator.
        let list = std::hint::black_box(Vec::<u8>::with_capacity(from_bytes));
        if find(list.as_ptr() as usize).is_none() {
            close();
            return Err(MapError::Unsupported);
        }
        Ok(())
    }

    pub(super) fn close() {
        FROM_BYTES.store(usize::MAX, Ordering::Release);
        IN_USE.store(false, Ordering::Release);
    }

    pub(super) fn most_bytes() -> usize {
        MOST_BYTES.load(Ordering::Relaxed)
    }

    pub(super) fn free_bytes() -> Option<u64> {
        if !IN_USE.load(Ordering::Acquire) {
            return None;
        }
        let disk = fstatvfs(folder()).ok()?;
        Some(disk.f_bavail.saturating_mul(disk.f_frsize) + BYTES.load(Ordering::Relaxed) as u64)
    }

    fn folder() -> BorrowedFd<'static> {
        // SAFETY: called only after a descriptor was stored, and stored descriptors are never closed.
        #[allow(unsafe_code, reason = "see above")]
        unsafe {
            BorrowedFd::borrow_raw(FOLDER.load(Ordering::Acquire))
        }
    }

    /// Whether a list of this size may be mapped.
    pub(super) fn may_be_mapped(bytes: usize) -> bool {
        bytes >= LEAST.load(Ordering::Relaxed)
    }

    /// Maps a new, zeroed list; `None` if it belongs in memory.
    pub(super) fn map(layout: Layout) -> Option<*mut u8> {
        let bytes = layout.size();
        if bytes < FROM_BYTES.load(Ordering::Acquire) || layout.align() > PAGE_BYTES {
            return None;
        }
        let taken = AT
            .iter()
            .find(|at| at.compare_exchange(0, TAKEN, Ordering::Acquire, Ordering::Relaxed).is_ok())?;
        match mapping(folder(), bytes) {
            Ok(at) => {
                taken.store(at as usize, Ordering::Release);
                let now = BYTES.fetch_add(bytes, Ordering::Relaxed) + bytes;
                MOST_BYTES.fetch_max(now, Ordering::Relaxed);
                Some(at)
            }
            Err(_) => {
                taken.store(0, Ordering::Release);
                None
            }
        }
    }

    /// Maps an unnamed file with reserved blocks. Does not allocate.
    fn mapping(folder: BorrowedFd<'_>, bytes: usize) -> rustix::io::Result<*mut u8> {
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        let file = openat(folder, c".", flags, Mode::RUSR | Mode::WUSR)?;
        fallocate(&file, FallocateFlags::empty(), 0, bytes as u64)?;
        // SAFETY: a new mapping of a file that nobody else can open: it has no alias and cannot be truncated.
        #[allow(unsafe_code, reason = "see above")]
        let at = unsafe {
            mmap(null_mut(), bytes, ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED, &file, 0)
        }?;
        Ok(at.cast())
    }

    fn find(at: usize) -> Option<&'static AtomicUsize> {
        AT.iter().find(|slot| slot.load(Ordering::Acquire) == at)
    }

    /// Unmaps a list; returns whether it was mapped.
    pub(super) fn unmap(at: *mut u8, layout: Layout) -> bool {
        if !may_be_mapped(layout.size()) {
            return false;
        }
        let Some(slot) = find(at as usize) else { return false };
        BYTES.fetch_sub(layout.size(), Ordering::Relaxed);
        // The slot is freed first: the address cannot be reused before the list is unmapped.
        slot.store(0, Ordering::Release);
        // SAFETY: it is a whole mapping made here, and its owner gives it up.
        #[allow(unsafe_code, reason = "see above")]
        let _ = unsafe { munmap(at.cast(), layout.size()) };
        true
    }
}

#[cfg(not(target_os = "linux"))]
mod files {
    use std::alloc::Layout;
    use std::path::Path;

    use super::MapError;

    pub(super) fn open(_: &Path, _: usize) -> Result<(), MapError> {
        Err(MapError::Unsupported)
    }

    pub(super) fn close() {}

    pub(super) fn most_bytes() -> usize {
        0
    }

    pub(super) fn free_bytes() -> Option<u64> {
        None
    }

    pub(super) fn may_be_mapped(_: usize) -> bool {
        false
    }

    pub(super) fn map(_: Layout) -> Option<*mut u8> {
        None
    }

    pub(super) fn unmap(_: *mut u8, _: Layout) -> bool {
        false
    }
}
