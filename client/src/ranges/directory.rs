//! What is known of a published scene's layout.

use std::collections::BTreeMap;

use lodestream_geometry::index::CHUNKS_PER_PAGE;
use lodestream_scene::blob::{BlobId, BlobPart, PartBlob, PunctualLightBlob, TerrainBlob, Tile};
use lodestream_scene::description::AssetEntry;
use lodestream_scene::published::{
    AssetSource, Behind, BlobTable, ChunkTable, Head, Opening, PART_PAGES_PER_TABLE, PageRecord, Part,
    PartHash, PublishedError, SegmentHash, SourceRecord, TileTable, part_hash, segment_hash,
};
use lodestream_scene::punctual_lights::{LISTED_PER_PAGE, PunctualLights};
use lodestream_scene::terrain::PATCHES_PER_PAGE;

use super::request::Object;

/// What can be fetched and checked by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Item {
    /// A scene page.
    Page(u32),
    /// The packs of a scene page's assets.
    Source(u32),
    /// An index page of an asset, and the table of its chunks.
    Index(u32, u32),
    /// Texture regions of an asset, and the table of its tiles.
    TextureRegions(u32),
    /// Places of the height overrides of a page of the directory.
    TerrainTable(u32),
    /// Places of the pages of punctual lights of a page of the directory.
    LightTable(u32),
    /// Places of the pages of records of parts, of a table of the opening.
    PartTable(u32),
    /// Any other blob.
    Blob(BlobId),
}

impl Item {
    /// The item that brings a blob.
    pub(super) const fn of_blob(id: BlobId) -> Self {
        match id {
            BlobId::Asset { asset, part: BlobPart::IndexPage(page) } => Self::Index(asset, page),
            BlobId::Asset { asset, part: BlobPart::TextureRegions } => Self::TextureRegions(asset),
            id => Self::Blob(id),
        }
    }

    /// Whether it can lie in the published scene itself: chunks and tiles never do.
    pub(super) const fn may_be_in_scene(self) -> bool {
        !matches!(self, Self::Blob(BlobId::Asset { part: BlobPart::Chunk(_) | BlobPart::Tile(_), .. }))
    }

    /// The blob that it brings.
    pub(super) const fn blob(self) -> Option<BlobId> {
        match self {
            Self::Index(asset, page) => Some(BlobId::index_page(asset, page)),
            Self::TextureRegions(asset) => Some(BlobId::texture_regions(asset)),
            Self::Blob(id) => Some(id),
            Self::Page(_)
            | Self::Source(_)
            | Self::TerrainTable(_)
            | Self::LightTable(_)
            | Self::PartTable(_) => None,
        }
    }
}

/// Where an item lies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) object: Object,
    /// Where it begins in the object.
    pub(super) start: u64,
    /// Its length.
    pub(super) bytes: u32,
    /// Runs that are checked each by itself, without gaps.
    pub(super) segments: Vec<Segment>,
}

/// A run of an item that is checked by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Segment {
    /// Its bytes in the item.
    pub(super) start: u32,
    pub(super) end: u32,
    pub(super) hash: RunHash,
}

/// The hash of a run, by the two lengths that published scenes have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RunHash {
    Part(PartHash),
    Segment(SegmentHash),
}

impl Segment {
    /// Whether the bytes have the hash.
    pub(super) fn is_of(&self, bytes: &[u8]) -> bool {
        match self.hash {
            RunHash::Part(hash) => part_hash(bytes) == hash,
            RunHash::Segment(hash) => segment_hash(bytes) == hash,
        }
    }
}

impl Place {
    fn whole(object: Object, part: Part) -> Self {
        let segment = Segment { start: 0, end: part.bytes, hash: RunHash::Part(part.hash) };
        Self { object, start: part.offset, bytes: part.bytes, segments: vec![segment] }
    }
}

/// Where an item lies, or why that is not known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Location {
    At(Place),
    /// Another item tells it.
    Needs(Item),
    /// The scene has no such item.
    Nowhere,
}

/// Opening, records and tables that have arrived.
#[derive(Debug, Default)]
pub(super) struct Directory {
    opened: Option<(Head, Opening)>,
    pages: BTreeMap<u32, PageRecord>,
    sources: BTreeMap<u32, SourceRecord>,
    /// Scene page of each asset of the leading pages that have arrived.
    page_of_asset: Vec<u32>,
    chunks: BTreeMap<(u32, u32), ChunkTable>,
    tiles: BTreeMap<u32, TileTable>,
    terrain: BTreeMap<u32, BlobTable>,
    lights: BTreeMap<u32, BlobTable>,
    parts: BTreeMap<u32, BlobTable>,
}

