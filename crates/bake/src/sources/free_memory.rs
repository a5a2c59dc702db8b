//! Whether a model file can be read with the memory that is free: Linux grants more than there is, and then ends programs.

use std::fs;
use std::path::{Component, Path};

use lodestream_import::{ImportError, is_gltf, is_streamed};

use crate::mapping_allocator::MappingAllocator;

/// Memory for reading a file and for importing it, as multiples of its length, at least: of OBJ, whose text is held, and of
/// PLY and STL. An OBJ file of a million faces takes 426 bytes a face of some 40 when it is imported, binary PLY 162 of
/// some 19 (`docs/benchmarks/preparation.md`).
const READ: [u64; 2] = [1, 0];
const IMPORT: [u64; 2] = [8, 4];

/// Bytes of memory a face for preparing a mesh, beside the mesh, at least: in blocks, with checkpoints in files.
const PREPARE_BYTES_A_FACE: u64 = 100;

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
    let (Some(length), Some(free)) =
        (fs::metadata(path).ok().map(|file| file.len()), free_bytes(Path::new("/")))
    else {
        return Ok(());
    };
    fits(path, length, what, free)
}

/// Checks that there is memory for preparing a mesh.
///
/// # Errors
/// [`ImportError::NoMemory`].
pub(crate) fn check_faces(path: &Path, faces: usize) -> Result<(), ImportError> {
    match free_bytes(Path::new("/")) {
        Some(free) if MappingAllocator::free_bytes().is_none() => {
            within(path, faces as u64 * PREPARE_BYTES_A_FACE, free)
        }
        _ => Ok(()),
    }
}

fn fits(path: &Path, length: u64, what: Use, free: u64) -> Result<(), ImportError> {
    let [obj, streamed] = if what == Use::Read { READ } else { IMPORT };
    within(path, length.saturating_mul(if is_streamed(path) { streamed } else { obj }), free)
}

fn within(path: &Path, needed: u64, free: u64) -> Result<(), ImportError> {
    if needed <= free {
        return Ok(());
    }
    Err(ImportError::NoMemory { path: path.to_owned(), needed, free })
}

/// Bytes of memory that this program can still have without swapping: of the machine, of its control groups and of its
/// address space (`ulimit -v`); `None` where the system does not say. `root` is the folder /.
fn free_bytes(root: &Path) -> Option<u64> {
    let read = |path: &str| fs::read_to_string(root.join(path)).ok();
    let machine = kilobytes(&read("proc/meminfo")?, "MemAvailable:")?;
    let limits = read("proc/self/limits").unwrap_or_default();
    let most =
        limits.lines().find_map(|line| line.strip_prefix("Max address space")?.split_whitespace().next());
    // "unlimited" is no number.
    let most: Option<u64> = most.and_then(|most| most.parse().ok());
    let used = read("proc/self/status").and_then(|status| kilobytes(&status, "VmSize:"));
    let space = most.zip(used).map(|(most, used)| most.saturating_sub(used));
    let groups = read("proc/self/cgroup").unwrap_or_default();
    Some(groups.lines().flat_map(|group| left_to_group(root, group)).chain(space).fold(machine, u64::min))
}

