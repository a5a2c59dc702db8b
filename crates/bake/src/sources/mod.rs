//! Model files as a scene and its packs are made from them: each is read and parsed once while it is among the last ones,
//! and not at all if memos in a cache folder say what is needed of it.

pub(crate) mod free_memory;
mod hashed_file;
mod memo;

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use lodestream_import::gltf::{CONTENTS_VERSION, Contents, CopyTolerance};
use lodestream_import::{
    CreaseAngle, ImageSource, ImportError, Imported, ModelFile, Part, is_gltf, is_streamed,
};

use free_memory::Use;
use hashed_file::HashedFile;
pub(crate) use memo::{FileState, Memo};

/// A model file and the hashes of all that is read for it.
#[derive(Debug)]
pub(crate) struct Source {
    pub(crate) model: ModelFile,
    pub(crate) hash: blake3::Hash,
    /// Of the files that the model names; `None` for those that cannot be read.
    pub(crate) dependencies: Vec<Option<blake3::Hash>>,
    /// Of images within the model file, by the names that they have for messages.
    images: Mutex<BTreeMap<PathBuf, blake3::Hash>>,
    /// A part that was imported already, for the next import of it.
    imported: Mutex<Option<(Part, CreaseAngle, Imported)>>,
}

impl Source {
    /// Opens a model file and hashes it and the files that it names.
    ///
    /// # Errors
    /// A model file that cannot be read. Other files may be missing: the key then encodes that they are.
    pub(crate) fn read(path: &Path) -> Result<Self, ImportError> {
        free_memory::check(path, Use::Read)?;
        // A PLY or STL file is never loaded whole. If it cannot be read, opening it returns the error.
        let streamed = is_streamed(path).then(|| hash_file(path)).flatten();
        let (hash, model) = match streamed {
            Some(hash) => (hash, ModelFile::streamed(path)),
            None => {
                let file = HashedFile::open(path)?;
                (file.hash(), ModelFile::parse(path, Arc::new(file))?)
            }
        };
        let dependencies = model.dependencies().iter().map(|file| hash_file(file)).collect();
        Ok(Self::new(model, hash, dependencies))
    }

    fn new(model: ModelFile, hash: blake3::Hash, dependencies: Vec<Option<blake3::Hash>>) -> Self {
        Self { model, hash, dependencies, images: Mutex::default(), imported: Mutex::default() }
    }

    /// Hash of the bytes of an image of the model; `None` if it cannot be read. Those of a texture that thousands of meshes
    /// use are hashed once.
    pub(crate) fn image_hash(&self, image: &ImageSource) -> Option<blake3::Hash> {
        let Some(bytes) = &image.bytes else {
            let named = self.model.dependencies().iter().position(|file| *file == image.path);
            return named.map_or_else(|| hash_file(&image.path), |at| self.dependencies[at]);
        };
        let mut images = self.images.lock().unwrap_or_else(PoisonError::into_inner);
        Some(*images.entry(image.path.clone()).or_insert_with(|| blake3::hash(bytes)))
    }

    /// Imports a part, or takes what [`Self::keep`] has of it.
    ///
    /// # Errors
    /// As [`ModelFile::import`].
    pub(crate) fn import(&self, part: &Part, crease: CreaseAngle) -> Result<Imported, ImportError> {
        let mut kept = self.imported.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = kept.take_if(|kept| kept.0 == *part && kept.1 == crease);
        if let Some((.., imported)) = kept {
            return Ok(imported);
        }
        free_memory::check(self.model.path(), Use::Import)?;
        self.model.import(part, crease)
    }

    /// Keeps an imported part, the last one only, for the next import of it.
    pub(crate) fn keep(&self, part: &Part, crease: CreaseAngle, imported: Imported) {
        let kept = Some((part.clone(), crease, imported));
        *self.imported.lock().unwrap_or_else(PoisonError::into_inner) = kept;
    }

    /// The content of the model file and of those that it names.
    pub(crate) fn state(&self) -> FileState {
        let named =
            self.model.dependencies().iter().cloned().zip(self.dependencies.iter().copied()).collect();
        FileState { hash: self.hash, named }
    }
}