impl Directory {
    pub(super) fn open(&mut self, head: Head, opening: Opening) {
        self.opened = Some((head, opening));
    }

    pub(super) fn opening(&self) -> Option<&Opening> {
        self.opened.as_ref().map(|(_, opening)| opening)
    }

    pub(super) fn head(&self) -> Option<&Head> {
        self.opened.as_ref().map(|(head, _)| head)
    }

    fn rest_bytes(&self) -> u64 {
        self.head().map_or(0, |head| head.object_bytes - head.parts_start())
    }

    pub(super) fn page(&self, number: u32) -> Option<&PageRecord> {
        self.pages.get(&number)
    }

    /// Adds a scene page.
    pub(super) fn add_page(&mut self, number: u32, bytes: &[u8]) -> Result<(), PublishedError> {
        let rest = self.rest_bytes();
        let Some(place) = self.opening().and_then(|opening| opening.pages.get(number as usize)) else {
            return Err(PublishedError::Contradiction("there is no such scene page"));
        };
        let record = PageRecord::decode_checked(bytes, number, &place.page, rest)?;
        self.pages.insert(number, record);
        Ok(())
    }

    /// Numbers the assets of page `number`, to which the pages before it have been numbered; `None` until it arrives.
    pub(super) fn next_in_order(&mut self, number: u32) -> Option<&PageRecord> {
        let record = self.pages.get(&number)?;
        self.page_of_asset.extend(std::iter::repeat_n(number, record.page.assets.len()));
        Some(record)
    }

    pub(super) fn add_source(&mut self, number: u32, bytes: &[u8]) -> Result<(), PublishedError> {
        let rest = self.rest_bytes();
        let place =
            self.opening().and_then(|opening| opening.pages.get(number as usize)).map(|place| place.source);
        let (Some(place), Some(page)) = (place, self.page(number)) else {
            return Err(PublishedError::Contradiction("a list of packs came before its scene page"));
        };
        let record = SourceRecord::decode_checked(bytes, &page.page, &place, rest)?;
        self.sources.insert(number, record);
        Ok(())
    }

    /// Adds the table of an index page's chunks; gives the length of the index page.
    pub(super) fn add_index(&mut self, asset: u32, page: u32, bytes: &[u8]) -> Result<usize, PublishedError> {
        let unknown = PublishedError::Contradiction("an index page came before its list of packs");
        let (entry, source) = self.entry(asset).zip(self.source(asset)).ok_or(unknown.clone())?;
        let place = source.index.get(page as usize).ok_or(unknown)?;
        let (index, table) = place.split(bytes, (entry, page), source.pack_bytes)?;
        let length = index.len();
        self.chunks.insert((asset, page), table);
        Ok(length)
    }

    /// Adds the table of an asset's tiles; gives the length of the texture regions before it.
    pub(super) fn add_tiles(&mut self, asset: u32, bytes: &[u8]) -> Result<usize, PublishedError> {
        let unknown = PublishedError::Contradiction("texture regions came before their list of packs");
        let source = self.source(asset).ok_or(unknown.clone())?;
        let (regions, table) = source.tiles.ok_or(unknown)?.split_tiles(bytes, source.pack_bytes)?;
        let length = regions.len();
        self.tiles.insert(asset, table);
        Ok(length)
    }

    pub(super) fn add_terrain_table(&mut self, page: u32, bytes: &[u8]) -> Result<(), PublishedError> {
        let terrain = self.opening().and_then(|opening| opening.header.terrain.as_ref());
        let patches = terrain.map_or(0, |terrain| terrain.patches);
        let count = patches.saturating_sub(page.saturating_mul(PATCHES_PER_PAGE)).min(PATCHES_PER_PAGE);
        let table = BlobTable::decode_checked(bytes, count as usize, self.rest_bytes())?;
        self.terrain.insert(page, table);
        Ok(())
    }

    pub(super) fn add_light_table(&mut self, page: u32, bytes: &[u8]) -> Result<(), PublishedError> {
        let count = self.opening().map_or(0, |opening| opening.light_count);
        let most = PunctualLights::on_directory_page(count, page);
        let table = BlobTable::decode_checked(bytes, most as usize, self.rest_bytes())?;
        self.lights.insert(page, table);
        Ok(())
    }

