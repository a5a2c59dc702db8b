//! Small files that are read again while the server runs: periodically, and on request.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail};
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::sleep;

/// Longest file that is read, in bytes: keys and certificates are short.
const MAX_FILE_BYTES: u64 = 1 << 20;
/// Time between two reads of the files. Reading small files costs less than change notifications, which differ between file
/// systems and miss replaced links.
const POLL_INTERVAL: Duration = Duration::from_secs(10);

/// Reads files every [`POLL_INTERVAL`], and when `reload_requests` changes. Calls `on_change` with their contents, or the
/// error, for the first read and after every change, and with whether it is the first read. `name` is for the log. Never
/// returns while the runtime runs.
pub(crate) async fn watch_files(
    name: &str,
    files: Vec<PathBuf>,
    mut reload_requests: watch::Receiver<u64>,
    mut on_change: impl FnMut(anyhow::Result<Vec<Vec<u8>>>, bool),
) {
    let mut previous = None;
    // The first read repeats the caller's, in case the files have changed since.
    let mut requested = false;
    loop {
        let paths = files.clone();
        // Fails only when the runtime shuts down.
        let read = spawn_blocking(move || paths.iter().map(|path| read_small_file(path)).collect());
        let Ok(contents): Result<anyhow::Result<Vec<Vec<u8>>>, _> = read.await else { return };
        let new = Some(contents.as_ref().map(|contents| hash(contents)).map_err(|why| format!("{why:#}")));
        if new != previous {
            on_change(contents, previous.is_none());
            previous = new;
        } else if requested {
            tracing::info!("{name}: unchanged");
        }
        requested = tokio::select! {
            biased;
            changed = reload_requests.changed() => changed.is_ok(),
            () = sleep(POLL_INTERVAL) => false,
        };
    }
}

/// Reads a file of at most [`MAX_FILE_BYTES`].
///
/// # Errors
/// The file cannot be read, or is longer.
pub(crate) fn read_small_file(path: &Path) -> anyhow::Result<Vec<u8>> {
    let about = || format!("cannot read {}", path.display());
    let length = std::fs::metadata(path).with_context(about)?.len();
    if length > MAX_FILE_BYTES {
        bail!("{} has {length} bytes; at most {MAX_FILE_BYTES} are read", path.display());
    }
    std::fs::read(path).with_context(about)
}

/// Hash of the contents of all files; lengths separate them.
fn hash(contents: &[Vec<u8>]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for bytes in contents {
        hasher.update(&(bytes.len() as u64).to_le_bytes()).update(bytes);
    }
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use tokio::time::timeout;

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn files_are_read_again_when_they_change_or_on_request() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "one").unwrap();
        let (ask, asked) = watch::channel(0);
        let taken = Arc::new(Mutex::new(Vec::new()));
        let note = Arc::clone(&taken);
        let following =
            tokio::spawn(watch_files("a file", vec![file.clone()], asked, move |texts, first| {
                let texts = texts.map(|texts| String::from_utf8(texts.concat()).unwrap());
                note.lock().unwrap().push((texts.unwrap_or_else(|_| "gone".into()), first));
            }));
        let wait = async |count: usize| {
            let enough = async {
                while taken.lock().unwrap().len() < count {
                    sleep(Duration::from_millis(10)).await;
                }
            };
            timeout(2 * POLL_INTERVAL, enough).await.unwrap();
        };
        wait(1).await;
        // Found by polling.
        std::fs::write(&file, "two").unwrap();
        wait(2).await;
        ask.send_modify(|count| *count += 1);
        std::fs::remove_file(&file).unwrap();
        wait(3).await;
        std::fs::write(&file, "two").unwrap();
        wait(4).await;
        sleep(3 * POLL_INTERVAL).await;
        following.abort();
        let taken: Vec<_> = taken.lock().unwrap().clone();
        let expected = [("one", true), ("two", false), ("gone", false), ("two", false)];
        assert_eq!(taken, expected.map(|(text, first)| (text.to_owned(), first)));
    }
}
