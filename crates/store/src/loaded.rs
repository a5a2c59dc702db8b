//! A whole asset in memory, for inspection, checks and export.

use lodestream_compress::plain_chunk;
use lodestream_geometry::DecodeError;
use lodestream_geometry::ancestor_closed_cut::Member;
use lodestream_geometry::base::Base;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, decode_page, page_count};
use lodestream_geometry::pack::{BlobKind, find};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_scene::BlobPart;
use lodestream_scene::asset::AssetDescription;

use super::error::StoreError;
use super::file::PackFile;

/// The geometry and description of a pack.
#[derive(Clone, Debug)]
pub struct LoadedAsset {
    /// The base mesh.
    pub base: Base,
    /// Materials and textures.
    pub description: AssetDescription,
    /// The index.
    pub infos: Vec<ChunkInfo>,
    /// Payloads, by chunk, as the codec reads them: decompressed where the pack compresses them.
    pub chunks: Vec<Vec<u8>>,
    /// Length of all chunks as they are stored.
    pub payload_bytes: u64,
    /// Length of the base blob.
    pub base_bytes: u64,
    /// Length of all index pages.
    pub index_bytes: u64,
}

impl PackFile {
    /// Reads the pack's whole geometry.
    ///
    /// # Errors
    /// Missing, damaged or contradictory blobs.
    pub fn load(&self) -> Result<LoadedAsset, StoreError> {
        let base = self.base()?;
        let wrong = |what: &str, why: String| self.damaged(DecodeError::new(what, why));
        let description = AssetDescription::decode(&base.description)
            .map_err(|error| wrong("description", error.to_string()))?;
        let count = base.chunk_count as usize;
        let mut infos = Vec::new();
        let mut index_bytes = 0;
        for page in 0..page_count(count) as u32 {
            let blob = self.read(BlobPart::IndexPage(page))?;
            index_bytes += blob.len() as u64;
            let first = page * CHUNKS_PER_PAGE as u32;
            infos.extend(decode_page(&blob, first).map_err(|source| self.damaged(source))?);
        }
        if infos.len() != count {
            return Err(wrong("index", format!("{} chunks, but the base mesh says {count}", infos.len())));
        }
        let mut payload_bytes = 0;
        let mut chunks = Vec::with_capacity(infos.len());
        for (chunk, info) in (0..).zip(&infos) {
            let blob = self.read(BlobPart::Chunk(chunk))?;
            let what = || format!("chunk {chunk}");
            if blob.len() != info.payload_bytes as usize {
                let why = format!("{} bytes, but the index says {}", blob.len(), info.payload_bytes);
                return Err(wrong(&what(), why));
            }
            payload_bytes += blob.len() as u64;
            let plain = plain_chunk(base.codec, &blob).map_err(|e| wrong(&what(), e.to_string()))?;
            chunks.push(plain.into_owned());
        }
        let base_bytes = self.blob_len(BlobPart::Base).map_or(0, u64::from);
        Ok(LoadedAsset { base, description, infos, chunks, payload_bytes, base_bytes, index_bytes })
    }

    /// Preparation settings as text; empty if the pack has none.
    ///
    /// # Errors
    /// Damage.
    pub fn settings(&self) -> Result<String, StoreError> {
        match find(self.entries(), BlobKind::Settings) {
            Some(entry) => Ok(String::from_utf8_lossy(&self.read_entry(entry)?).into_owned()),
            None => Ok(String::new()),
        }
    }

    /// Number of texture levels and tiles that differ from the given ones (by texture and level, coarse first).
    ///
    /// # Errors
    /// A damaged image.
    pub fn differing_textures(&self, textures: &[Vec<Vec<Vec<u8>>>]) -> Result<usize, StoreError> {
        let mut differing = 0;
        let mut held = 0;
        for entry in self.entries() {
            let (texture, level, tile) = match entry.kind {
                BlobKind::Texture { texture, level } => (texture, level, 0),
                BlobKind::Tile { texture, level, tile } => (texture, level, tile),
                _ => continue,
            };
            held += 1;
            let wanted = textures.get(usize::from(texture)).and_then(|t| t.get(usize::from(level)));
            let wanted = wanted.and_then(|images| images.get(usize::from(tile)));
            differing += usize::from(wanted != Some(&self.read_entry(entry)?));
        }
        let all = textures.iter().flatten().map(Vec::len).sum::<usize>();
        Ok(differing + all.saturating_sub(held))
    }

    /// Reads every texture level and tile, which checks its hash, and returns their length.
    ///
    /// # Errors
    /// A damaged image.
    pub fn verify_textures(&self) -> Result<u64, StoreError> {
        let mut total = 0;
        for entry in self
            .entries()
            .iter()
            .filter(|e| matches!(e.kind, BlobKind::Texture { .. } | BlobKind::Tile { .. }))
        {
            total += self.read_entry(entry)?.len() as u64;
        }
        Ok(total)
    }
}

impl LoadedAsset {
    /// Bytes that every client needs: base mesh and index.
    #[must_use]
    pub fn head_bytes(&self) -> u64 {
        self.base_bytes + self.index_bytes
    }

    /// All chunks, whole.
    #[must_use]
    pub fn everything(&self) -> Vec<Member> {
        (0..self.base.chunk_count).map(|chunk| Member { chunk, truncation: None }).collect()
    }

    /// The mesh of an ancestor-closed cut of chunks, given in an order that respects parents.
    ///
    /// # Errors
    /// A chunk that cannot be decoded or applied.
    pub fn refined(&self, set: &[Member]) -> Result<ActiveMesh, DecodeError> {
        let mut mesh = ActiveMesh::growing(&self.base);
        for &Member { chunk: id, truncation } in set {
            let missing = || DecodeError::new(format!("chunk {id}"), "there is no such chunk");
            let info = self.infos.get(id as usize).ok_or_else(missing)?;
            let payload = self.chunks.get(id as usize).ok_or_else(missing)?;
            let delta = mesh.decode_prefix(id, info, truncation, payload)?;
            mesh.apply(&delta).map_err(|e| DecodeError::new(format!("chunk {id}"), e.to_string()))?;
        }
        Ok(mesh)
    }

    /// Names of the materials, by number.
    #[must_use]
    pub fn material_names(&self) -> Vec<String> {
        self.description.materials.iter().map(|m| m.name.clone()).collect()
    }
}