    pub(super) fn add_part_table(&mut self, number: u32, bytes: &[u8]) -> Result<(), PublishedError> {
        let count = self.opening().map_or(0, |opening| opening.parts.in_table(number));
        let table = BlobTable::decode_checked(bytes, count as usize, self.rest_bytes())?;
        self.parts.insert(number, table);
        Ok(())
    }

    fn entry(&self, asset: u32) -> Option<&AssetEntry> {
        let page = &self.page(*self.page_of_asset.get(asset as usize)?)?.page;
        page.assets.get((asset - page.first_asset) as usize)
    }

    /// Scene page of an asset, and its number there.
    fn on_page(&self, asset: u32) -> Option<(u32, usize)> {
        let number = *self.page_of_asset.get(asset as usize)?;
        Some((number, (asset - self.page(number)?.page.first_asset) as usize))
    }

    pub(super) fn source(&self, asset: u32) -> Option<&AssetSource> {
        let (number, at) = self.on_page(asset)?;
        self.sources.get(&number)?.assets.get(at)
    }

    /// What follows a scene page's list of packs: coarse textures and index pages.
    pub(super) fn behind_source(&self, number: u32) -> Vec<Item> {
        let place = self.opening().and_then(|opening| opening.pages.get(number as usize));
        let (Some(place), Some(page), Some(source)) = (place, self.page(number), self.sources.get(&number))
        else {
            return Vec::new();
        };
        let item = |(at, behind, _)| {
            let asset = page.page.first_asset + u32::try_from(at).unwrap_or(0);
            match behind {
                Behind::Texture(place) => {
                    Some(Item::Blob(BlobId::texture(asset, place.texture, place.level)))
                }
                Behind::Index(page, _) => Some(Item::Index(asset, page)),
                Behind::Tiles(_) => None,
            }
        };
        source.behind(&place.source).filter_map(item).collect()
    }

    /// Where an item lies.
    pub(super) fn locate(&self, item: Item) -> Location {
        let Some((head, opening)) = &self.opened else { return Location::Nowhere };
        let scene = |part: Part| {
            let offset = part.offset.saturating_add(head.parts_start());
            Location::At(Place::whole(Object::Scene, Part { offset, ..part }))
        };
        let listed = |parts: &[Part], number: u32| {
            parts.get(number as usize).map_or(Location::Nowhere, |part| scene(*part))
        };
        match item {
            Item::Page(number) => {
                opening.pages.get(number as usize).map_or(Location::Nowhere, |place| scene(place.page))
            }
            Item::Source(number) => {
                opening.pages.get(number as usize).map_or(Location::Nowhere, |place| scene(place.source))
            }
            Item::TerrainTable(page) => listed(&opening.terrain_tables, page),
            Item::LightTable(page) => listed(&opening.light_tables, page),
            Item::PartTable(number) => listed(&opening.parts.tables, number),
            Item::Index(asset, page) => self
                .locate_behind(asset, |behind| matches!(behind, Behind::Index(number, _) if number == page)),
            Item::TextureRegions(asset) => {
                self.locate_behind(asset, |behind| matches!(behind, Behind::Tiles(_)))
            }
            Item::Blob(BlobId::Terrain(TerrainBlob::DirectoryPage(page))) => {
                listed(&opening.terrain_directory, page)
            }
            Item::Blob(BlobId::Terrain(TerrainBlob::HeightOverrides(patch))) => {
                let (page, at) = (patch / PATCHES_PER_PAGE, patch % PATCHES_PER_PAGE);
                match self.terrain.get(&page) {
                    Some(table) => table.part(at as usize).map_or(Location::Nowhere, scene),
                    None => Location::Needs(Item::TerrainTable(page)),
                }
            }
            Item::Blob(BlobId::PunctualLights(PunctualLightBlob::DirectoryPage(page))) => {
                listed(&opening.light_directory, page)
            }
            Item::Blob(BlobId::PunctualLights(PunctualLightBlob::Page(number))) => {
                let (page, at) = (number / LISTED_PER_PAGE, number % LISTED_PER_PAGE);
                match self.lights.get(&page) {
                    Some(table) => table.part(at as usize).map_or(Location::Nowhere, scene),
                    None => Location::Needs(Item::LightTable(page)),
                }
            }
            Item::Blob(BlobId::Parts(PartBlob::DirectoryPage(page))) => {
                listed(&opening.parts.directory, page)
            }
            Item::Blob(BlobId::Parts(PartBlob::Page(number))) => {
                let (table, at) = (number / PART_PAGES_PER_TABLE, number % PART_PAGES_PER_TABLE);
                match self.parts.get(&table) {
                    Some(table) => table.part(at as usize).map_or(Location::Nowhere, scene),
                    None => Location::Needs(Item::PartTable(table)),
                }
            }
            Item::Blob(BlobId::Animation(model)) => listed(&opening.animations, model),
            Item::Blob(BlobId::Asset { asset, part }) => match part {
                BlobPart::Base => self.on_page(asset).map_or(Location::Nowhere, |(number, at)| {
                    let (place, record) = (&opening.pages[number as usize], self.page(number));
                    let base = record.and_then(|record| record.bases(&place.page).nth(at));
                    base.map_or(Location::Nowhere, scene)
                }),
                BlobPart::IndexPage(page) => self.locate(Item::Index(asset, page)),
                BlobPart::Chunk(chunk) => self.locate_chunk(asset, chunk),
                BlobPart::TextureRegions => self.locate(Item::TextureRegions(asset)),
                BlobPart::Tile(tile) => self.locate_tile(asset, tile),
                BlobPart::Texture { texture, level } => {
                    let copy = self.locate_behind(asset, |behind| {
                        matches!(behind, Behind::Texture(place) if (place.texture, place.level) == (texture, level))
                    });
                    let source = self.source(asset).filter(|_| copy == Location::Nowhere);
                    source.and_then(|source| Some((source, source.texture(texture, level)?))).map_or(
                        copy,
                        |(source, part)| {
                            Location::At(Place::whole(Object::Pack(source.key, source.pack_bytes), part))
                        },
                    )
                }
            },
        }
    }

