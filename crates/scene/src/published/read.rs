//! Reads a published scene whole, as a daemon does.

use bytes::Bytes;

use super::contents::{Contents, IndexPage, PackContents, Texture, Tiles};
use super::opening::{HEAD_BYTES, Head};
use super::part::Part;
use super::records::{AssetSource, Behind, PageRecord, SourceRecord};
use super::tables::BlobTable;
use super::{MAX_OBJECT_BYTES, PublishedError};
use crate::encoding;
use crate::proxy::Proxies;
use crate::punctual_lights::PunctualLights;

impl BlobTable {
    /// Decodes a table of `count` blobs that lie within `rest_bytes`.
    ///
    /// # Errors
    /// Bytes that are no such table.
    pub fn decode_checked(bytes: &[u8], count: usize, rest_bytes: u64) -> Result<Self, PublishedError> {
        let what = "a table of blobs";
        let table: Self = encoding::decode(bytes, 1024 + 4 * bytes.len())
            .map_err(|why| PublishedError::Record { what, why })?;
        if table.blobs.len() != count || table.end() > rest_bytes {
            return Err(PublishedError::Contradiction("a table of blobs does not fit its directory"));
        }
        Ok(table)
    }
}

impl Contents {
    /// Decodes and checks an object. Reserves no more than its bytes justify.
    ///
    /// # Errors
    /// Bytes that are not a published scene, of another version, damaged, or contradictory.
    pub fn decode(object: &Bytes) -> Result<Self, PublishedError> {
        let head = Head::parse(object)?;
        if object.len() as u64 > MAX_OBJECT_BYTES {
            return Err(PublishedError::TooLong);
        }
        if head.object_bytes != object.len() as u64 {
            return Err(PublishedError::Truncated("its parts"));
        }
        let (opening, rest) = object[HEAD_BYTES..].split_at(head.opening_bytes as usize);
        let opening = head.opening(opening)?;
        let body = Body(object.slice_ref(rest));
        let (mut pages, mut packs) = (Vec::new(), Vec::new());
        for (number, place) in (0..).zip(&opening.pages) {
            let bytes = body.get(&place.page, "a scene page")?;
            let record = PageRecord::decode_checked(&bytes, number, &place.page, body.len())?;
            let source = body.get(&place.source, "a list of packs")?;
            let source = SourceRecord::decode_checked(&source, &record.page, &place.source, body.len())?;
            let first = packs.len();
            for (base, of) in record.bases(&place.page).zip(&source.assets) {
                packs.push(body.pack(&base, of)?);
            }
            for (asset, behind, part) in source.behind(&place.source) {
                let pack: &mut PackContents = &mut packs[first + asset];
                match behind {
                    Behind::Texture(place) => {
                        let copy = body.get(&part, "a texture")?;
                        let mut textures = pack.textures.iter_mut();
                        textures
                            .find(|texture| texture.place == place && texture.copy.is_none())
                            .ok_or(PublishedError::Contradiction(
                                "a texture's copy is of none of its pack's",
                            ))?
                            .copy = Some(copy);
                    }
                    Behind::Index(page, place) => {
                        let bytes = body.get(&part, "an index page")?;
                        let entry = &record.page.assets[asset];
                        let (index, chunks) = place.split(&bytes, (entry, page), pack.bytes)?;
                        pack.index.push(IndexPage { bytes: bytes.slice_ref(index), chunks });
                    }
                    Behind::Tiles(place) => {
                        let bytes = body.get(&part, "texture regions")?;
                        let (regions, table) = place.split_tiles(&bytes, pack.bytes)?;
                        pack.tiles = Some(Tiles { regions: bytes.slice_ref(regions), table });
                    }
                }
            }
            pages.push(record.page);
        }
        let punctual_lights = opening.punctual_lights();
        let contents = Self {
            terrain_directory: body.all(&opening.terrain_directory, "the terrain's directory")?,
            height_overrides: body.tables(&opening.terrain_tables, "the height overrides")?,
            light_directory: body.all(&opening.light_directory, "the directory of punctual lights")?,
            light_pages: body.tables(&opening.light_tables, "the punctual lights")?,
            parts: opening.parts.table(),
            part_directory: body.all(&opening.parts.directory, "the directory of parts")?,
            part_pages: body.tables(&opening.parts.tables, "the names of parts")?,
            animations: body.all(&opening.animations, "an animation")?,
            punctual_lights,
            header: opening.header,
            pages,
            packs,
        };
        contents.check()?;
        Ok(contents)
    }

