//! Whether a model file can be read with the memory that is free: Linux grants more than there is, and then ends programs.

use std::fs;
use std::path::Path;

use lodestream_import::{ImportError, is_gltf, is_streamed};

use crate::mapping_allocator::MappingAllocator;

/// Memory for reading a file and for importing it, as multiples of its length, at least: of OBJ, whose text is held, and of
/// PLY and STL. An OBJ file of a million faces takes 426 bytes a face of some 40 when it is imported, binary PLY 162 of
/// some 19 (`docs/benchmarks/preparation.md`).
const READ: [u64; 2] = [1, 0];
const IMPORT: [u64; 2] = [8, 4];

/// What is done with a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// It is hashed, and searched for the files that it names.
    Read,
    /// It becomes a mesh.
    Import,
}

/// Checks that there is memory for a model file. Of glTF files parts are read as they are needed, and checked against
/// bounds of their own; with lists mapped to disk there is another check.
///
/// # Errors
/// [`ImportError::NoMemory`].
pub(super) fn check(path: &Path, what: Use) -> Result<(), ImportError> {
    if is_gltf(path) || MappingAllocator::free_bytes().is_some() {
        return Ok(());
    }
    let (Some(length), Some(free)) = (fs::metadata(path).ok().map(|file| file.len()), free_bytes()) else {
        return Ok(());
    };
    fits(path, length, what, free)
}

fn fits(path: &Path, length: u64, what: Use, free: u64) -> Result<(), ImportError> {
    let [obj, streamed] = if what == Use::Read { READ } else { IMPORT };
    let needed = length.saturating_mul(if is_streamed(path) { streamed } else { obj });
    if needed <= free {
        return Ok(());
    }
    Err(ImportError::NoMemory { path: path.to_owned(), needed, free })
}

/// Bytes of memory that programs can still have without swapping, of the machine and of the process's group; `None` where
/// the system does not say.
fn free_bytes() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let machine = available(&text)?;
    let group = |name: &str| -> Option<u64> {
        fs::read_to_string(format!("/sys/fs/cgroup/{name}")).ok()?.trim().parse().ok()
    };
    // "max" is no number.
    let limit = group("memory.max").zip(group("memory.current")).map(|(most, now)| most.saturating_sub(now));
    Some(limit.map_or(machine, |limit| limit.min(machine)))
}

/// The line `MemAvailable` of /proc/meminfo, in bytes.
fn available(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_needs_more_memory_than_is_free_is_refused_with_both() {
        let text = "MemTotal:       24000000 kB\nMemFree:  10 kB\nMemAvailable:    1000000 kB\n";
        let free = available(text).unwrap();
        assert_eq!((free, available("MemTotal: 3 kB\n")), (1_024_000_000, None));
        let large =
            |name: &str, what| fits(Path::new(name), 2 << 30, what, free).map_err(|why| why.to_string());
        let why = large("a/big.obj", Use::Read).unwrap_err();
        assert!(why.contains("big.obj") && why.contains("2.1 GB") && why.contains("1.0 GB"), "{why}");
        assert!(large("big.ply", Use::Read).is_ok() && large("big.ply", Use::Import).is_err());
        assert!(fits(Path::new("small.obj"), 100 << 20, Use::Import, free).is_ok());
        assert!(fits(Path::new("medium.obj"), 200 << 20, Use::Import, free).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_system_says_how_much_memory_is_free() {
        assert!(free_bytes().is_some_and(|free| free > 1 << 20));
    }
}
