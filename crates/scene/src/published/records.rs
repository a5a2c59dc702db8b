//! Records of one scene page: the page with its base meshes, and the packs of its assets. What a record lists lies behind
//! it, so that lengths suffice.

use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};

use super::PublishedError;
use super::part::{Part, PartHash};
use super::tables::{ChunkHashes, ChunkTable, TileTable};
use crate::description::{AssetEntry, ScenePage};
use crate::encoding::{self, CodingError, Decode, encode_fields};
use crate::limits::{MAX_BLOB_BYTES, MAX_DECODED_BYTES};

/// Memory that a decoded record may take for each of its bytes.
const MEMORY_PER_BYTE: usize = 16;

fn decode<T: Decode>(bytes: &[u8], what: &'static str) -> Result<T, PublishedError> {
    let limit = MAX_DECODED_BYTES.saturating_add(bytes.len().saturating_mul(MEMORY_PER_BYTE));
    encoding::decode(bytes, limit).map_err(|why| PublishedError::Record { what, why })
}

/// A scene page. The base meshes of its assets follow, in order, with the lengths that the page states.
#[derive(Clone, Debug, PartialEq)]
pub struct PageRecord {
    /// The page.
    pub page: ScenePage,
    /// Hashes of its assets' base meshes.
    pub bases: Vec<PartHash>,
}

encode_fields!(PageRecord { page, bases });

impl PageRecord {
    /// Decodes the record of page `number` from the bytes of `part`; the parts of the published scene have `rest_bytes`
    /// together.
    ///
    /// # Errors
    /// Bytes that are no such record.
    pub fn decode_checked(
        bytes: &[u8],
        number: u32,
        part: &Part,
        rest_bytes: u64,
    ) -> Result<Self, PublishedError> {
        let what = "a scene page";
        let record: Self = decode(bytes, what)?;
        let ScenePage { page, assets, .. } = &record.page;
        record.page.check().map_err(|why| PublishedError::Record { what, why: CodingError::value(why) })?;
        let end = assets.iter().fold(part.end(), |end, asset| end.saturating_add(asset.base_bytes.into()));
        if *page != number || record.bases.len() != assets.len() || end > rest_bytes {
            return Err(PublishedError::Contradiction("a scene page is another than its place states"));
        }
        Ok(record)
    }

    /// Places of the base meshes of this page, whose record is `part`.
    pub fn bases(&self, part: &Part) -> impl Iterator<Item = Part> {
        let lengths = self.page.assets.iter().map(|asset| asset.base_bytes);
        adjacent(part.end(), lengths.zip(self.bases.iter().copied()))
    }
}

/// Parts that follow one another from `start` on.
fn adjacent(start: u64, parts: impl Iterator<Item = (u32, PartHash)>) -> impl Iterator<Item = Part> {
    parts.scan(start, |next, (bytes, hash)| {
        let part = Part { offset: *next, bytes, hash };
        *next = part.end();
        Some(part)
    })
}

/// An index page with the table of its chunks behind it, or texture regions with the table of tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IndexPlace {
    /// Length of both.
    pub bytes: u32,
    /// Length of the first.
    pub index_bytes: u32,
    /// Hash of both.
    pub hash: PartHash,
}

encode_fields!(IndexPlace { bytes, index_bytes, hash });

impl IndexPlace {
    /// Splits verified bytes into texture regions and the table of tiles.
    ///
    /// # Errors
    /// Bytes that are no such table.
    pub fn split_tiles<'a>(
        &self,
        bytes: &'a [u8],
        pack_bytes: u64,
    ) -> Result<(&'a [u8], TileTable), PublishedError> {
        let what = "texture regions";
        let (regions, table) =
            bytes.split_at_checked(self.index_bytes as usize).ok_or(PublishedError::Truncated(what))?;
        let table: TileTable = encoding::decode(table, 1024 + 16 * table.len())
            .map_err(|why| PublishedError::Record { what, why })?;
        let short =
            table.levels.iter().flat_map(|level| &level.tiles).all(|tile| tile.bytes <= MAX_BLOB_BYTES);
        if short && table.end() <= pack_bytes {
            Ok((regions, table))
        } else {
            Err(PublishedError::Contradiction("a table of tiles does not fit its pack"))
        }
    }

    /// Splits verified bytes into index page `page` of an asset and the table of its chunks.
    ///
    /// # Errors
    /// Bytes that are no such table.
    pub fn split<'a>(
        &self,
        bytes: &'a [u8],
        (asset, page): (&AssetEntry, u32),
        pack_bytes: u64,
    ) -> Result<(&'a [u8], ChunkTable), PublishedError> {
        let what = "an index page";
        let (index, hashes) =
            bytes.split_at_checked(self.index_bytes as usize).ok_or(PublishedError::Truncated(what))?;
        let hashes: ChunkHashes = decode(hashes, what)?;
        let per_page = u32::try_from(CHUNKS_PER_PAGE).unwrap_or(u32::MAX);
        let first = page.saturating_mul(per_page);
        let decoded = decode_stated_page(index, first)
            .map_err(|why| PublishedError::Record { what, why: CodingError::value(why) })?;
        let count = asset.chunk_count.saturating_sub(first).min(per_page);
        ChunkTable::new(&decoded.chunks, &hashes)
            .filter(|table| table.chunks.len() == count as usize && table.end() <= pack_bytes)
            .map(|table| (index, table))
            .ok_or(PublishedError::Contradiction("an index page does not fit its pack"))
    }
}

