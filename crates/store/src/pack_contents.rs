//! What a published scene holds of a pack: base mesh, index pages, short textures, and where the rest lies.

use lodestream_geometry::DecodeError;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};
use lodestream_geometry::pack::{BlobKind, Entry};
use lodestream_scene::BlobPart;
use lodestream_scene::published::{
    ChunkPlace, ChunkTable, IndexPage, PackContents, Texture, TexturePlace, part_hash,
};

use super::error::StoreError;
use super::file::PackFile;

/// Longest texture level that the published scene has a copy of: the coarsest of most textures.
const MAX_COPY_BYTES: u32 = 2048;
/// Coarse levels of a texture that it may have a copy of.
const COPIED_LEVELS: u8 = 2;

impl PackFile {
    /// What a published scene holds of this pack. Reads all of it once. `key` is in the name of the pack's object.
    ///
    /// # Errors
    /// A blob that is missing, unreadable or damaged.
    pub fn published(&self, key: [u8; 32]) -> Result<PackContents, StoreError> {
        let scattered = || self.damaged(DecodeError::new("pack", "its chunks or textures are not adjacent"));
        let mut contents = PackContents {
            key,
            bytes: self.total_bytes(),
            base: self.read(BlobPart::Base)?,
            ..Default::default()
        };
        let mut end = None;
        for entry in self.entries() {
            let adjacent = end.is_none_or(|end| end == entry.offset);
            match entry.kind {
                BlobKind::Base | BlobKind::Settings => {}
                BlobKind::IndexPage(page) => contents.index.push(self.index_page(page)?),
                BlobKind::Chunk(chunk) => {
                    let (page, at) = (chunk as usize / CHUNKS_PER_PAGE, chunk as usize % CHUNKS_PER_PAGE);
                    let table = contents.index.get_mut(page).map(|index| &mut index.chunks);
                    let place = table.ok_or_else(scattered)?;
                    if at == 0 {
                        place.offset = entry.offset;
                    }
                    let place = place.chunks.get_mut(at).filter(|_| adjacent).ok_or_else(scattered)?;
                    *place = self.hashed(entry, *place)?;
                }
                BlobKind::Texture { texture, level } => {
                    match contents.textures.is_empty() {
                        true => contents.textures_offset = entry.offset,
                        false if adjacent => {}
                        false => return Err(scattered()),
                    }
                    let bytes = self.read_entry(entry)?;
                    let place = TexturePlace { texture, level, bytes: entry.length, hash: part_hash(&bytes) };
                    let copied = level < COPIED_LEVELS && entry.length <= MAX_COPY_BYTES;
                    contents.textures.push(Texture { place, copy: copied.then(|| bytes.into()) });
                }
            }
            end = matches!(entry.kind, BlobKind::Chunk(_) | BlobKind::Texture { .. })
                .then(|| entry.offset + u64::from(entry.length));
        }
        Ok(contents)
    }

    /// An index page, and its chunks without hashes.
    fn index_page(&self, page: u32) -> Result<IndexPage, StoreError> {
        let bytes = self.read(BlobPart::IndexPage(page))?;
        let first = page.saturating_mul(u32::try_from(CHUNKS_PER_PAGE).unwrap_or(u32::MAX));
        let index = decode_stated_page(&bytes, first).map_err(|why| self.damaged(why))?;
        let places = index.chunks.iter().map(ChunkPlace::of);
        Ok(IndexPage { bytes, chunks: ChunkTable { offset: 0, chunks: places.collect() } })
    }

    fn hashed(&self, entry: &Entry, place: ChunkPlace) -> Result<ChunkPlace, StoreError> {
        let other =
            || self.damaged(DecodeError::new("pack", "a chunk is not as long as its index page says"));
        place.hashed(&self.read_entry(entry)?).ok_or_else(other)
    }
}
