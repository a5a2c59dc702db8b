//! Whether files have changed, by their lengths and times.

use std::path::PathBuf;
use std::time::SystemTime;

/// Lengths and times of modification of files; `None` for those that cannot be examined.
pub(super) type Stamp = Vec<Option<(u64, Option<SystemTime>)>>;

/// The present stamp of files.
pub(super) fn stamp(files: &[PathBuf]) -> Stamp {
    let of = |file: &PathBuf| {
        let metadata = std::fs::metadata(file).ok()?;
        Some((metadata.len(), metadata.modified().ok()))
    };
    files.iter().map(of).collect()
}