    fn check(&self) -> Result<(), PublishedError> {
        let (mut assets, mut instances) = (0_u64, 0_u64);
        let mut proxies = Proxies::default();
        for (number, page) in (0..).zip(&self.pages) {
            let in_order = page.page == number
                && u64::from(page.first_asset) == assets
                && u64::from(page.first_instance) == instances;
            if !in_order {
                return Err(PublishedError::Contradiction("its pages are out of order"));
            }
            assets += page.assets.len() as u64;
            let known = u32::try_from(assets).unwrap_or(u32::MAX);
            let fits = proxies.add(page.first_proxy, &page.proxies, known, self.header.instance_count);
            fits.map_err(|_| PublishedError::Contradiction("its proxies do not fit its instances"))?;
            instances += page.instances.len() as u64;
        }
        if [self.header.asset_count, self.header.instance_count].map(u64::from) != [assets, instances] {
            return Err(PublishedError::Contradiction(
                "its assets or instances are not as many as its header states",
            ));
        }
        let lights = self.punctual_lights.as_ref().map_or(0, |lights| lights.count);
        if self.light_pages.len() != PunctualLights::pages_of(lights) as usize {
            return Err(PublishedError::Contradiction(
                "its pages of punctual lights are not as many as its number of lights needs",
            ));
        }
        if self.part_pages.len() != self.parts.map_or(0, |table| table.pages()) as usize {
            return Err(PublishedError::Contradiction(
                "its pages of parts are not as many as its number of records needs",
            ));
        }
        Ok(())
    }
}

/// What follows the opening.
struct Body(Bytes);

impl Body {
    fn len(&self) -> u64 {
        self.0.len() as u64
    }

    fn get(&self, part: &Part, what: &'static str) -> Result<Bytes, PublishedError> {
        let [start, end] = [part.offset, part.end()].map(usize::try_from);
        let inside = start.ok().zip(end.ok()).filter(|(_, end)| *end <= self.0.len());
        let (start, end) = inside.ok_or(PublishedError::Truncated(what))?;
        let bytes = self.0.slice(start..end);
        part.verify(&bytes, what)?;
        Ok(bytes)
    }

    fn all(&self, parts: &[Part], what: &'static str) -> Result<Vec<Bytes>, PublishedError> {
        parts.iter().map(|part| self.get(part, what)).collect()
    }

    fn tables(&self, parts: &[Part], what: &'static str) -> Result<Vec<Bytes>, PublishedError> {
        let mut blobs = Vec::new();
        for part in parts {
            let bytes = self.get(part, what)?;
            let table: BlobTable = encoding::decode(&bytes, 1024 + 4 * bytes.len())
                .map_err(|why| PublishedError::Record { what, why })?;
            for number in 0..table.blobs.len() {
                let part = table.part(number).ok_or(PublishedError::Truncated(what))?;
                blobs.push(self.get(&part, what)?);
            }
        }
        Ok(blobs)
    }

    /// A pack, without what follows its list.
    fn pack(&self, base: &Part, source: &AssetSource) -> Result<PackContents, PublishedError> {
        Ok(PackContents {
            key: source.key,
            bytes: source.pack_bytes,
            base: self.get(base, "a base mesh")?,
            index: Vec::new(),
            textures_offset: source.textures_offset,
            textures: source.textures.iter().map(|place| Texture { place: *place, copy: None }).collect(),
            tiles: None,
        })
    }
}
