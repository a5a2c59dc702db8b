//! GLB and glTF files: their JSON, and the bytes of buffers and images, which are embedded, in data URIs, or in files
//! beside the model.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use bytes::Bytes;
use glam::DMat4;
use gltf::json;

use super::pose;
use super::root::{
    CLEAR_COAT, COMPRESSED_VIEWS, DRACO, IOR, Root, SPECULAR, TEXTURE_AVIF, TEXTURE_BASISU, TEXTURE_WEBP,
    TRANSMISSION,
};
use super::skeleton::Skeleton;
use crate::beside::Beside;
use crate::content::{Content, OpenFile};
use crate::error::ImportError;
use crate::file::{MAX_FILE_BYTES, read_file};

/// Extensions that a file may require, besides [`COMPRESSED_VIEWS`] and, with the feature `draco`, [`DRACO`].
const SUPPORTED: [&str; 13] = [
    "EXT_mesh_gpu_instancing",
    TEXTURE_AVIF,
    TEXTURE_WEBP,
    TEXTURE_BASISU,
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_materials_unlit",
    "KHR_materials_emissive_strength",
    IOR,
    SPECULAR,
    CLEAR_COAT,
    TRANSMISSION,
];

fn supported(name: &str) -> bool {
    SUPPORTED.contains(&name)
        || COMPRESSED_VIEWS.contains(&name)
        || (cfg!(feature = "draco") && name == DRACO)
}

/// Whether a file is imported without the extension even if it requires it: extensions of materials and lights, images of
/// textures, and metadata.
fn dispensable(name: &str) -> bool {
    name.contains("_materials_") || name.contains("_lights_") || name == "KHR_xmp_json_ld"
}

const MAGIC: &[u8; 4] = b"glTF";
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BIN: u32 = 0x004E_4942;

/// Most buffers in files of their own that stay open. Further ones are read whole: a process may have some 1,000 open files.
const MAX_OPEN: usize = 64;

/// A parsed model. Of buffers in files, parts are read on demand; those in data URIs are kept.
pub(crate) struct Document {
    pub(super) path: PathBuf,
    pub(super) root: Root,
    bin: Option<Buffer>,
    /// What is unusual about the file as a whole, for people; each without the file's name.
    pub(super) warnings: Vec<String>,
    /// As of [`Root::material_extensions`].
    material_extensions: BTreeMap<String, usize>,
    /// Where files are that are not at the paths that it states.
    beside: Beside,
    /// Transformations of all nodes to the scene, once a skin needs them.
    pub(super) to_scene: OnceLock<Vec<DMat4>>,
    /// Skeletons that move, once a skin needs them.
    pub(super) skeletons: OnceLock<BTreeMap<usize, Arc<Skeleton>>>,
    /// Matrices of the skins' joints, by skin.
    pub(super) joints: Mutex<BTreeMap<usize, Arc<[DMat4]>>>,
    /// Buffers that were opened or decoded, by index.
    opened: Mutex<BTreeMap<usize, Buffer>>,
}

/// The bytes of one buffer.
#[derive(Clone, Debug)]
pub(super) struct Buffer {
    /// The file that they are in, for messages.
    path: Arc<Path>,
    content: Arc<dyn Content>,
    /// Where they are in the content.
    range: Range<u64>,
}

impl Buffer {
    fn all_of(path: &Path, content: Arc<dyn Content>) -> Self {
        Self { path: path.into(), range: 0..content.length(), content }
    }

    pub(super) fn length(&self) -> u64 {
        self.range.end - self.range.start
    }

    /// The bytes of a range, which is not longer than the buffer.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn read(&self, range: Range<u64>) -> Result<Bytes, ImportError> {
        let read = self.content.read(self.range.start + range.start..self.range.start + range.end);
        read.map_err(|source| ImportError::Read { path: self.path.to_path_buf(), source })
    }
}

impl fmt::Debug for Document {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Document").field("path", &self.path).finish_non_exhaustive()
    }
}

/// Location of the bytes that a URI names.
pub(super) enum Location {
    Inline(Bytes),
    File(PathBuf),
}

