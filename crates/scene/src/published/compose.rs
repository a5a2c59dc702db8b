//! Collects what a published scene holds of a pack, blob by blob in the pack's order.

use bytes::Bytes;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};

use super::PublishedError;
use super::contents::{IndexPage, PackContents, Texture};
use super::part::part_hash;
use super::records::TexturePlace;
use super::tables::{ChunkPlace, ChunkTable, TileLevel, TilePlace, segment_hash};
use crate::blob::Tile;
use crate::encoding::CodingError;

/// Longest texture level that the published scene has a copy of, in bytes: the coarsest of most textures.
const MAX_COPY_BYTES: u32 = 2048;
/// Coarse levels of a texture that it may have a copy of.
const COPIED_LEVELS: u8 = 2;

impl PackContents {
    /// Adds the next index page.
    ///
    /// # Errors
    /// A page that does not decode.
    pub fn add_index_page(&mut self, bytes: Bytes) -> Result<(), PublishedError> {
        let first = u32::try_from(self.index.len() * CHUNKS_PER_PAGE).map_err(|_| PublishedError::TooLong)?;
        let index = decode_stated_page(&bytes, first)
            .map_err(|why| PublishedError::Record { what: "an index page", why: CodingError::value(why) })?;
        let chunks = index.chunks.iter().map(ChunkPlace::of).collect();
        self.index.push(IndexPage { bytes, chunks: ChunkTable { offset: 0, chunks } });
        Ok(())
    }

    /// Adds the hashes of a chunk that begins at `offset` in the pack; its index page was added before.
    ///
    /// # Errors
    /// A chunk that does not follow the one before it on its page, or has another length than the page states.
    pub fn add_chunk(&mut self, chunk: u32, offset: u64, bytes: &[u8]) -> Result<(), PublishedError> {
        let other =
            PublishedError::Contradiction("a chunk is not where, or not as long as, its index page says");
        let (page, at) = (chunk as usize / CHUNKS_PER_PAGE, chunk as usize % CHUNKS_PER_PAGE);
        let table = self.index.get_mut(page).map(|index| &mut index.chunks).ok_or(other.clone())?;
        if at == 0 {
            table.offset = offset;
        }
        let hashed =
            table.chunk(at).filter(|(start, _)| *start == offset).and_then(|(_, place)| place.hashed(bytes));
        match (table.chunks.get_mut(at), hashed) {
            (Some(place), Some(hashed)) => *place = hashed,
            _ => return Err(other),
        }
        Ok(())
    }

    /// Adds the next level of a texture, which begins at `offset` in the pack.
    ///
    /// # Errors
    /// A level that does not follow the one before it.
    pub fn add_texture(
        &mut self,
        texture: u16,
        level: u8,
        offset: u64,
        bytes: Bytes,
    ) -> Result<(), PublishedError> {
        if self.textures.is_empty() {
            self.textures_offset = offset;
        }
        let before: u64 = self.textures.iter().map(|texture| u64::from(texture.place.bytes)).sum();
        if self.textures_offset.checked_add(before) != Some(offset) {
            return Err(PublishedError::Contradiction("a pack's textures are not adjacent"));
        }
        let length = u32::try_from(bytes.len()).map_err(|_| PublishedError::TooLong)?;
        let place = TexturePlace { texture, level, bytes: length, hash: part_hash(&bytes) };
        let copied = level < COPIED_LEVELS && length <= MAX_COPY_BYTES;
        self.textures.push(Texture { place, copy: copied.then_some(bytes) });
        Ok(())
    }

    /// Adds the texture regions.
    pub fn add_texture_regions(&mut self, bytes: Bytes) {
        self.tiles.get_or_insert_default().regions = bytes;
    }

    /// Adds the next tile, which begins at `offset` in the pack.
    ///
    /// # Errors
    /// A tile that does not follow the one before it.
    pub fn add_tile(&mut self, tile: Tile, offset: u64, bytes: &[u8]) -> Result<(), PublishedError> {
        let table = &mut self.tiles.get_or_insert_default().table;
        if table.levels.is_empty() {
            table.offset = offset;
        }
        let begins = table.end() == offset;
        let level = (tile.texture, tile.level);
        if table.levels.last().is_none_or(|last| (last.texture, last.level) != level) {
            table.levels.push(TileLevel { texture: tile.texture, level: tile.level, tiles: Vec::new() });
        }
        let tiles = table.levels.last_mut().map(|last| &mut last.tiles);
        let Some(tiles) = tiles.filter(|tiles| begins && tiles.len() == usize::from(tile.tile)) else {
            return Err(PublishedError::Contradiction("a pack's tiles are not adjacent"));
        };
        let length = u32::try_from(bytes.len()).map_err(|_| PublishedError::TooLong)?;
        tiles.push(TilePlace { bytes: length, hash: segment_hash(bytes) });
        Ok(())
    }
}
