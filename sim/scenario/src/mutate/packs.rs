//! Damaged packs: opened, verified, loaded, decoded, and served to a client.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use lodestream_bake::scene::{Asset, Scene};
use lodestream_compress::{compress, decompress};
use lodestream_geometry::Codec;
use lodestream_geometry::pack::{ENTRY_BYTES, HEAD_BYTES};
use lodestream_protocol::source::Immediate;
use lodestream_scene::description::Instance;
use lodestream_store::{BlobCache, PackFile};
use rand::Rng as _;
use rand_pcg::Pcg64Mcg;

use super::damage;
use super::exchange::{Ended, stream};
use super::subject::Subject;
use super::tally::Verdict;
use crate::field::Field;
use crate::plan::SceneChoice;
use crate::scene;

/// Offsets of the number of blobs and of the hashed part in a pack's head.
const COUNT_AT: usize = 12;
const FINGERPRINT_AT: usize = 16;
const HASH_AT: usize = HEAD_BYTES - 16;
/// The kind of chunks in a pack's table.
const CHUNK: u8 = 2;
/// Offsets of offset, length and hash in an entry of the table.
const OFFSET_AT: usize = 8;
const LENGTH_AT: usize = 16;
const ENTRY_HASH_AT: usize = 20;
/// Capacity of a store's blob cache.
const CACHE_BYTES: u64 = 4 << 20;

/// Packs of all codecs to damage, each with a scene that consists of its asset.
#[derive(Debug)]
pub struct Packs {
    packs: Vec<(Scene, Vec<u8>)>,
    hashed: bool,
    folder: tempfile::TempDir,
}

impl Packs {
    /// Prepares the packs that the cache folder lacks. `hashed`: hashes are corrected after the damage.
    ///
    /// # Errors
    /// A scene that cannot be generated or prepared.
    pub fn prepare(cache: &Path, hashed: bool) -> anyhow::Result<Self> {
        let mut packs = Vec::new();
        let field = Field { assets: 2, faces: 2500, instances: 2 };
        for codec in [Codec::Range, Codec::AxisAligned, Codec::Zstd] {
            for choice in [SceneChoice::DemoSmall, SceneChoice::Field(field)] {
                let (scene, files) = scene::packs(&choice, Some(codec.into()), cache)?;
                for (asset, file) in scene.assets.iter().zip(files) {
                    let bytes = std::fs::read(file.path())
                        .with_context(|| format!("{}: cannot be read", file.path().display()))?;
                    packs.push((single_asset_scene(asset, &scene), bytes));
                }
            }
        }
        let folder = tempfile::tempdir().context("no folder for damaged packs")?;
        Ok(Self { packs, hashed, folder })
    }

    /// Damages a pack and reads it as a server and its client do.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn judge(&self, seed: u64, case: u32) -> anyhow::Result<Verdict> {
        let subject = if self.hashed { Subject::HashedPacks } else { Subject::Packs };
        let mut random = subject.random(seed, case);
        let [(scene, pack), (_, other)] =
            [(); 2].map(|()| &self.packs[random.random_range(0..self.packs.len())]);
        let damaged = match self.hashed {
            true => damaged_behind_hashes(pack, other, &mut random),
            false => {
                let mut file = pack.clone();
                for _ in 0..damage::times(&mut random) {
                    damage::bytes(&mut file, other, &mut random);
                }
                file
            }
        };
        let path = self.folder.path().join(format!("{case}.lsp"));
        std::fs::write(&path, damaged).with_context(|| format!("{}: cannot be written", path.display()))?;
        let verdict = read(scene, &path);
        std::fs::remove_file(&path).with_context(|| format!("{}: cannot be removed", path.display()))?;
        Ok(verdict)
    }
}

/// A scene of one asset, with the light of another scene.
fn single_asset_scene(asset: &Asset, scene: &Scene) -> Scene {
    Scene {
        name: asset.name.clone(),
        assets: vec![asset.clone()],
        instances: Some(vec![Instance::at(0, [0.0; 3])]),
        models: Vec::new(),
        punctual_lights: Vec::new(),
        terrain: None,
        camera: None,
        ..scene.clone()
    }
}

/// Applies all readers of packs in the order of a server and its client. Later readers run even if earlier ones refused
/// the pack, since they must not panic either.
fn read(scene: &Scene, path: &Path) -> Verdict {
    let pack = match PackFile::open(path) {
        Ok(pack) => pack,
        Err(_) => return Verdict::refused("head and table"),
    };
    let mut why = pack.verify().is_err().then_some("hash of a blob");
    let loaded = pack.load();
    let decoded = loaded.as_ref().map(|asset| asset.refined(&asset.everything()).is_ok());
    why = why.or(match decoded {
        Ok(true) => None,
        Ok(false) => Some("chunk"),
        Err(_) => Some("base mesh, index or description"),
    });
    let _ = (pack.settings(), pack.verify_textures());
    let store = match lodestream_bake::compose::open(scene, vec![pack], &BlobCache::new(CACHE_BYTES)) {
        Ok(store) => store,
        Err(_) => return Verdict::refused(why.unwrap_or("description of the scene")),
    };
    let ended = stream(Arc::new(Immediate(store)), |_| {});
    why = why.or(match ended {
        Ok(Ended::Settled) => None,
        Ok(Ended::Never) => return Verdict::Stuck,
        Ok(Ended::Lacking) => Some("what a client finds wrong"),
        Ok(Ended::Closed(_)) | Err(_) => Some("what ends a client's session"),
    });
    why.map_or(Verdict::Taken, Verdict::refused)
}

