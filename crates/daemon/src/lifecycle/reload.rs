//! Files that are read again while the server runs: when they change, and when that is asked for.

use std::path::PathBuf;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::sleep;

use crate::transport::certificate::read_pem;

/// Time between two looks at the files. To read small files costs less than to be told of changes on every kind of file
/// system, through links that are exchanged too.
const LOOK_EVERY: Duration = Duration::from_secs(10);

/// Reads files again and again: every [`LOOK_EVERY`], and when `asked` changes. What is in them is handed to `take` the
/// first time and whenever it differs, with whether it is the first time; or why they cannot be read. `what` they are is
/// for the log. Goes on for ever.
pub(crate) async fn follow(
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
        let read = spawn_blocking(move || paths.iter().map(|path| read_pem(path)).collect());
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
            () = sleep(LOOK_EVERY) => false,
        };
    }
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
        let following = tokio::spawn(follow("a file", vec![file.clone()], asked, move |texts, first| {
            let texts = texts.map(|texts| String::from_utf8(texts.concat()).unwrap());
            note.lock().unwrap().push((texts.unwrap_or_else(|_| "gone".into()), first));
        }));
        let wait = async |count: usize| {
            let enough = async {
                while taken.lock().unwrap().len() < count {
                    sleep(Duration::from_millis(10)).await;
                }
            };
            timeout(2 * LOOK_EVERY, enough).await.unwrap();
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
        sleep(3 * LOOK_EVERY).await;
        following.abort();
        let taken: Vec<_> = taken.lock().unwrap().clone();
        let expected = [("one", true), ("two", false), ("gone", false), ("two", false)];
        assert_eq!(taken, expected.map(|(text, first)| (text.to_owned(), first)));
    }
}
