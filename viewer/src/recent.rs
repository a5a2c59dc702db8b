//! What was opened last, in a file of the user's state folder.

use std::ffi::OsString;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use lodestream_compress::whole_file::write_atomically;

/// Most entries kept.
const MOST: usize = 8;
/// Longest file that is read, in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// `$XDG_STATE_HOME/lodestream/recent.json` or `~/.local/state/lodestream/recent.json`.
pub(crate) fn default_file() -> Option<PathBuf> {
    let variable = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = variable("XDG_STATE_HOME").or_else(|| variable("HOME").map(|home| home.join(".local/state")));
    base.map(|base| base.join("lodestream/recent.json"))
}

/// What was opened last, the newest first, each as words of a command line. A file that is missing or damaged is empty.
pub(crate) fn read(file: &Path) -> Vec<Vec<OsString>> {
    let mut text = String::new();
    let read = std::fs::File::open(file).and_then(|opened| opened.take(MAX_BYTES).read_to_string(&mut text));
    if read.is_err() {
        return Vec::new();
    }
    let entries: Vec<Vec<String>> = serde_json::from_str(&text).unwrap_or_default();
    entries.into_iter().take(MOST).map(|words| words.into_iter().map(OsString::from).collect()).collect()
}

/// Puts words first; returns the new list. Paths become absolute ones. What is not Unicode is not kept, and a file that
/// cannot be written is left alone: nothing depends on it.
pub(crate) fn add(file: &Path, words: &[OsString]) -> Vec<Vec<OsString>> {
    let absolute = |word: &OsString| {
        let path = Path::new(word);
        if path.exists() {
            std::path::absolute(path).map_or_else(|_| word.clone(), OsString::from)
        } else {
            word.clone()
        }
    };
    let words: Vec<OsString> = words.iter().map(absolute).collect();
    let mut entries = read(file);
    entries.retain(|entry| *entry != words);
    entries.insert(0, words);
    entries.truncate(MOST);
    let unicode: Vec<Vec<&str>> =
        entries.iter().filter_map(|words| words.iter().map(|word| word.to_str()).collect()).collect();
    let written = serde_json::to_vec_pretty(&unicode).map_err(std::io::Error::other).and_then(|json| {
        file.parent().map_or(Ok(()), std::fs::create_dir_all)?;
        write_atomically(file, |out| out.write_all(&json))
    });
    if let Err(why) = written {
        tracing::debug!("{}: {why}", file.display());
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_comes_first_once_and_a_damaged_file_is_empty() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state/lodestream/recent.json");
        let words = |word: &str| vec![OsString::from(word)];
        assert_eq!(read(&file), Vec::<Vec<OsString>>::new());
        for number in 0..10 {
            add(&file, &words(&format!("ws://h:{number}")));
        }
        let seen = add(&file, &words("ws://h:5"));
        assert_eq!(seen, read(&file));
        assert_eq!((seen.len(), &seen[0], &seen[1]), (MOST, &words("ws://h:5"), &words("ws://h:9")));
        std::fs::write(&file, "[[1").unwrap();
        assert_eq!(read(&file), Vec::<Vec<OsString>>::new());
    }
}