    /// Where something lies that follows an asset's list of packs.
    fn locate_behind(&self, asset: u32, is_it: impl Fn(Behind) -> bool) -> Location {
        let Some((number, at)) = self.on_page(asset) else { return Location::Nowhere };
        let Some((head, opening)) = &self.opened else { return Location::Nowhere };
        match (opening.pages.get(number as usize), self.sources.get(&number)) {
            (Some(place), Some(record)) => {
                let mut behind = record.behind(&place.source);
                let found = behind.find(|(of, behind, _)| *of == at && is_it(*behind));
                found.map_or(Location::Nowhere, |(_, _, part)| {
                    let offset = part.offset.saturating_add(head.parts_start());
                    Location::At(Place::whole(Object::Scene, Part { offset, ..part }))
                })
            }
            _ => Location::Needs(Item::Source(number)),
        }
    }

    fn locate_tile(&self, asset: u32, tile: Tile) -> Location {
        let Some(table) = self.tiles.get(&asset) else {
            return match self.source(asset) {
                Some(AssetSource { tiles: None, .. }) => Location::Nowhere,
                _ => Location::Needs(Item::TextureRegions(asset)),
            };
        };
        let Some((source, (start, place))) = self.source(asset).zip(table.tile(tile)) else {
            return Location::Nowhere;
        };
        let segment = Segment { start: 0, end: place.bytes, hash: RunHash::Segment(place.hash) };
        let object = Object::Pack(source.key, source.pack_bytes);
        Location::At(Place { object, start, bytes: place.bytes, segments: vec![segment] })
    }

    fn locate_chunk(&self, asset: u32, chunk: u32) -> Location {
        let (page, at) = (chunk / CHUNKS_PER_PAGE as u32, chunk as usize % CHUNKS_PER_PAGE);
        let Some(table) = self.chunks.get(&(asset, page)) else {
            return match self.entry(asset) {
                Some(entry) if page < entry.index_pages() => Location::Needs(Item::Index(asset, page)),
                _ => Location::Nowhere,
            };
        };
        let Some((source, (start, place))) = self.source(asset).zip(table.chunk(at)) else {
            return Location::Nowhere;
        };
        Location::At(Place {
            object: Object::Pack(source.key, source.pack_bytes),
            start,
            bytes: place.bytes,
            segments: place
                .segments()
                .map(|(start, end, hash)| Segment { start, end, hash: RunHash::Segment(hash) })
                .collect(),
        })
    }
}
