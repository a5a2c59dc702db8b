//! Writes a published scene, in the order in which a client needs it.

use bytes::Bytes;
use glam::{DVec3, Vec3};

use super::contents::{Contents, IndexPage, PackContents, Tiles};
use super::opening::{Head, Opening, PART_PAGES_PER_TABLE, PagePlace, PartPlaces};
use super::part::{Part, PartHash, part_hash};
use super::records::{AssetSource, Behind, IndexPlace, PageRecord, SourceRecord};
use super::tables::BlobTable;
use super::{MAX_OBJECT_BYTES, PublishedError};
use crate::description::{AssetEntry, ScenePage};
use crate::encoding::{self, Encode};
use crate::punctual_lights::LISTED_PER_PAGE;
use crate::terrain::PATCHES_PER_PAGE;

/// Bytes of leading scene pages and their base meshes that come before everything else: about what a server pushes first.
const FLIGHT_PAGES_BYTES: u64 = 64 << 10;
/// Most bytes that a client reads ahead, without having asked for them.
const MAX_FLIGHT_BYTES: u64 = 256 << 10;

impl Contents {
    /// Encodes the scene. Equal scenes have equal bytes.
    ///
    /// # Errors
    /// Values that cannot be encoded, or a scene longer than [`MAX_OBJECT_BYTES`].
    pub fn encode(&self) -> Result<Vec<u8>, PublishedError> {
        let mut body = Body::default();
        let mut pages = vec![None; self.pages.len()];
        let mut sources = vec![None; self.pages.len()];
        let mut leading = 0;
        while leading < self.pages.len() && (leading == 0 || body.end() < FLIGHT_PAGES_BYTES) {
            pages[leading] = Some(self.put_page(leading, &mut body)?);
            leading += 1;
        }
        for (number, source) in sources.iter_mut().enumerate().take(leading) {
            *source = Some(self.put_source(number, &mut body)?);
        }
        let flight_bytes = body.end().min(MAX_FLIGHT_BYTES);
        for (number, page) in pages.iter_mut().enumerate().skip(leading) {
            *page = Some(self.put_page(number, &mut body)?);
        }
        for (number, source) in sources.iter_mut().enumerate().skip(leading) {
            *source = Some(self.put_source(number, &mut body)?);
        }
        let terrain_directory = body.put_all(&self.terrain_directory)?;
        let light_directory = body.put_all(&self.light_directory)?;
        let terrain_tables = body.put_tables(&self.height_overrides, PATCHES_PER_PAGE as usize)?;
        let light_tables = body.put_tables(&self.light_pages, LISTED_PER_PAGE as usize)?;
        let parts = PartPlaces {
            records: self.parts.map_or(0, |table| table.records),
            directory: body.put_all(&self.part_directory)?,
            tables: body.put_tables(&self.part_pages, PART_PAGES_PER_TABLE as usize)?,
        };
        let animations = body.put_all(&self.animations)?;
        let assets: Vec<&AssetEntry> = self.pages.iter().flat_map(|page| &page.assets).collect();
        let places = self.pages.iter().zip(pages.into_iter().zip(sources));
        let pages = places.map(|(scene_page, (page, source))| {
            let (center, radius) = self.bounds(scene_page, &assets);
            PagePlace { page: page.unwrap_or_default(), source: source.unwrap_or_default(), center, radius }
        });
        let lights = self.punctual_lights.as_ref();
        let opening = Opening {
            header: self.header.clone(),
            flight_bytes,
            pages: pages.collect(),
            terrain_directory,
            terrain_tables,
            light_count: lights.map_or(0, |lights| lights.count),
            light_directory,
            light_tables,
            first_lights: lights.map(|lights| lights.first.clone()).unwrap_or_default(),
            parts,
            animations,
        };
        opening.check(body.end())?;
        Ok([Head::encode_opening(&opening, body.end())?, body.0].concat())
    }

    /// Packs of a page's assets.
    fn packs(&self, page: &ScenePage) -> Result<&[PackContents], PublishedError> {
        let first = page.first_asset as usize;
        self.packs
            .get(first..first.saturating_add(page.assets.len()))
            .ok_or(PublishedError::Contradiction("there are fewer packs than assets"))
    }

    fn put_page(&self, number: usize, body: &mut Body) -> Result<Part, PublishedError> {
        let page = &self.pages[number];
        let packs = self.packs(page)?;
        let bases = packs.iter().map(|pack| part_hash(&pack.base)).collect();
        let part = body.put(&encode(&PageRecord { page: page.clone(), bases }, "a scene page")?)?;
        for (pack, asset) in packs.iter().zip(&page.assets) {
            if pack.base.len() != asset.base_bytes as usize {
                return Err(PublishedError::Contradiction(
                    "a base mesh is not as long as its scene page states",
                ));
            }
            body.put(&pack.base)?;
        }
        Ok(part)
    }

