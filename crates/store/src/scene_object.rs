//! A scene as one object: all that a server must know of it but the packs, and which pack is which asset. Whoever has one
//! and the packs serves the scene as everybody else does, byte for byte.
//!
//! ```text
//! magic "LODSCENE" | version u16 | hash [32] of what follows
//! header, pages, blobs of the terrain and of punctual lights, packs by asset number: bincode, as in messages
//! ```

use bincode::config::{Configuration, Limit, LittleEndian, Varint};
use bincode::error::DecodeError;
use bincode::{Decode, Encode};
use bytes::Bytes;
use lodestream_scene::description::{Fingerprint, SceneHeader, ScenePage};
use lodestream_scene::punctual_lights::PunctualLights;

use crate::{PunctualLightBlobs, SceneDescription, TerrainBlobs};

/// First bytes of every scene object.
const MAGIC: [u8; 8] = *b"LODSCENE";
/// Version of its layout. What messages say of scenes is in it: it changes with them.
const VERSION: u16 = 1;
/// Bytes before what is hashed.
const HEAD_BYTES: usize = MAGIC.len() + 2 + 32;
/// Longest scene object: a million instances take 40 MB.
pub const MAX_SCENE_OBJECT_BYTES: usize = 512 << 20;

/// Memory that decoding may claim, for each byte: an instance of 15 bytes takes 60.
const CLAIM_PER_BYTE: usize = 32;

type Limited<const N: usize> = Configuration<LittleEndian, Varint, Limit<N>>;

const fn limited<const N: usize>() -> Limited<N> {
    bincode::config::standard().with_limit::<N>()
}

/// Reads what is coded. The coder knows limits at compile time alone, so there are some, and that is taken which the bytes
/// justify: a length that lies is refused before anything is reserved for it.
fn read(body: &[u8]) -> Result<(Coded, usize), DecodeError> {
    let claim = body.len().saturating_mul(CLAIM_PER_BYTE);
    if claim <= 1 << 16 {
        bincode::decode_from_slice(body, limited::<{ 1 << 16 }>())
    } else if claim <= 1 << 20 {
        bincode::decode_from_slice(body, limited::<{ 1 << 20 }>())
    } else if claim <= 1 << 24 {
        bincode::decode_from_slice(body, limited::<{ 1 << 24 }>())
    } else if claim <= 1 << 28 {
        bincode::decode_from_slice(body, limited::<{ 1 << 28 }>())
    } else {
        bincode::decode_from_slice(body, limited::<{ CLAIM_PER_BYTE * MAX_SCENE_OBJECT_BYTES }>())
    }
}

/// A pack among the objects.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct PackName {
    /// Its name, relative to the scene object's folder.
    pub name: String,
    /// Of its contents.
    pub fingerprint: Fingerprint,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct SceneObject {
    /// The scene.
    pub description: SceneDescription,
    /// By asset number.
    pub packs: Vec<PackName>,
}

#[derive(Encode, Decode)]
struct Coded {
    header: SceneHeader,
    pages: Vec<ScenePage>,
    terrain: [Vec<Vec<u8>>; 2],
    punctual_lights: Option<PunctualLights>,
    punctual_light_blobs: [Vec<Vec<u8>>; 2],
    packs: Vec<PackName>,
}

impl SceneObject {
    /// As bytes. The same scene gives the same.
    ///
    /// # Errors
    /// A scene that is longer than one may be.
    pub fn encode(&self) -> Result<Vec<u8>, String> {
        let owned = |(a, b): (&[Bytes], &[Bytes])| {
            [a, b].map(|blobs| blobs.iter().map(|blob| blob.to_vec()).collect())
        };
        let SceneDescription { header, pages, terrain, punctual_lights, .. } = &self.description;
        let coded = Coded {
            header: header.clone(),
            pages: pages.clone(),
            terrain: owned(terrain.parts()),
            punctual_lights: punctual_lights.punctual_lights().cloned(),
            punctual_light_blobs: owned(punctual_lights.parts()),
            packs: self.packs.clone(),
        };
        let body =
            bincode::encode_to_vec(&coded, bincode::config::standard()).map_err(|why| why.to_string())?;
        if body.len() > MAX_SCENE_OBJECT_BYTES - HEAD_BYTES {
            return Err(format!("{} bytes are more than a scene may have", body.len()));
        }
        let hash = blake3::hash(&body);
        Ok([&MAGIC[..], &VERSION.to_le_bytes(), hash.as_bytes(), &body].concat())
    }

    /// Reads and checks one. Costs a hash over it.
    ///
    /// # Errors
    /// Bytes that are no scene object, of another version, damaged, or say what no scene may.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let head = bytes.get(..HEAD_BYTES).ok_or("it is no published scene: it is too short")?;
        if head[..8] != MAGIC {
            return Err("it is no published scene".into());
        }
        let version = u16::from_le_bytes([head[8], head[9]]);
        if version != VERSION {
            return Err(format!("it has version {version}, and this program reads version {VERSION}"));
        }
        let body = &bytes[HEAD_BYTES..];
        if blake3::hash(body).as_bytes()[..] != head[10..] {
            return Err("its hash does not match: it is damaged".into());
        }
        let (coded, used): (Coded, usize) = read(body).map_err(|why| format!("it cannot be read: {why}"))?;
        if used != body.len() {
            return Err(format!("{} bytes are left over at its end", body.len() - used));
        }
        let Coded { header, pages, terrain, punctual_lights, punctual_light_blobs, packs } = coded;
        header.check().map_err(|why| why.to_string())?;
        for page in &pages {
            page.check().map_err(|why| why.to_string())?;
        }
        let shared =
            |blobs: [Vec<Vec<u8>>; 2]| blobs.map(|blobs| blobs.into_iter().map(Bytes::from).collect());
        let [terrain_pages, points] = shared(terrain);
        let [directory, punctual_light_pages] = shared(punctual_light_blobs);
        let description = SceneDescription {
            header,
            pages,
            asset_order: (0..packs.len()).collect(),
            terrain: TerrainBlobs::of_parts(terrain_pages, points),
            punctual_lights: PunctualLightBlobs::of_parts(punctual_lights, directory, punctual_light_pages),
        };
        let object = Self { description, packs };
        object.check_counts()?;
        Ok(object)
    }

    fn check_counts(&self) -> Result<(), String> {
        let SceneDescription { header, pages, .. } = &self.description;
        let (mut assets, mut instances) = (0_u64, 0_u64);
        for (number, page) in (0..).zip(pages) {
            let in_order = page.page == number
                && u64::from(page.first_asset) == assets
                && u64::from(page.first_instance) == instances;
            if !in_order {
                return Err(format!("its page {number} is not where it should be"));
            }
            let entries = page.assets.iter().zip(self.packs.get(assets as usize..).unwrap_or_default());
            if entries.clone().count() != page.assets.len()
                || entries.clone().any(|(entry, pack)| entry.fingerprint != pack.fingerprint)
            {
                return Err(format!("its page {number} is of other packs"));
            }
            assets += page.assets.len() as u64;
            instances += page.instances.len() as u64;
        }
        let said = [header.page_count, header.asset_count, header.instance_count].map(u64::from);
        if said != [pages.len() as u64, self.packs.len() as u64, instances]
            || assets != self.packs.len() as u64
        {
            return Err("it has other pages, assets or instances than its header says".into());
        }
        if !self.description.is_whole() {
            return Err("its fingerprint is of another scene".into());
        }
        Ok(())
    }
}
