//! Files that are read again while the server runs: when they change, and when that is asked for.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail};
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::sleep;

/// Time between two looks at the files. To read small files costs less than to be told of changes on every kind of file
/// system, through links that are exchanged too.
/// Longest file that is read, in bytes: keys and certificates are short.
const MAX_FILE_BYTES: u64 = 1 << 20;
const POLL_INTERVAL: Duration = Duration::from_secs(10);

/// Reads files again and again: every [`POLL_INTERVAL`], and when `asked` changes. What is in them is handed to `take` the
/// first time and whenever it differs, with whether it is the first time; or why they cannot be read. `what` they are is
/// for the log. Goes on for ever.
pub(crate) async fn watch_files(
    what: &str,
    files: Vec<PathBuf>,
    mut asked: watch::Receiver<u64>,
    mut take: impl FnMut(anyhow::Result<Vec<Vec<u8>>>, bool),
) {
    let mut seen = None;
    // What was read at start is read again, so that nothing is missed that changed since.
    let mut told = false;
    loop {
        let paths = files.clone();
        // Disks are waited for elsewhere. It cannot fail but at the end of everything.
        let read = spawn_blocking(move || paths.iter().map(|path| read_small_file(path)).collect());
        let Ok(texts): Result<anyhow::Result<Vec<Vec<u8>>>, _> = read.await else { return };
        let new = Some(texts.as_ref().map(|texts| hash(texts)).map_err(|why| format!("{why:#}")));
        if new != seen {
            take(texts, seen.is_none());
            seen = new;
        } else if told {
            tracing::info!("{what}: as before");
        }
        told = tokio::select! {
            biased;
            changed = asked.changed() => changed.is_ok(),
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

/// By this a change is seen; lengths part the texts.
fn hash(texts: &[Vec<u8>]) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for text in texts {
        hasher.update(&(text.len() as u64).to_le_bytes()).update(text);
    }
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use tokio::time::timeout;

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn files_are_read_again_when_they_change_or_that_is_asked_for() {
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
        // Seen by itself.
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
