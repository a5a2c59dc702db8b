//! A memo: what was found in a model file, in a file of the cache folder that is named by a hash of the model file and of
//! what the memo is about.
//!
//! A memo is only used if it is whole, was made for the same content under the same path, and if every file that the model
//! names has the content that it had. Otherwise what it says is found again.
//!
//! | bytes | contents |
//! |---|---|
//! | 32 | hash that the file is named by |
//! | 32 | hash of what follows |
//! | 4 | number of other files |
//! | 4 + length + 1 (+ 32) for each | length, path; whether it could be read; its hash |
//! | rest | what was found |

use std::path::{Path, PathBuf};

use blake3::Hash;
use bytes::Bytes;
use lodestream_compress::whole_file::write_atomically;

/// Version of the layout.
const VERSION: u8 = 1;
/// Longest memo, in bytes; more is found again each time.
const MAX_BYTES: u64 = 1 << 30;

/// The content of a model file and of all that it names.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FileState {
    /// Hash of the model file.
    pub(crate) hash: Hash,
    /// The files that it names, and their hashes; `None` for those that cannot be read.
    pub(crate) named: Vec<(PathBuf, Option<Hash>)>,
}

/// What was found in a model file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Memo {
    /// Where it was found.
    pub(crate) state: FileState,
    /// What was found.
    pub(crate) contents: Bytes,
}

/// Reads a memo about the model at `path`, given the hashes of files. `None` if it does not exist or cannot be used.
pub(super) fn read(
    folder: &Path,
    path: &Path,
    about: &[u8],
    hash: impl Fn(&Path) -> Option<Hash>,
) -> Option<Memo> {
    let own = hash(path)?;
    let key = key(path, about, own);
    let bytes = lodestream_import::read_file(&place(folder, path, key), MAX_BYTES).ok()?;
    let (own_key, rest) = bytes.split_first_chunk::<32>()?;
    let (sum, rest) = rest.split_first_chunk::<32>()?;
    if *own_key != *key.as_bytes() || blake3::hash(rest) != *sum {
        return None;
    }
    let (named, rest) = named_files(path, rest)?;
    let found = bytes.len() - rest.len();
    if named.iter().any(|(file, known)| hash(file) != *known) {
        return None;
    }
    Some(Memo { state: FileState { hash: own, named }, contents: Bytes::from(bytes).slice(found..) })
}

/// Writes a memo about the model at `path`. Does nothing if that fails: it is only lost time.
pub(super) fn write(folder: &Path, path: &Path, about: &[u8], memo: &Memo) {
    let key = key(path, about, memo.state.hash);
    let Some(named) = encode_named(path, &memo.state) else { return };
    if (named.len() + memo.contents.len()) as u64 > MAX_BYTES - 64 {
        return;
    }
    // Not joined: what was found may be long.
    let sum = blake3::Hasher::new().update(&named).update(&memo.contents).finalize();
    let write = || {
        std::fs::create_dir_all(folder)?;
        write_atomically(&place(folder, path, key), |out| {
            out.write_all(key.as_bytes())?;
            out.write_all(sum.as_bytes())?;
            out.write_all(&named)?;
            out.write_all(&memo.contents)
        })
    };
    drop(write());
}

/// The path is hashed since what is found may name it, as warnings do.
fn key(path: &Path, about: &[u8], hash: Hash) -> Hash {
    let mut hasher = blake3::Hasher::new_derive_key("lodestream memo");
    hasher.update(&[VERSION]).update(hash.as_bytes()).update(blake3::hash(about).as_bytes());
    hasher.update(path.as_os_str().as_encoded_bytes());
    hasher.finalize()
}

fn place(folder: &Path, path: &Path, key: Hash) -> PathBuf {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let name: String =
        name.chars().take(40).map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect();
    folder.join(format!("{name}-{}.memo", &key.to_hex()[..32]))
}

/// The files that a model names, as a memo has them; `None` for names that are no text, or not below the model's folder.
fn encode_named(path: &Path, state: &FileState) -> Option<Vec<u8>> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut out = u32::try_from(state.named.len()).ok()?.to_le_bytes().to_vec();
    for (file, hash) in &state.named {
        let name = file.strip_prefix(folder).ok()?.to_str()?;
        out.extend(u32::try_from(name.len()).ok()?.to_le_bytes());
        out.extend(name.as_bytes());
        out.push(u8::from(hash.is_some()));
        out.extend(hash.iter().flat_map(|hash| hash.as_bytes()));
    }
    Some(out)
}

type NamedFiles = Vec<(PathBuf, Option<Hash>)>;

/// The files that the model names, and what follows them.
fn named_files<'a>(path: &Path, bytes: &'a [u8]) -> Option<(NamedFiles, &'a [u8])> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let (count, mut rest) = bytes.split_first_chunk::<4>()?;
    let mut files = Vec::new();
    for _ in 0..u32::from_le_bytes(*count) {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (name, after) = after.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        let (readable, after) = after.split_first()?;
        let hash = match readable {
            0 => None,
            _ => Some(Hash::from_bytes(*after.first_chunk::<32>()?)),
        };
        rest = if hash.is_some() { after.get(32..)? } else { after };
        files.push((folder.join(std::str::from_utf8(name).ok()?), hash));
    }
    Some((files, rest))
}

#[cfg(test)]
mod tests {
    use super::super::hash_file;
    use super::*;

    #[test]
    fn a_memo_is_read_only_for_the_same_files_and_question_and_only_if_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (cache, model) = (at("cache"), at("a.gltf"));
        std::fs::write(&model, "one").unwrap();
        std::fs::write(at("a.bin"), "vertices").unwrap();
        let files = ["a.bin", "missing.png"].map(|name| (at(name), hash_file(&at(name))));
        let hash = hash_file(&model).unwrap();
        let state = FileState { hash, named: files.to_vec() };
        let memo = Memo { state, contents: Bytes::from_static(b"what was found") };
        let read = |path: &Path, about: &[u8]| read(&cache, path, about, hash_file);
        assert_eq!(read(&model, b"copies"), None);
        write(&cache, &model, b"copies", &memo);
        assert_eq!(read(&model, b"copies"), Some(memo.clone()));
        assert_eq!(read(&model, b"other settings"), None);

        // Another content, of the model or of a file that it names.
        let changes = [("a.gltf", "two"), ("a.bin", "others"), ("missing.png", "there now")];
        for (name, text) in changes {
            let before = std::fs::read(at(name)).ok();
            std::fs::write(at(name), text).unwrap();
            assert_eq!(read(&model, b"copies"), None, "{name}");
            match before {
                Some(before) => std::fs::write(at(name), before).unwrap(),
                None => std::fs::remove_file(at(name)).unwrap(),
            }
        }
        assert_eq!(read(&model, b"copies"), Some(memo.clone()));

        // A memo about something else in its place, and any damage.
        let own = place(&cache, &model, key(&model, b"copies", hash));
        let whole = std::fs::read(&own).unwrap();
        write(&cache, &model, b"keys", &memo);
        std::fs::copy(place(&cache, &model, key(&model, b"keys", hash)), &own).unwrap();
        assert_eq!(read(&model, b"copies"), None);
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 1;
            std::fs::write(&own, damaged).unwrap();
            assert_eq!(read(&model, b"copies"), None, "byte {at}");
            std::fs::write(&own, &whole[..at]).unwrap();
            assert_eq!(read(&model, b"copies"), None, "cut at {at}");
        }
        std::fs::write(&own, &whole).unwrap();
        assert_eq!(read(&model, b"copies"), Some(memo));
    }
}
