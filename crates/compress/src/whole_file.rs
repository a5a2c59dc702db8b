//! Atomic file writes: a file is complete or absent.

use std::collections::BTreeSet;
use std::fs::Metadata;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

/// Prefix of temporary files and folders.
pub const PREFIX: &str = ".lodestream-";
/// Suffix of temporary files and folders.
pub const SUFFIX: &str = ".part";
/// Age after which a temporary file is stale. Contents are complete in memory before writing starts, so writing is
/// quick.
const STALE_AFTER: Duration = Duration::from_secs(60 * 60);

/// Temporary files that this process is writing; `None` once they are abandoned.
static UNFINISHED: Mutex<Option<BTreeSet<PathBuf>>> = Mutex::new(Some(BTreeSet::new()));

fn unfinished() -> MutexGuard<'static, Option<BTreeSet<PathBuf>>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the temporary files that other threads of this process are writing, whose writes then fail, and refuses all
/// later writes: for a program that ends without waiting for these threads.
pub fn abandon_unfinished() {
    for path in unfinished().take().into_iter().flatten() {
        let _ = std::fs::remove_file(path);
    }
}

/// A temporary file among [`UNFINISHED`] while it lives.
struct Unfinished(PathBuf);

impl Drop for Unfinished {
    fn drop(&mut self) {
        if let Some(all) = unfinished().as_mut() {
            all.remove(&self.0);
        }
    }
}

/// Creates a temporary file and records it.
fn create(
    builder: &tempfile::Builder<'_, '_>,
    folder: &Path,
) -> io::Result<(tempfile::NamedTempFile, Unfinished)> {
    let mut all = unfinished();
    let Some(all) = all.as_mut() else {
        return Err(io::Error::new(io::ErrorKind::Interrupted, "the program is ending"));
    };
    let temporary = builder.tempfile_in(folder)?;
    all.insert(temporary.path().to_owned());
    let record = Unfinished(temporary.path().to_owned());
    Ok((temporary, record))
}

