//! The published scene: one object with everything that a server needs besides the packs, and the name of each pack.
//! Servers with the same object and packs serve the same bytes.
//!
//! docs/formats.md specifies the layout.

use bytes::Bytes;
use lodestream_scene::description::{Fingerprint, SceneHeader, ScenePage};
use lodestream_scene::encoding::{self, CodingError, Decode};
use lodestream_scene::limits::{MAX_DECODED_BYTES, MAX_MESSAGE_BYTES};

use crate::{PunctualLightBlobs, SceneDescription, TerrainBlobs};

/// First bytes of every scene object.
const MAGIC: [u8; 8] = *b"LODSCENE";
/// Version of the layout, the encoding of header and pages included.
const VERSION: u16 = 2;
/// Bytes before the body: magic, version, hash of the body.
const HEAD_BYTES: usize = MAGIC.len() + 2 + blake3::OUT_LEN;
/// Bytes of a length or a count.
const LENGTH_BYTES: usize = 4;
/// Longest scene object, in bytes: a million instances take 40 MB.
pub const MAX_SCENE_OBJECT_BYTES: usize = 512 << 20;

/// Name and contents of a pack among the objects of a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackName {
    /// Name, relative to the scene object's folder.
    pub name: String,
    /// Fingerprint of the contents.
    pub fingerprint: Fingerprint,
}

/// A published scene: its description, and the pack of each asset.
#[derive(Clone, Debug)]
pub struct SceneObject {
    /// The scene.
    pub description: SceneDescription,
    /// Packs, by asset number.
    pub packs: Vec<PackName>,
}

impl SceneObject {
    /// Encodes the object. Equal scenes have equal bytes.
    ///
    /// # Errors
    /// A scene longer than [`MAX_SCENE_OBJECT_BYTES`], or one whose header or page is longer than a message.
    pub fn encode(&self) -> Result<Vec<u8>, String> {
        let SceneDescription { header, pages, asset_order: _, terrain, punctual_lights } = &self.description;
        let mut body = Body::default();
        let encode_header = || encoding::encode(header).and_then(checked_length);
        body.put_bytes(&encode_header().map_err(|why| format!("its header: {why}"))?)?;
        body.put_length(pages.len())?;
        for page in pages {
            let bytes = encoding::encode(page).and_then(checked_length);
            body.put_bytes(&bytes.map_err(|why| format!("its page {}: {why}", page.page))?)?;
        }
        let (directory, overrides) = terrain.parts();
        body.put_blobs(directory)?;
        body.put_blobs(overrides)?;
        body.put_length(punctual_lights.count() as usize)?;
        let (directory, pages) = punctual_lights.parts();
        body.put_blobs(directory)?;
        body.put_blobs(pages)?;
        body.put_length(self.packs.len())?;
        for PackName { name, fingerprint } in &self.packs {
            body.put_bytes(name.as_bytes())?;
            body.0.extend(fingerprint);
        }
        let hash = blake3::hash(&body.0);
        Ok([&MAGIC[..], &VERSION.to_le_bytes(), hash.as_bytes(), &body.0].concat())
    }

    /// Decodes and checks an object; hashes it once. Reserves no more than its bytes justify.
    ///
    /// # Errors
    /// Bytes that are not a scene object, of another version, damaged, or contradictory.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let head = bytes.get(..HEAD_BYTES).ok_or("it is not a published scene: it is too short")?;
        if head[..8] != MAGIC {
            return Err("it is not a published scene".into());
        }
        let version = u16::from_le_bytes([head[8], head[9]]);
        if version != VERSION {
            return Err(format!("it has version {version}, and this program reads version {VERSION}"));
        }
        let body = &bytes[HEAD_BYTES..];
        if blake3::hash(body).as_bytes()[..] != head[10..] {
            return Err("its hash does not match: it is damaged".into());
        }
        let object = Self::decode_body(Reader(body))?;
        object.check_counts()?;
        Ok(object)
    }

    fn decode_body(mut reader: Reader<'_>) -> Result<Self, String> {
        let header: SceneHeader =
            decode_record(reader.bytes("its header")?).map_err(|why| format!("its header: {why}"))?;
        header.check().map_err(|why| why.to_string())?;
        let count = reader.count("its pages", LENGTH_BYTES)?;
        let mut pages = Vec::with_capacity(count);
        for number in 0..count {
            let page: ScenePage = decode_record(reader.bytes("its pages")?)
                .map_err(|why| format!("its page {number}: {why}"))?;
            page.check().map_err(|why| why.to_string())?;
            pages.push(page);
        }
        let directory = reader.blobs("the terrain's directory")?;
        let overrides = reader.blobs("the terrain's height overrides")?;
        let terrain = TerrainBlobs::of_parts(directory, overrides);
        let count = reader.length("its number of punctual lights")?;
        let directory = reader.blobs("the directory of punctual lights")?;
        let light_pages = reader.blobs("its punctual lights")?;
        let punctual_lights = PunctualLightBlobs::of_parts(count, directory, light_pages)
            .ok_or("its pages of punctual lights are not as many as its number of lights needs")?;
        let count = reader.count("its packs", LENGTH_BYTES + size_of::<Fingerprint>())?;
        let mut packs = Vec::with_capacity(count);
        for _ in 0..count {
            let name = reader.bytes("its packs")?;
            let name = std::str::from_utf8(name).map_err(|_| "the name of a pack is not UTF-8")?.to_owned();
            packs.push(PackName { name, fingerprint: reader.array("its packs")? });
        }
        if !reader.0.is_empty() {
            return Err(format!("{} bytes are left over at its end", reader.0.len()));
        }
        let asset_order = (0..packs.len()).collect();
        let description = SceneDescription { header, pages, asset_order, terrain, punctual_lights };
        Ok(Self { description, packs })
    }

    fn check_counts(&self) -> Result<(), String> {
        let SceneDescription { header, pages, .. } = &self.description;
        let (mut assets, mut instances) = (0_u64, 0_u64);
        for (number, page) in (0..).zip(pages) {
            let in_order = page.page == number
                && u64::from(page.first_asset) == assets
                && u64::from(page.first_instance) == instances;
            if !in_order {
                return Err(format!("its page {number} is out of order"));
            }
            let entries = page.assets.iter().zip(self.packs.get(assets as usize..).unwrap_or_default());
            if entries.clone().count() != page.assets.len()
                || entries.clone().any(|(entry, pack)| entry.fingerprint != pack.fingerprint)
            {
                return Err(format!("its page {number} names other packs than its list of packs"));
            }
            assets += page.assets.len() as u64;
            instances += page.instances.len() as u64;
        }
        let stated = [header.page_count, header.asset_count, header.instance_count].map(u64::from);
        if stated != [pages.len() as u64, self.packs.len() as u64, instances]
            || assets != self.packs.len() as u64
        {
            return Err("its pages, assets or instances are not as many as its header states".into());
        }
        if !self.description.has_stated_fingerprint() {
            return Err("its fingerprint does not match its description".into());
        }
        Ok(())
    }
}