impl Document {
    /// Parses the file at `path`, of which a GLB's BIN chunk is not read.
    ///
    /// # Errors
    /// A file that cannot be read, is not glTF 2.0, or requires extensions that are not supported.
    pub(crate) fn parse(path: &Path, content: Arc<dyn Content>) -> Result<Self, ImportError> {
        let error = |what: String| ImportError::gltf(path, what);
        let whole = Buffer::all_of(path, content);
        let is_glb = whole.length() >= 4 && *whole.read(0..4)? == *MAGIC;
        let Chunks { text, bin, is_unaligned } = match is_glb {
            true => split(path, &whole)?,
            false => Chunks { text: 0..whole.length(), bin: None, is_unaligned: false },
        };
        let text = whole.read(text)?;
        let bin = bin.map(|bin| Buffer { range: bin, ..whole });
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
        let mut warnings = Vec::new();
        if is_unaligned {
            warnings
                .push("has chunks whose lengths are no multiples of 4; it is read nevertheless".to_owned());
        }
        let mut unpadded = text.trim_ascii_end();
        while let Some(rest) = unpadded.strip_suffix(b"\0") {
            unpadded = rest.trim_ascii_end();
        }
        if unpadded.len() < text.trim_ascii_end().len() {
            warnings.push(
                "has zero bytes after its JSON, where spaces belong; it is read nevertheless".to_owned(),
            );
        }
        let text = unpadded;
        // The version first: other versions have other fields.
        let head: Head = json::deserialize::from_slice(text)
            .map_err(|e| error(format!("is not glTF JSON: {e}; export it again as glTF 2.0")))?;
        if !head.asset.version.starts_with("2.") {
            return Err(error(format!(
                "asset.version is {:?}; only glTF 2.0 is read, so export it as that",
                head.asset.version
            )));
        }
        let missing: Vec<&str> = head.extensions_required.iter().map(String::as_str).collect();
        let missing: Vec<&str> =
            missing.into_iter().filter(|name| !supported(name) && !dispensable(name)).collect();
        if !missing.is_empty() {
            let names = missing.join(", ");
            return Err(error(format!(
                "requires extensions that are not supported: {names}; export it without them (compressed \
                 meshes uncompressed)"
            )));
        }
        let mut root: Root = json::deserialize::from_slice(text)
            .map_err(|e| error(format!("is not valid glTF 2.0: {e}; export it again")))?;
        warnings.extend(pose::resolve(&mut root));
        root.shrink_to_fit();
        let (opened, to_scene, joints, skeletons) = Default::default();
        let (path, beside) = (path.to_owned(), Beside::new(path));
        let material_extensions = root.material_extensions();
        Ok(Self {
            path,
            root,
            bin,
            warnings,
            material_extensions,
            beside,
            to_scene,
            skeletons,
            joints,
            opened,
        })
    }

    /// [`Self::warnings`], each a line.
    pub(super) fn told(&self) -> impl Iterator<Item = String> {
        self.warnings.iter().map(|what| format!("{}: {what}", self.path.display()))
    }

    pub(super) fn error(&self, what: impl Into<String>) -> ImportError {
        ImportError::gltf(&self.path, what)
    }

    /// Extensions that the file uses and that are not supported, each once, with the number of materials that have them.
    pub(super) fn unknown_extensions(&self) -> impl Iterator<Item = (&str, usize)> {
        // Not every program lists what it uses.
        let of_materials = self.material_extensions.keys().filter(|name| name.contains("_materials_"));
        let names: BTreeSet<&String> = self
            .root
            .extensions_used
            .iter()
            .chain(&self.root.extensions_required)
            .chain(of_materials)
            .collect();
        let counted = |name: &String| self.material_extensions.get(name).copied().unwrap_or_default();
        names.into_iter().filter(|name| !supported(name)).map(move |name| (name.as_str(), counted(name)))
    }

    /// The bytes of one buffer: at least as many as its `byteLength`.
    pub(super) fn buffer(&self, index: usize) -> Result<Buffer, ImportError> {
        let Some(buffer) = self.root.buffers.get(index) else {
            return Err(self.error(format!("buffers[{index}] does not exist")));
        };
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bytes) = opened.get(&index) {
            return Ok(bytes.clone());
        }
        let bytes = match &buffer.uri {
            Some(uri) => match self.locate(uri).map_err(|e| self.error(format!("buffers[{index}]: {e}")))? {
                Location::Inline(bytes) => Buffer::all_of(&self.path, Arc::new(bytes)),
                Location::File(file) if opened.len() < MAX_OPEN => {
                    Buffer::all_of(&file, Arc::new(OpenFile::new(&file)?))
                }
                Location::File(file) => {
                    Buffer::all_of(&file, Arc::new(Bytes::from(read_file(&file, MAX_FILE_BYTES)?)))
                }
            },
            None => match self.bin.as_ref().filter(|_| index == 0) {
                Some(bin) => bin.clone(),
                None => {
                    let what = format!("buffers[{index}] has neither a uri nor the file's BIN chunk");
                    return Err(self.error(what));
                }
            },
        };
        if bytes.length() < buffer.byte_length.0 {
            return Err(self.error(format!(
                "buffers[{index}] states {} bytes but has {}; the file is truncated",
                buffer.byte_length.0,
                bytes.length()
            )));
        }
        opened.insert(index, bytes.clone());
        Ok(bytes)
    }

    /// The files that a URI stands for, whether they exist or not: where it states one, and where it is looked for else.
    pub(super) fn files(&self, uri: &str) -> Vec<PathBuf> {
        let stated = stated(self.beside.folder(), uri).ok();
        let found = match self.locate(uri) {
            Ok(Location::Inline(_)) => None,
            Ok(Location::File(file)) => Some(file),
            Err(_) => self.beside.plain(uri),
        };
        let found = found.filter(|found| stated.as_ref() != Some(found));
        stated.into_iter().flat_map(|file| self.beside.and_named(file)).chain(found).collect()
    }

    /// Resolves a URI. A file that does not exist where it should be is looked for by its name beside the model.
    ///
    /// # Errors
    /// Data URIs that do not decode, and paths outside the model's folder of files that are not found in it.
    pub(super) fn locate(&self, uri: &str) -> Result<Location, UriError> {
        if let Some(rest) = uri.strip_prefix("data:") {
            return decode_data(rest).map(Location::Inline);
        }
        let stated = stated(self.beside.folder(), uri);
        if let Ok(path) = &stated
            && path.exists()
        {
            return stated.map(Location::File);
        }
        let decoded = percent_encoding::percent_decode_str(uri).decode_utf8_lossy();
        let found = self.beside.named(&decoded).or_else(|| self.beside.named(uri));
        found.map_or(stated, Ok).map(Location::File)
    }
}