/// A line of /proc/meminfo or /proc/self/status, in bytes.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Bytes that a group of /proc/self/cgroup and those that contain it may still have, where they are limited.
fn left_to_group(root: &Path, group: &str) -> Vec<u64> {
    let mut parts = group.splitn(3, ':').skip(1);
    let (controllers, path) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
    // Version 2 has one hierarchy, of which the line names no controllers (cgroups(7)).
    let (folder, limit, usage, cache) = match controllers {
        "" => ("", "memory.max", "memory.current", "inactive_file"),
        some if some.split(',').any(|controller| controller == "memory") => {
            ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
        }
        _ => return Vec::new(),
    };
    let folder = root.join("sys/fs/cgroup").join(folder);
    let left = |group: &Path| -> Option<u64> {
        let read = |name: &str| fs::read_to_string(folder.join(group).join(name)).ok();
        let number = |name: &str| read(name)?.trim().parse::<u64>().ok();
        // "max" is no number.
        let (limit, usage) = (number(limit)?, number(usage)?);
        // Pages of files that are dropped when memory is short count as usage.
        let stat = read("memory.stat").unwrap_or_default();
        let cached = stat.lines().find_map(|line| line.strip_prefix(cache)?.trim().parse::<u64>().ok());
        Some(limit.saturating_sub(usage.saturating_sub(cached.unwrap_or(0))))
    };
    let path = Path::new(path.trim_start_matches('/'));
    // A group outside of the namespace begins with "..".
    if path.components().any(|part| !matches!(part, Component::Normal(_))) {
        return left(Path::new("")).into_iter().collect();
    }
    path.ancestors().filter_map(left).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_needs_more_memory_than_is_free_is_refused_with_both() {
        let text = "MemTotal:       24000000 kB\nMemFree:  10 kB\nMemAvailable:    1000000 kB\n";
        let available = |text: &str| kilobytes(text, "MemAvailable:");
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

    #[test]
    fn the_narrowest_limit_of_machine_groups_and_address_space_is_what_is_free() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let write = |path: &str, text: &str| {
            let path = root.join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let group = |folder: &str, names: [&str; 2], [limit, usage]: [&str; 2]| {
            write(&format!("sys/fs/cgroup/{folder}/{}", names[0]), limit);
            write(&format!("sys/fs/cgroup/{folder}/{}", names[1]), usage);
        };
        let (second, first) =
            (["memory.max", "memory.current"], ["memory.limit_in_bytes", "memory.usage_in_bytes"]);
        assert_eq!(free_bytes(root), None);
        write("proc/meminfo", "MemTotal: 9000000 kB\nMemAvailable:   8000000 kB\n");
        assert_eq!(free_bytes(root), Some(8_192_000_000));
        let limits = |most: &str| {
            format!("Max cpu time  unlimited  unlimited  seconds\nMax address space  {most}  {most}  bytes\n")
        };
        write("proc/self/limits", &limits("unlimited"));
        write("proc/self/status", "VmPeak:  900 kB\nVmSize:\t    1000 kB\n");
        // Of version 2: the group's own limit, then that of one around it.
        write("proc/self/cgroup", "0::/user/viewer\n");
        group("user/viewer", second, ["max\n", "5\n"]);
        assert_eq!(free_bytes(root), Some(8_192_000_000));
        group("user", second, ["7000000000\n", "3000000000\n"]);
        assert_eq!(free_bytes(root), Some(4_000_000_000));
        write("sys/fs/cgroup/user/memory.stat", "anon 5\ninactive_file 1000000000\n");
        assert_eq!(free_bytes(root), Some(5_000_000_000));
        group("user/viewer", second, ["3000\n", "5000\n"]);
        assert_eq!(free_bytes(root), Some(0));
        // In a container, whose group is the root of what it sees.
        group("", second, ["6000000000\n", "0\n"]);
        for path in ["0::/\n", "0::/../viewer\n"] {
            write("proc/self/cgroup", path);
            assert_eq!(free_bytes(root), Some(6_000_000_000), "{path}");
        }
        // Of version 1, beside other controllers.
        write("proc/self/cgroup", "5:cpu,cpuacct:/a\n4:memory:/a\n");
        group("memory/a", first, ["2000000000\n", "500000000\n"]);
        write("sys/fs/cgroup/memory/a/memory.stat", "inactive_file 7\ntotal_inactive_file 100000000\n");
        assert_eq!(free_bytes(root), Some(1_600_000_000));
        write("proc/self/limits", &limits("1001024000"));
        assert_eq!(free_bytes(root), Some(1_000_000_000));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn the_system_says_how_much_memory_is_free() {
        assert!(free_bytes(Path::new("/")).is_some_and(|free| free > 1 << 20));
    }
}
