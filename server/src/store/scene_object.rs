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

use crate::compose::{Composed, PunctualLightBlobs, TerrainBlobs};

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
    pub composed: Composed,
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
        let Composed { header, pages, terrain, punctual_lights, .. } = &self.composed;
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
        let composed = Composed {
            header,
            pages,
            asset_order: (0..packs.len()).collect(),
            terrain: TerrainBlobs::of_parts(terrain_pages, points),
            punctual_lights: PunctualLightBlobs::of_parts(punctual_lights, directory, punctual_light_pages),
        };
        let object = Self { composed, packs };
        object.check_counts()?;
        Ok(object)
    }

    fn check_counts(&self) -> Result<(), String> {
        let Composed { header, pages, .. } = &self.composed;
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
        if !self.composed.is_whole() {
            return Err("its fingerprint is of another scene".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use lodestream_geometry::index::Sphere;
    use lodestream_scene::description::AssetEntry;

    use super::*;
    use crate::compose::compose;
    use crate::scene::{Scene, parse};

    /// A scene of two assets, three instances and a punctual light.
    fn object() -> SceneObject {
        let text = "[[asset]]\nname = 'a'\nfile = 'a.obj'\n[[asset]]\nname = 'b'\nfile = 'b.obj'\n\
                    [[instance]]\nasset = 'a'\n[[instance]]\nasset = 'b'\ntranslation = [0, 0, 9]\n\
                    [[instance]]\nasset = 'b'\ntranslation = [1e6, 0, 0.1]\n\
                    [[punctual_light]]\nposition = [0, 2, 0]\nintensity = 40\n";
        let scene: Scene = parse(std::path::Path::new("scene.toml"), text).unwrap();
        let entry = |name: &str, n: u8| AssetEntry {
            name: name.into(),
            fingerprint: [n; 16],
            sphere: Sphere { center: [0.0; 3], radius: 1.0 },
            root_error: 0.1,
            base_bytes: 100,
            ..AssetEntry::default()
        };
        let composed = compose(&scene, &[entry("a", 1), entry("b", 2)], &[Vec::new(), Vec::new()]).unwrap();
        let names = composed.pages[0].assets.iter();
        let packs = names.map(|asset| PackName { name: asset.name.clone(), fingerprint: asset.fingerprint });
        SceneObject { packs: packs.collect(), composed }
    }

    /// The bytes, with the hash made right: as of somebody who means it.
    fn sealed(body: &[u8]) -> Vec<u8> {
        [&MAGIC[..], &VERSION.to_le_bytes(), blake3::hash(body).as_bytes(), body].concat()
    }

    #[test]
    fn what_is_read_is_what_was_written() {
        let object = object();
        let bytes = object.encode().unwrap();
        let read = SceneObject::decode(&bytes).unwrap();
        assert_eq!(read.composed.header, object.composed.header);
        assert_eq!(read.composed.pages, object.composed.pages);
        assert_eq!(
            read.composed.punctual_lights.punctual_lights(),
            object.composed.punctual_lights.punctual_lights()
        );
        assert_eq!(read.packs, object.packs);
        assert_eq!(read.encode().unwrap(), bytes);
    }

    #[test]
    fn whatever_is_cut_off_is_missed() {
        let bytes = object().encode().unwrap();
        for length in 0..bytes.len() {
            assert!(SceneObject::decode(&bytes[..length]).is_err(), "{length}");
            if let Some(body) = bytes[..length].get(HEAD_BYTES..) {
                assert!(SceneObject::decode(&sealed(body)).is_err(), "{length} with the hash made right");
            }
        }
        let longer = [&bytes[HEAD_BYTES..], &[0]].concat();
        assert!(SceneObject::decode(&sealed(&longer)).unwrap_err().contains("left over"));
    }

    /// The fingerprint is over all that is said of the scene, so no bit of that may be another, and the packs' names are
    /// what is left.
    #[test]
    fn no_bit_of_the_description_may_be_another() {
        let object = object();
        let bytes = object.encode().unwrap();
        let mut taken = 0;
        for bit in 8 * HEAD_BYTES..8 * bytes.len() {
            let mut changed = bytes.clone();
            changed[bit / 8] ^= 1 << (bit % 8);
            assert!(SceneObject::decode(&changed).is_err(), "bit {bit}");
            if let Ok(read) = SceneObject::decode(&sealed(&changed[HEAD_BYTES..])) {
                taken += 1;
                assert_eq!(read.composed.header, object.composed.header, "bit {bit}");
                assert_eq!(read.composed.pages, object.composed.pages, "bit {bit}");
            }
        }
        // Two names of a letter, of which a bit makes no UTF-8, and what is said of punctual lights.
        assert!(taken < 400, "{taken} of {} bits", 8 * (bytes.len() - HEAD_BYTES));
    }

    #[test]
    fn lengths_that_lie_reserve_nothing() {
        for length in [250_u8, 251, 252, 253, 254, 255] {
            for at in 0..40 {
                let mut body = vec![length; 60];
                body[..at].fill(0);
                assert!(SceneObject::decode(&sealed(&body)).is_err());
            }
        }
    }
}