/// The path that a URI states, below the folder of a model.
fn stated(folder: &Path, uri: &str) -> Result<PathBuf, UriError> {
    let name =
        percent_encoding::percent_decode_str(uri).decode_utf8().map_err(|_| UriError::NotUtf8(shown(uri)))?;
    let relative = Path::new(&*name);
    let inside = relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    // Schemes and drive letters are not relative paths either.
    let plain = !name.contains(':') && !name.contains('\\') && !name.is_empty();
    if !inside || !plain {
        return Err(UriError::NotBeside(shown(uri)));
    }
    Ok(folder.join(relative))
}

/// The fields that are checked before the rest is parsed.
#[derive(serde::Deserialize)]
struct Head {
    asset: HeadAsset,
    #[serde(default, rename = "extensionsRequired")]
    extensions_required: Vec<String>,
}

#[derive(serde::Deserialize)]
struct HeadAsset {
    version: String,
}

/// Where the chunks of a GLB are.
struct Chunks {
    /// JSON.
    text: Range<u64>,
    bin: Option<Range<u64>>,
    /// Whether a chunk's length is no multiple of 4.
    is_unaligned: bool,
}

/// Finds the chunks of a GLB (glTF 2.0 specification, §4.4). A chunk after one whose length is no multiple of 4 follows at
/// once, or at the next multiple: programs write both.
fn split(path: &Path, file: &Buffer) -> Result<Chunks, ImportError> {
    let error = |what: String| ImportError::gltf(path, what);
    let cut = || error("ends within its header or a chunk; the file is truncated".to_owned());
    // Two numbers of 4 bytes.
    let pair = |at: u64| {
        if at + 8 > file.length() {
            return Err(cut());
        }
        let bytes = file.read(at..at + 8)?;
        let word = |at: usize| bytes.get(at..)?.first_chunk().map(|word| u32::from_le_bytes(*word));
        word(0).zip(word(4)).ok_or_else(cut)
    };
    let (version, length) = pair(4)?;
    let length = u64::from(length);
    if version != 2 {
        return Err(error(format!("is GLB version {version}; only version 2 is read")));
    }
    if length > file.length() {
        return Err(cut());
    }
    let chunk = |at: u64| {
        let (size, kind) = pair(at)?;
        let end = Some(at + 8 + u64::from(size)).filter(|&end| end <= length).ok_or_else(cut)?;
        Ok::<_, ImportError>((kind, at + 8..end))
    };
    let (first, text) = chunk(12)?;
    if first != CHUNK_JSON {
        return Err(error("does not begin with a JSON chunk; export it again".to_owned()));
    }
    let aligned = text.end.next_multiple_of(4);
    let at_once = (aligned != text.end && text.end < length).then(|| chunk(text.end).ok()).flatten();
    let second = match at_once.filter(|(kind, _)| *kind == CHUNK_BIN) {
        Some(found) => Some(found),
        None if aligned < length => Some(chunk(aligned)?),
        None => None,
    };
    let bin = second.filter(|(kind, _)| *kind == CHUNK_BIN).map(|(_, bin)| bin);
    let is_unaligned =
        [Some(&text), bin.as_ref()].into_iter().flatten().any(|chunk| (chunk.end - chunk.start) % 4 != 0);
    Ok(Chunks { text, bin, is_unaligned })
}

/// A URI that is not read. The message is one line.
#[derive(Debug, thiserror::Error)]
pub(super) enum UriError {
    #[error("the URI {0:?} is not UTF-8")]
    NotUtf8(String),
    #[error("the URI {0:?} is not a file beside the model; put the file into its folder")]
    NotBeside(String),
    #[error("a data URI without a comma")]
    NoComma,
    #[error("a data URI does not decode: {0}")]
    Base64(#[from] data_encoding::DecodeError),
}

/// The bytes of `[<type>][;base64],<data>`.
fn decode_data(rest: &str) -> Result<Bytes, UriError> {
    let (head, data) = rest.split_once(',').ok_or(UriError::NoComma)?;
    if !head.ends_with(";base64") {
        return Ok(percent_encoding::percent_decode_str(data).collect::<Vec<u8>>().into());
    }
    // Padding is often left out.
    Ok(data_encoding::BASE64_NOPAD.decode(data.trim_end_matches('=').as_bytes())?.into())
}

/// A URI for an error message.
fn shown(uri: &str) -> String {
    uri.chars().take(60).collect()
}