/// A level of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexturePlace {
    /// Number of the texture.
    pub texture: u16,
    /// Number of the level, 0 for the coarsest.
    pub level: u8,
    /// Its length.
    pub bytes: u32,
    /// Its hash.
    pub hash: PartHash,
}

encode_fields!(TexturePlace { texture, level, bytes, hash });

/// The pack of an asset, and where its blobs lie.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssetSource {
    /// Key in the pack's name ([`pack_name`]).
    pub key: [u8; 32],
    /// Length of the pack.
    pub pack_bytes: u64,
    /// Where the first level of a texture begins in the pack.
    pub textures_offset: u64,
    /// Levels of textures, adjacent in the pack.
    pub textures: Vec<TexturePlace>,
    /// Short levels of textures of which the published scene has a copy.
    pub coarse: Vec<TexturePlace>,
    /// Index pages, in the published scene.
    pub index: Vec<IndexPlace>,
    /// Texture regions with the table of tiles behind them, in the published scene; none if no level is cut.
    pub tiles: Option<IndexPlace>,
}

encode_fields!(AssetSource { key, pack_bytes, textures_offset, textures, coarse, index, tiles });

impl AssetSource {
    /// Place of a level of a texture in the pack.
    #[must_use]
    pub fn texture(&self, texture: u16, level: u8) -> Option<Part> {
        let at = self.textures.iter().position(|place| (place.texture, place.level) == (texture, level))?;
        let parts = self.textures.iter().map(|place| (place.bytes, place.hash));
        adjacent(self.textures_offset, parts).nth(at)
    }
}

/// Name of a pack's object, relative to the published scene: `packs/KEY.lsp`, with the key in hexadecimal.
#[must_use]
pub fn pack_name(key: &[u8; 32]) -> String {
    format!("packs/{}.lsp", blake3::Hash::from_bytes(*key).to_hex())
}

/// The packs of a scene page's assets, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceRecord {
    /// One for each asset of the page.
    pub assets: Vec<AssetSource>,
}

encode_fields!(SourceRecord { assets });

impl SourceRecord {
    /// Decodes the record that belongs to a page from the bytes of `part`.
    ///
    /// # Errors
    /// Bytes that are no such record.
    pub fn decode_checked(
        bytes: &[u8],
        page: &ScenePage,
        part: &Part,
        rest_bytes: u64,
    ) -> Result<Self, PublishedError> {
        let record: Self = decode(bytes, "a list of packs")?;
        let fits = |(source, pages): (&AssetSource, u32)| {
            let lengths = source.textures.iter().map(|place| u64::from(place.bytes));
            let textures_end = lengths.fold(source.textures_offset, u64::saturating_add);
            source.index.len() == pages as usize
                && source.index.iter().chain(&source.tiles).all(|place| place.index_bytes <= place.bytes)
                && source.textures.iter().chain(&source.coarse).all(|place| place.bytes <= MAX_BLOB_BYTES)
                && textures_end <= source.pack_bytes
        };
        let pages = page.assets.iter().map(AssetEntry::index_pages);
        let end = record.behind(part).last().map_or(part.end(), |(_, _, last)| last.end());
        if record.assets.len() != page.assets.len()
            || !record.assets.iter().zip(pages).all(fits)
            || end > rest_bytes
        {
            return Err(PublishedError::Contradiction("a list of packs does not fit its scene page"));
        }
        Ok(record)
    }

    /// What follows the record, which is `part`: copies of textures, then index pages, the first of all assets first,
    /// since they have the coarsest chunks, then texture regions. Each with the number of its asset on the page.
    pub fn behind(&self, part: &Part) -> impl Iterator<Item = (usize, Behind, Part)> {
        let assets = || self.assets.iter().enumerate();
        let copies = assets().flat_map(|(asset, source)| {
            source.coarse.iter().map(move |place| (asset, Behind::Texture(*place), place.bytes, place.hash))
        });
        let most = self.assets.iter().map(|source| source.index.len()).max().unwrap_or(0);
        let pages = (0..most).flat_map(move |page| {
            assets().filter_map(move |(asset, source)| {
                let place = source.index.get(page)?;
                let number = u32::try_from(page).unwrap_or(u32::MAX);
                Some((asset, Behind::Index(number, *place), place.bytes, place.hash))
            })
        });
        let tiles = assets().filter_map(|(asset, source)| {
            let place = source.tiles?;
            Some((asset, Behind::Tiles(place), place.bytes, place.hash))
        });
        copies.chain(pages).chain(tiles).scan(part.end(), |next, (asset, behind, bytes, hash)| {
            let part = Part { offset: *next, bytes, hash };
            *next = part.end();
            Some((asset, behind, part))
        })
    }
}

/// Something that follows a list of packs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behind {
    /// A copy of a level of a texture.
    Texture(TexturePlace),
    /// An index page of this number, with the hashes of its chunks.
    Index(u32, IndexPlace),
    /// Texture regions with the table of tiles.
    Tiles(IndexPlace),
}