/// An entry of the table, as it is encoded, with its blob.
#[derive(Clone)]
struct Blob {
    entry: [u8; ENTRY_BYTES],
    bytes: Vec<u8>,
}

/// Damages blobs and table, then corrects all hashes.
fn damaged_behind_hashes(pack: &[u8], other: &[u8], random: &mut Pcg64Mcg) -> Vec<u8> {
    let mut blobs = split_pack(pack);
    let others = split_pack(other);
    for _ in 0..damage::times(random) {
        let [a, b] = [(); 2].map(|()| chosen(&blobs, random));
        let foreign = &others[random.random_range(0..others.len())].bytes;
        match random.random_range(0..8) {
            0 if blobs.len() > 1 => {
                // Exchanges the contents of two entries.
                let moved = std::mem::take(&mut blobs[a].bytes);
                blobs[a].bytes = std::mem::replace(&mut blobs[b].bytes, moved);
            }
            1 => damage::order(&mut blobs, random),
            2 if !blobs.is_empty() => blobs[a].bytes.clone_from(foreign),
            _ if blobs.is_empty() => {}
            _ => damage_blob(&mut blobs[a].bytes, foreign, random),
        }
    }
    let mut file = assemble_pack(pack, &blobs);
    if random.random_range(0..4) == 0 && !blobs.is_empty() {
        // Kind, level, texture, index, offset or length of an entry.
        let entry = HEAD_BYTES + random.random_range(0..blobs.len()) * ENTRY_BYTES;
        let (at, width) = [(0, 1), (1, 1), (2, 2), (4, 4), (8, 8), (16, 4)][random.random_range(0..6)];
        let number = damage::extreme(random).to_le_bytes();
        file[entry + at..][..width].copy_from_slice(&number[..width]);
    }
    rehash(&mut file, blobs.len());
    file
}

/// Index of the blob to damage: a chunk in half of the cases, since chunks depend on most other blobs.
fn chosen(blobs: &[Blob], random: &mut Pcg64Mcg) -> usize {
    let any = random.random_range(0..blobs.len().max(1));
    let chunks = (0..blobs.len()).filter(|&n| blobs[n].entry[0] == CHUNK);
    let chunks: Vec<usize> = chunks.filter(|_| any % 2 == 0).collect();
    chunks.get(any % chunks.len().max(1)).copied().unwrap_or(any)
}

/// Damages the contents of a compressed blob, since its frame has checks of its own.
fn damage_blob(blob: &mut Vec<u8>, foreign: &[u8], random: &mut Pcg64Mcg) {
    match decompress(blob) {
        Ok(mut plain) if random.random_range(0..4) > 0 => {
            damage::bytes(&mut plain, foreign, random);
            *blob = compress(&plain).unwrap_or(plain);
        }
        _ => damage::bytes(blob, foreign, random),
    }
}

/// Splits a valid pack into its blobs.
fn split_pack(pack: &[u8]) -> Vec<Blob> {
    let blob = |at: usize| {
        let (offset, length) = (number(pack, at + OFFSET_AT, 8), number(pack, at + LENGTH_AT, 4));
        let mut entry = [0; ENTRY_BYTES];
        entry.copy_from_slice(&pack[at..at + ENTRY_BYTES]);
        Blob { entry, bytes: pack[offset..offset + length].to_vec() }
    };
    (0..number(pack, COUNT_AT, 4)).map(|n| blob(HEAD_BYTES + n * ENTRY_BYTES)).collect()
}

/// Assembles a pack from blobs; [`rehash`] corrects its hashes.
fn assemble_pack(head: &[u8], blobs: &[Blob]) -> Vec<u8> {
    let mut file = head[..HEAD_BYTES].to_vec();
    file[COUNT_AT..FINGERPRINT_AT].copy_from_slice(&(blobs.len() as u32).to_le_bytes());
    let mut offset = HEAD_BYTES + blobs.len() * ENTRY_BYTES;
    for blob in blobs {
        let mut entry = blob.entry;
        entry[OFFSET_AT..LENGTH_AT].copy_from_slice(&(offset as u64).to_le_bytes());
        entry[LENGTH_AT..ENTRY_HASH_AT].copy_from_slice(&(blob.bytes.len() as u32).to_le_bytes());
        file.extend(entry);
        offset += blob.bytes.len();
    }
    blobs.iter().for_each(|blob| file.extend(&blob.bytes));
    file
}

/// Corrects the hashes: of each blob whose entry lies within the file, and of head and table.
fn rehash(file: &mut [u8], count: usize) {
    for at in (0..count).map(|n| HEAD_BYTES + n * ENTRY_BYTES) {
        let (offset, length) = (number(file, at + OFFSET_AT, 8), number(file, at + LENGTH_AT, 4));
        let range = offset..offset.saturating_add(length);
        if let Some(hash) = file.get(range).map(blake3::hash) {
            file[at + ENTRY_HASH_AT..at + ENTRY_BYTES].copy_from_slice(&hash.as_bytes()[..16]);
        }
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(&file[FINGERPRINT_AT..HASH_AT]);
    hasher.update(&file[HEAD_BYTES..HEAD_BYTES + count * ENTRY_BYTES]);
    file[HASH_AT..HEAD_BYTES].copy_from_slice(&hasher.finalize().as_bytes()[..16]);
}

/// A little-endian number in the file.
fn number(file: &[u8], at: usize, width: usize) -> usize {
    file[at..at + width].iter().rev().fold(0, |number, byte| number << 8 | usize::from(*byte))
}