/// Removes temporary files that killed processes left in a folder. Files that cannot be examined or removed stay.
pub fn remove_stale(folder: &Path, now: SystemTime) {
    for (path, metadata) in temporary_entries(folder, STALE_AFTER, now) {
        if metadata.is_file() {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Temporary files and folders in a folder that were not written for `age`. Skips those that cannot be examined.
pub fn temporary_entries(
    folder: &Path,
    age: Duration,
    now: SystemTime,
) -> impl Iterator<Item = (PathBuf, Metadata)> + use<> {
    std::fs::read_dir(folder).into_iter().flatten().flatten().filter_map(move |entry| {
        let name = entry.file_name();
        let matches = name.to_str().is_some_and(|name| name.starts_with(PREFIX) && name.ends_with(SUFFIX));
        let metadata = entry.metadata().ok().filter(|_| matches)?;
        let unwritten = now.duration_since(metadata.modified().ok()?).ok()?;
        (unwritten >= age).then(|| (entry.path(), metadata))
    })
}

/// Writes `path` through a temporary file in the same folder: written, synced, renamed. On any failure `path` is
/// unchanged.
///
/// A symbolic link is followed; an existing path that is not a regular file (a pipe, `/dev/null`) is written to, not
/// replaced.
///
/// # Errors
/// Any error of creating, writing, syncing or renaming.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        // Temporary files are private by default; these are shared, subject to the umask.
        use std::os::unix::fs::PermissionsExt as _;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    write_by(builder, path, write)
}

/// As [`write_atomically`], for a file that only its owner may read (on Unix), such as a private key.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_privately(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    // Temporary files are made with mode 0600 on Unix.
    write_by(tempfile::Builder::new(), path, write)
}

fn write_by(
    mut builder: tempfile::Builder<'_, '_>,
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    if std::fs::metadata(path).is_ok_and(|at| !at.is_file() && !at.is_dir()) {
        let mut buffered = io::BufWriter::new(std::fs::OpenOptions::new().write(true).open(path)?);
        write(&mut buffered)?;
        return buffered.flush();
    }
    // A path that does not exist is no link.
    let path = &std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let (temporary, _record) = create(builder.prefix(PREFIX).suffix(SUFFIX), folder)?;
    let mut buffered = io::BufWriter::with_capacity(1 << 20, temporary);
    write(&mut buffered)?;
    let temporary = buffered.into_inner().map_err(io::IntoInnerError::into_error)?;
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|error| error.error)?;
    // The rename must survive a crash too; not every system can sync folders.
    #[cfg(unix)]
    std::fs::File::open(folder)?.sync_all()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::TempDir::new().unwrap();
        let path = dir.path().join("a.lsp");
        write_atomically(&path, |out| out.write_all(b"old")).unwrap();
        let failed = write_atomically(&path, |out| {
            out.write_all(&[1; 3 << 20])?;
            Err(io::Error::other("disk full"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "disk full");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        write_atomically(&path, |out| out.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    /// In a process of its own: later writes of the process fail.
    #[test]
    fn abandoned_files_are_removed_and_later_writes_fail() {
        const CHILD: &str = "LODESTREAM_TEST_CHILD";
        let name = "whole_file::tests::abandoned_files_are_removed_and_later_writes_fail";
        if std::env::var_os(CHILD).is_none() {
            let mut child = std::process::Command::new(std::env::current_exe().unwrap());
            let output = child.args(["--exact", name]).env(CHILD, "1").output().unwrap();
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(output.status.success() && text.contains("1 passed"), "{text}");
            return;
        }
        let dir = tempfile::TempDir::new().unwrap();
        let files = || std::fs::read_dir(dir.path()).unwrap().count();
        let path = dir.path().join("a.lsp");
        write_atomically(&path, |out| out.write_all(b"before")).unwrap();
        let interrupted = write_atomically(&path, |out| {
            out.write_all(&[1; 3 << 20])?;
            assert_eq!(files(), 2);
            abandon_unfinished();
            assert_eq!(files(), 1, "half a file is left");
            Ok(())
        });
        assert!(interrupted.is_err() && write_atomically(&path, |out| out.write_all(b"after")).is_err());
        assert_eq!((std::fs::read(&path).unwrap(), files()), (b"before".to_vec(), 1));
    }

    #[cfg(unix)]
    #[test]
    fn a_private_file_is_its_owners_alone() {
        use std::os::unix::fs::PermissionsExt as _;
        let dir = tempfile::TempDir::new().unwrap();
        let path = dir.path().join("key.pem");
        write_privately(&path, |out| out.write_all(b"secret")).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    }

    /// A device such as `/dev/null` must not be replaced by a file, which root could do.
    #[cfg(unix)]
    #[test]
    fn a_pipe_is_written_to_and_not_replaced() {
        use std::io::Read as _;
        use std::os::unix::fs::FileTypeExt as _;
        let dir = tempfile::TempDir::new().unwrap();
        let path = dir.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        // Opened for reading and writing, so that neither end blocks.
        let mut pipe = std::fs::OpenOptions::new().read(true).write(true).open(&path).unwrap();
        write_atomically(&path, |out| out.write_all(b"told")).unwrap();
        assert!(std::fs::symlink_metadata(&path).unwrap().file_type().is_fifo());
        let mut told = [0; 4];
        pipe.read_exact(&mut told).unwrap();
        assert_eq!(&told, b"told");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_kept_and_its_target_is_written() {
        let dir = tempfile::TempDir::new().unwrap();
        let [file, link] = ["file", "link"].map(|name| dir.path().join(name));
        std::fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        write_atomically(&link, |out| out.write_all(b"new")).unwrap();
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(std::fs::read(&file).unwrap(), b"new");
    }

    #[test]
    fn partial_files_of_killed_processes_are_removed() {
        let dir = tempfile::TempDir::new().unwrap();
        let names = [".lodestream-abc.part", ".lodestream-new.part", "mine.part", ".lodestream-abc.lsp"];
        for name in names {
            std::fs::write(dir.path().join(name), "x").unwrap();
        }
        let now = SystemTime::now();
        let file = std::fs::File::options().write(true).open(dir.path().join(names[1])).unwrap();
        file.set_modified(now + Duration::from_secs(7000)).unwrap();
        let left = |now| {
            remove_stale(dir.path(), now);
            names.map(|name| dir.path().join(name).exists())
        };
        assert_eq!(left(now), [true; 4]);
        assert_eq!(left(now + Duration::from_secs(7200)), [false, true, true, true]);
        remove_stale(&dir.path().join("none"), now);
    }

    #[test]
    fn a_folder_that_is_missing_is_an_error() {
        let dir = tempfile::TempDir::new().unwrap();
        assert!(write_atomically(&dir.path().join("no/a.lsp"), |_| Ok(())).is_err());
    }
}
