//! Lists that are larger than memory: while [`Mapped::into`] is asked for, every large allocation of the program is a
//! file that is mapped into its memory, so that the system keeps what is in use and writes the rest to disk.
//!
//! Preparation passes over its lists region by region, neighbours one after the other, a few dozen times a level: with
//! such access paging by the system works, and what comes out cannot differ, since nothing but where a list lies does. Builders of multiresolution meshes have long done so
//! (Ponchio, "Multiresolution structures for interactive visualization of very large 3D datasets", 2008, maps its
//! arrays).
//!
//! A file has no name and is gone with the process, however that ends. Its blocks are reserved before it is used: a full
//! disk is found when a list is made, which then lies in memory, not when it is written, which would be a signal.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;

/// The program's allocator. Small lists, and all where nothing is mapped, are the system's.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mapped;

/// Lists of so many bytes and more are mapped: fewer are many, and each costs three calls of the system.
pub const FROM_BYTES: usize = 4 << 20;

/// A folder that cannot hold mapped lists.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// Its files are in memory.
    #[error("{}: is a file system in memory (tmpfs); name a folder on a disk", .0.display())]
    InMemory(std::path::PathBuf),
    /// The system refuses.
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
    /// There is one folder at a time.
    #[error("another folder is in use for this already")]
    InUse,
}

/// Large lists made while this is there lie in files of its folder.
#[derive(Debug)]
pub struct Mapping(());

impl Mapped {
    /// Maps lists of `from_bytes` and more ([`FROM_BYTES`]) to files in `folder` from now on, those of all threads.
    ///
    /// # Errors
    /// See [`MapError`].
    pub fn into(folder: &Path, from_bytes: usize) -> Result<Mapping, MapError> {
        files::open(folder, from_bytes).map(|()| Mapping(()))
    }

    /// What is free on the disk of the folder, and what lists take there; `None` where nothing is mapped.
    #[must_use]
    pub fn free_bytes() -> Option<u64> {
        files::free_bytes()
    }

    /// The most bytes that were mapped at one time.
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

// What is handed out is what the system's allocator hands out, or a mapping of its own of at least the size that was asked
// for, at the start of a page; which of the two it was is looked up before it goes back.
#[allow(unsafe_code, reason = "an allocator cannot be written without")]
unsafe impl GlobalAlloc for Mapped {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if let Some(mapped) = files::map(layout) {
            return mapped;
        }
        // SAFETY: what the caller owes to this function it owes to that one.
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
            // SAFETY: as above; it came from there.
            unsafe { System.dealloc(at, layout) }
        }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if files::concerned(layout.size().max(size)) {
            // SAFETY: alignment and size are the caller's, who answers for both.
            let new = unsafe { self.alloc(Layout::from_size_align_unchecked(size, layout.align())) };
            if !new.is_null() {
                // SAFETY: two lists that do not overlap, each at least as long as what is copied.
                unsafe { std::ptr::copy_nonoverlapping(at, new, layout.size().min(size)) };
                // SAFETY: the old one is the caller's to give up.
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

    /// Lists that can be mapped at one time; more lie in memory.
    const MOST: usize = 1024;
    const TMPFS_MAGIC: u64 = 0x0102_1994;
    const NO_FOLDER: i32 = -1;
    /// Pages are no larger than this; alignments beyond are the system allocator's.
    const PAGE_BYTES: usize = 4096;

    /// The folder's descriptor, which stays open for good once there was one, since lists may be made of it just now.
    static FOLDER: AtomicI32 = AtomicI32::new(NO_FOLDER);
    static IN_USE: AtomicBool = AtomicBool::new(false);
    static FROM_BYTES: AtomicUsize = AtomicUsize::new(usize::MAX);
    /// Where lists are that are mapped; 0 for none.
    static AT: [AtomicUsize; MOST] = [const { AtomicUsize::new(0) }; MOST];
    /// Taken and not yet in use.
    const TAKEN: usize = 1;
    static BYTES: AtomicUsize = AtomicUsize::new(0);
    static MOST_BYTES: AtomicUsize = AtomicUsize::new(0);
    /// The least size that was ever mapped: what is smaller need not be looked up.
    static LEAST: AtomicUsize = AtomicUsize::new(usize::MAX);

    pub(super) fn open(folder: &Path, from_bytes: usize) -> Result<(), MapError> {
        let failed = |source: std::io::Error| MapError::System { path: folder.to_owned(), source };
        let directory = File::open(folder).map_err(failed)?;
        if u64::try_from(fstatfs(&directory).map_err(|e| failed(e.into()))?.f_type) == Ok(TMPFS_MAGIC) {
            return Err(MapError::InMemory(folder.to_owned()));
        }
        let from_bytes = from_bytes.max(PAGE_BYTES);
        let probe = mapping(directory.as_fd(), from_bytes).map_err(|e| failed(e.into()))?;
        // SAFETY: it was made just now, and nobody else knows of it.
        #[allow(unsafe_code, reason = "see above")]
        let _ = unsafe { munmap(probe.cast(), from_bytes) };
        if IN_USE.swap(true, Ordering::AcqRel) {
            return Err(MapError::InUse);
        }
        LEAST.fetch_min(from_bytes, Ordering::Relaxed);
        FOLDER.store(directory.into_raw_fd(), Ordering::Release);
        FROM_BYTES.store(from_bytes, Ordering::Release);
        // Whether this allocator is the program's is seen by what it does.
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
        // SAFETY: asked for only where there is one, and a descriptor that was stored is never closed.
        #[allow(unsafe_code, reason = "see above")]
        unsafe {
            BorrowedFd::borrow_raw(FOLDER.load(Ordering::Acquire))
        }
    }

    /// Whether a list of so many bytes is, or would be, mapped.
    pub(super) fn concerned(bytes: usize) -> bool {
        bytes >= LEAST.load(Ordering::Relaxed)
    }

    /// A new list, all zeros; `None` where it is to lie in memory.
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

    /// A file without a name, its blocks reserved, as memory. Makes no list of its own.
    fn mapping(folder: BorrowedFd<'_>, bytes: usize) -> rustix::io::Result<*mut u8> {
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        let file = openat(folder, c".", flags, Mode::RUSR | Mode::WUSR)?;
        fallocate(&file, FallocateFlags::empty(), 0, bytes as u64)?;
        // SAFETY: a new mapping, of a file that nobody else can open: it is aliased by nothing, and cannot be truncated.
        #[allow(unsafe_code, reason = "see above")]
        let at = unsafe {
            mmap(null_mut(), bytes, ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED, &file, 0)
        }?;
        Ok(at.cast())
    }

    fn find(at: usize) -> Option<&'static AtomicUsize> {
        AT.iter().find(|slot| slot.load(Ordering::Acquire) == at)
    }

    /// Gives a mapped list back; answers whether it was one.
    pub(super) fn unmap(at: *mut u8, layout: Layout) -> bool {
        if !concerned(layout.size()) {
            return false;
        }
        let Some(slot) = find(at as usize) else { return false };
        BYTES.fetch_sub(layout.size(), Ordering::Relaxed);
        // Free before it is unmapped: until then nothing else can come to lie there.
        slot.store(0, Ordering::Release);
        // SAFETY: it is the whole of a mapping of ours, and its owner has given it up.
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

    pub(super) fn concerned(_: usize) -> bool {
        false
    }

    pub(super) fn map(_: Layout) -> Option<*mut u8> {
        None
    }

    pub(super) fn unmap(_: *mut u8, _: Layout) -> bool {
        false
    }
}