/// The model files of a scene. It is for one opening of a scene: a file that changes meanwhile is an error, unless another
/// file takes its name.
#[derive(Debug, Default)]
pub struct Sources {
    /// Folder of memos.
    folder: Option<PathBuf>,
    /// The files that were read last, since assets of one file follow one another.
    kept: Mutex<VecDeque<(PathBuf, Arc<Source>)>>,
    /// Hashes of files that were looked up in memos; `None` for files that cannot be read.
    hashes: Mutex<BTreeMap<PathBuf, Option<blake3::Hash>>>,
    read: AtomicUsize,
}

/// Most model files kept: where one file's assets end, threads still prepare them.
pub(crate) const KEPT: usize = 2;

impl Sources {
    /// Model files of which memos are kept in a folder, usually that of the packs.
    #[must_use]
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: Some(folder.to_owned()), ..Self::default() }
    }

    /// How many model files were read and parsed so far, each time counted.
    #[must_use]
    pub fn files_read(&self) -> usize {
        self.read.load(Ordering::Relaxed)
    }

    /// The model file at a path. Reads it while others wait, who are likely to want the same.
    ///
    /// # Errors
    /// As [`Source::read`].
    pub(crate) fn get(&self, path: &Path) -> Result<Arc<Source>, ImportError> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, source)) = kept.iter().find(|(of, _)| of == path) {
            return Ok(Arc::clone(source));
        }
        self.read.fetch_add(1, Ordering::Relaxed);
        let source = Arc::new(Source::read(path)?);
        kept.push_back((path.to_owned(), Arc::clone(&source)));
        if kept.len() > KEPT {
            kept.pop_front();
        }
        Ok(source)
    }

    /// The meshes and lights of a glTF file, from a memo if there is one.
    ///
    /// # Errors
    /// As [`lodestream_import::gltf::contents`].
    pub(crate) fn contents(
        &self,
        path: &Path,
        copies: Option<CopyTolerance>,
    ) -> Result<Contents, ImportError> {
        let mut about = b"contents".to_vec();
        about.extend(CONTENTS_VERSION.to_le_bytes());
        let (tag, number) = match copies {
            None => (0, 0.0),
            Some(CopyTolerance::Share(share)) => (1, share),
            Some(CopyTolerance::Length(length)) => (2, length),
        };
        about.push(tag);
        about.extend(number.to_le_bytes());
        let memo = self.memo(path, &about);
        if let Some(contents) = memo.and_then(|memo| Contents::from_bytes(&memo.contents)) {
            return Ok(contents);
        }
        let source = self.get(path)?;
        let contents = source.model.contents(copies)?;
        if let Some(bytes) = contents.to_bytes() {
            self.keep_memo(path, &about, &Memo { state: source.state(), contents: bytes.into() });
        }
        Ok(contents)
    }

    /// What is known about a glTF file that has not changed, nor any file that it names. `about` says what, with the
    /// settings and versions that it depends on.
    pub(crate) fn memo(&self, path: &Path, about: &[u8]) -> Option<Memo> {
        let folder = self.folder.as_deref().filter(|_| is_gltf(path))?;
        memo::read(folder, path, about, |file| self.hash(file))
    }

    /// Writes a memo about a file that was read. One that cannot be written is made again next time.
    pub(crate) fn keep_memo(&self, path: &Path, about: &[u8], memo: &Memo) {
        if let Some(folder) = self.folder.as_deref().filter(|_| is_gltf(path)) {
            memo::write(folder, path, about, memo);
        }
    }

    /// Hash of a file's content; `None` if it cannot be read.
    fn hash(&self, path: &Path) -> Option<blake3::Hash> {
        let mut hashes = self.hashes.lock().unwrap_or_else(PoisonError::into_inner);
        *hashes.entry(path.to_owned()).or_insert_with(|| hash_file(path))
    }
}

fn hash_file(path: &Path) -> Option<blake3::Hash> {
    let mut hasher = blake3::Hasher::new();
    let file = std::fs::File::open(path).ok()?;
    // Neither a folder nor an endless device.
    file.metadata().ok().filter(std::fs::Metadata::is_file)?;
    hasher.update_reader(file).ok()?;
    Some(hasher.finalize())
}