/// Decodes a header or page that a message can carry.
fn decode_record<T: Decode>(bytes: &[u8]) -> Result<T, CodingError> {
    encoding::decode(checked_length(bytes)?, MAX_DECODED_BYTES)
}

/// Checks that a message can carry the bytes of a header or page.
fn checked_length<T: AsRef<[u8]>>(value: T) -> Result<T, CodingError> {
    let bytes = value.as_ref().len();
    if bytes > MAX_MESSAGE_BYTES {
        return Err(CodingError::TooLong { bytes, limit: MAX_MESSAGE_BYTES });
    }
    Ok(value)
}

/// The body while it is written, bounded by [`MAX_SCENE_OBJECT_BYTES`].
#[derive(Default)]
struct Body(Vec<u8>);

impl Body {
    fn put_length(&mut self, length: usize) -> Result<(), String> {
        // Anything longer than the limit does not fit anyway, so every length fits into 32 bits.
        let free_bytes = (MAX_SCENE_OBJECT_BYTES - HEAD_BYTES).saturating_sub(self.0.len() + LENGTH_BYTES);
        let stated = u32::try_from(length).ok().filter(|_| length <= free_bytes);
        let stated = stated.ok_or_else(|| format!("it takes more than {MAX_SCENE_OBJECT_BYTES} bytes"))?;
        self.0.extend(stated.to_le_bytes());
        Ok(())
    }

    fn put_bytes(&mut self, bytes: &[u8]) -> Result<(), String> {
        self.put_length(bytes.len())?;
        self.0.extend(bytes);
        Ok(())
    }

    fn put_blobs(&mut self, blobs: &[Bytes]) -> Result<(), String> {
        self.put_length(blobs.len())?;
        blobs.iter().try_for_each(|blob| self.put_bytes(blob))
    }
}

/// The part of the body that is not read yet. Each method names in its error what it was reading.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], String> {
        let (bytes, rest) =
            self.0.split_first_chunk().ok_or_else(|| format!("it ends within {what}: it is truncated"))?;
        self.0 = rest;
        Ok(*bytes)
    }

    fn length(&mut self, what: &str) -> Result<u32, String> {
        self.array(what).map(u32::from_le_bytes)
    }

    /// A count of elements of at least `min_bytes` each, which the remaining bytes can hold.
    fn count(&mut self, what: &str, min_bytes: usize) -> Result<usize, String> {
        let count = self.length(what)? as usize;
        if count > self.0.len() / min_bytes {
            return Err(format!("{what}: {count} do not fit into the {} bytes that follow", self.0.len()));
        }
        Ok(count)
    }

    fn bytes(&mut self, what: &str) -> Result<&'a [u8], String> {
        let length = self.length(what)? as usize;
        let split = self.0.split_at_checked(length);
        let (bytes, rest) = split.ok_or_else(|| {
            format!("{what}: {length} bytes do not fit into the {} that follow", self.0.len())
        })?;
        self.0 = rest;
        Ok(bytes)
    }

    fn blobs(&mut self, what: &str) -> Result<Vec<Bytes>, String> {
        let count = self.count(what, LENGTH_BYTES)?;
        let mut blobs = Vec::with_capacity(count);
        for _ in 0..count {
            blobs.push(Bytes::copy_from_slice(self.bytes(what)?));
        }
        Ok(blobs)
    }
}