    fn put_source(&self, number: usize, body: &mut Body) -> Result<Part, PublishedError> {
        let packs = self.packs(&self.pages[number])?;
        let indices: Vec<Vec<(IndexPlace, Vec<u8>)>> =
            packs.iter().map(|pack| pack.index.iter().map(index_part).collect()).collect::<Result<_, _>>()?;
        let tiles: Vec<Option<(IndexPlace, Vec<u8>)>> = packs
            .iter()
            .map(|pack| pack.tiles.as_ref().map(tiles_part).transpose())
            .collect::<Result<_, _>>()?;
        let both = indices.iter().zip(&tiles);
        let sources = packs.iter().zip(both).map(|(pack, (index, tiles))| AssetSource {
            key: pack.key,
            pack_bytes: pack.bytes,
            textures_offset: pack.textures_offset,
            textures: pack.textures.iter().map(|texture| texture.place).collect(),
            coarse: pack
                .textures
                .iter()
                .filter(|texture| texture.copy.is_some())
                .map(|texture| texture.place)
                .collect(),
            index: index.iter().map(|(place, _)| *place).collect(),
            tiles: tiles.as_ref().map(|(place, _)| *place),
        });
        let record = SourceRecord { assets: sources.collect() };
        let part = body.put(&encode(&record, "a list of packs")?)?;
        for (asset, behind, place) in record.behind(&part) {
            let put = match behind {
                Behind::Texture(place) => {
                    let texture = packs[asset].textures.iter().find(|texture| texture.place == place);
                    let copy = texture.and_then(|texture| texture.copy.as_ref());
                    body.put(copy.ok_or(PublishedError::Contradiction("a texture is listed twice"))?)?
                }
                Behind::Index(page, _) => body.put(&indices[asset][page as usize].1)?,
                Behind::Tiles(_) => body.put(tiles[asset].as_ref().map_or(&[][..], |(_, bytes)| bytes))?,
            };
            debug_assert_eq!(put, place, "what follows a list of packs lies where the list says");
        }
        Ok(part)
    }

    /// A sphere around a page's instances and proxies, relative to the start camera's eye, rounded outwards.
    fn bounds(&self, page: &ScenePage, assets: &[&AssetEntry]) -> ([f32; 3], f32) {
        let eye = DVec3::from(self.header.camera.eye);
        let spheres: Vec<(DVec3, f64)> = page
            .instances
            .iter()
            .filter_map(|instance| {
                let asset = assets.get(instance.asset as usize)?;
                let center = instance.to_world(asset.origin, asset.sphere.center) - eye;
                Some((center, f64::from(asset.sphere.radius) * f64::from(instance.placement.scale)))
            })
            .chain(page.proxies.iter().filter_map(|proxy| {
                let asset = assets.get(proxy.asset as usize)?;
                let center = DVec3::from(asset.origin) + Vec3::from(asset.sphere.center).as_dvec3() - eye;
                Some((center, f64::from(asset.sphere.radius) + f64::from(proxy.error)))
            }))
            .collect();
        let corner = |pick: fn(DVec3, DVec3) -> DVec3, sign: f64, start: f64| {
            spheres.iter().fold(DVec3::splat(start), |at, (c, r)| pick(at, *c + DVec3::splat(sign * r)))
        };
        if spheres.is_empty() {
            return ([0.0; 3], 0.0);
        }
        let (low, high) =
            (corner(DVec3::min, -1.0, f64::INFINITY), corner(DVec3::max, 1.0, f64::NEG_INFINITY));
        let center = ((low + high) * 0.5).as_vec3();
        let reach = |(c, r): &(DVec3, f64)| c.distance(center.as_dvec3()) + r;
        let radius = spheres.iter().map(reach).fold(0.0, f64::max);
        #[expect(clippy::cast_possible_truncation, reason = "rounded outwards by the factor")]
        let radius = (radius * (1.0 + 4.0 * f64::from(f32::EPSILON))) as f32;
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        (Vec3::to_array(&center).map(finite), if radius.is_finite() { radius } else { f32::MAX })
    }
}

fn index_part(page: &IndexPage) -> Result<(IndexPlace, Vec<u8>), PublishedError> {
    with_table(&page.bytes, &encode(&page.chunks.hashes(), "a table of chunks")?)
}

fn tiles_part(tiles: &Tiles) -> Result<(IndexPlace, Vec<u8>), PublishedError> {
    with_table(&tiles.regions, &encode(&tiles.table, "a table of tiles")?)
}

fn with_table(first: &[u8], table: &[u8]) -> Result<(IndexPlace, Vec<u8>), PublishedError> {
    let bytes = [first, table].concat();
    let place = IndexPlace { bytes: length(&bytes)?, index_bytes: length(first)?, hash: part_hash(&bytes) };
    Ok((place, bytes))
}

fn encode<T: Encode>(value: &T, what: &'static str) -> Result<Vec<u8>, PublishedError> {
    encoding::encode(value).map_err(|why| PublishedError::Record { what, why })
}

fn length(bytes: &[u8]) -> Result<u32, PublishedError> {
    u32::try_from(bytes.len()).map_err(|_| PublishedError::TooLong)
}

/// What follows the opening.
#[derive(Default)]
struct Body(Vec<u8>);

impl Body {
    const fn end(&self) -> u64 {
        self.0.len() as u64
    }

    fn put(&mut self, bytes: &[u8]) -> Result<Part, PublishedError> {
        let part = Part { offset: self.end(), bytes: length(bytes)?, hash: part_hash(bytes) };
        if part.end() > MAX_OBJECT_BYTES {
            return Err(PublishedError::TooLong);
        }
        self.0.extend_from_slice(bytes);
        Ok(part)
    }

    fn put_all(&mut self, blobs: &[Bytes]) -> Result<Vec<Part>, PublishedError> {
        blobs.iter().map(|blob| self.put(blob)).collect()
    }

    /// Blobs, and behind each `per_table` of them their table.
    fn put_tables(&mut self, blobs: &[Bytes], per_table: usize) -> Result<Vec<Part>, PublishedError> {
        let mut tables = Vec::new();
        for group in blobs.chunks(per_table) {
            let offset = self.end();
            let parts = self.put_all(group)?;
            let blobs: Vec<(u32, PartHash)> = parts.iter().map(|part| (part.bytes, part.hash)).collect();
            tables.push(self.put(&encode(&BlobTable { offset, blobs }, "a table of blobs")?)?);
        }
        Ok(tables)
    }
}
