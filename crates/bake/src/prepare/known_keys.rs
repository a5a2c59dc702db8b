//! Keys of packs that earlier runs computed, in a memo for each glTF file: the key of a batch depends on what is imported,
//! and so takes an import otherwise.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::cache::{self, Key};
use super::settings_key::{PackSettings, pack_version};
use crate::scene::Asset;
use crate::sources::{FileState, Memo, Source, Sources};
use lodestream_import::is_gltf;

/// Most keys in a memo.
const MAX_KEYS: usize = 1 << 17;
/// Bytes of an entry: the hash of a pack's settings, its part of the file included, and its key.
const ENTRY_BYTES: usize = 64;

type Bytes = [u8; 32];

/// The keys of a scene's packs.
pub(super) struct KnownKeys<'a> {
    sources: &'a Sources,
    files: Mutex<BTreeMap<PathBuf, File>>,
}

#[derive(Default)]
struct File {
    keys: HashMap<Bytes, Bytes>,
    /// What the keys were found in; `None` before any is known.
    state: Option<FileState>,
    /// Whether its memo lacks any of the keys.
    is_new: bool,
}

impl<'a> KnownKeys<'a> {
    pub(super) fn new(sources: &'a Sources) -> Self {
        Self { sources, files: Mutex::default() }
    }

    /// The key of an asset with resolved settings, and the files that its model names; `None` if it is not known.
    pub(super) fn get(&self, asset: &Asset) -> Option<(Key, Vec<PathBuf>)> {
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        if !files.contains_key(&asset.file) {
            files.insert(asset.file.clone(), self.read(&asset.file));
        }
        let file = files.get(&asset.file)?;
        let key = file.keys.get(&settings(asset))?;
        let named = file.state.iter().flat_map(|state| &state.named).map(|(file, _)| file.clone());
        Some((Key::of_bytes(*key), named.collect()))
    }

    fn read(&self, path: &Path) -> File {
        let Some(Memo { state, contents }) = self.sources.memo(path, &about()) else {
            return File::default();
        };
        let (entries, _) = contents.as_chunks::<ENTRY_BYTES>();
        let entry = |entry: &[u8; ENTRY_BYTES]| Some((*entry.first_chunk()?, *entry.last_chunk()?));
        File { keys: entries.iter().filter_map(entry).collect(), state: Some(state), is_new: false }
    }

    /// Adds the key of an asset with resolved settings, whose model was read.
    pub(super) fn add(&self, asset: &Asset, key: Key, source: &Source) {
        if !is_gltf(&asset.file) {
            return;
        }
        let settings = settings(asset);
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        let file = files.entry(asset.file.clone()).or_default();
        let state = source.state();
        if file.state.as_ref() != Some(&state) {
            // The file has changed since the other keys were found.
            *file = File { state: Some(state), ..File::default() };
        }
        file.is_new |= file.keys.insert(settings, key.bytes()) != Some(key.bytes());
    }

    /// Writes the memos that lack a key.
    pub(super) fn write(self) {
        let files = self.files.into_inner().unwrap_or_else(PoisonError::into_inner);
        for (path, File { keys, state, is_new }) in files {
            let Some(state) = state.filter(|_| is_new && keys.len() <= MAX_KEYS) else { continue };
            // In an order that does not depend on the run.
            let keys: BTreeMap<Bytes, Bytes> = keys.into_iter().collect();
            let entries: Vec<u8> =
                keys.into_iter().flat_map(|(settings, key)| [settings, key]).flatten().collect();
            self.sources.keep_memo(&path, &about(), &Memo { state, contents: entries.into() });
        }
    }
}

/// What the memos are about: with the versions that keys depend on.
fn about() -> Vec<u8> {
    let mut about = b"keys".to_vec();
    about.extend(cache::PREPARATION_VERSION.to_le_bytes());
    about.extend(pack_version().to_le_bytes());
    about
}

fn settings(asset: &Asset) -> Bytes {
    *blake3::hash(&PackSettings::of(asset).encode()).as_bytes()
}
