//! Published scenes: encoding round-trips, and damaged objects are refused.

use bytes::Bytes;
use lodestream_geometry::index::{ChunkInfo, Sphere, TruncationPoint, encode_page};
use lodestream_scene::description::AssetEntry;
use lodestream_scene::published::{
    ChunkPlace, ChunkTable, HEAD_BYTES, IndexPage, PackContents, Texture, TexturePlace, part_hash,
};

use lodestream_bake::compose::compose;
use lodestream_bake::scene::{Scene, parse};
use lodestream_store::{SceneObject, SceneObjectError};

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
        chunk_count: 2,
        ..AssetEntry::default()
    };
    let description = compose(&scene, &[entry("a", 1), entry("b", 2)], &[Vec::new(), Vec::new()]).unwrap();
    SceneObject { packs: (1..=2).map(pack).collect(), description }
}

fn pack(n: u8) -> PackContents {
    let info = |bytes, cut: Option<u32>| ChunkInfo {
        level: 1,
        sphere: Sphere { center: [0.0; 3], radius: 1.0 },
        error: 1.0,
        attribute_error: 0.0,
        truncation_points: cut
            .map(|payload_bytes| TruncationPoint {
                payload_bytes,
                error: 0.5,
                vertices: 1,
                wedges: 1,
                faces: 1,
            })
            .into_iter()
            .collect(),
        parents: Vec::new(),
        payload_bytes: bytes,
        vertices: 2,
        wedges: 2,
        faces: 2,
    };
    let infos = [info(90, Some(40)), info(70, None)];
    let chunks =
        infos.iter().map(|info| ChunkPlace::of(info).hashed(&vec![n; info.payload_bytes as usize]).unwrap());
    let texture = |level: u8, copied: bool| {
        let bytes = vec![level; 30];
        let place = TexturePlace { texture: 0, level, bytes: 30, hash: part_hash(&bytes) };
        Texture { place, copy: copied.then(|| bytes.into()) }
    };
    PackContents {
        tiles: None,
        key: [n; 32],
        bytes: 500,
        base: vec![n; 100].into(),
        index: vec![IndexPage {
            bytes: encode_page(&infos, 0).unwrap().into(),
            chunks: ChunkTable { offset: 200, chunks: chunks.collect() },
        }],
        textures_offset: 400,
        textures: vec![texture(0, true), texture(1, false)],
    }
}

fn decode(bytes: &[u8]) -> Result<SceneObject, SceneObjectError> {
    SceneObject::decode(&Bytes::copy_from_slice(bytes))
}

#[test]
fn a_decoded_object_equals_the_encoded_one() {
    let object = object();
    let bytes = object.encode().unwrap();
    let read = decode(&bytes).unwrap();
    assert_eq!(read.description.header, object.description.header);
    assert_eq!(read.description.pages, object.description.pages);
    assert_eq!(
        read.description.punctual_lights.punctual_lights(),
        object.description.punctual_lights.punctual_lights()
    );
    assert_eq!(read.packs, object.packs);
    assert_eq!(read.encode().unwrap(), bytes);
}

#[test]
fn truncated_objects_and_trailing_bytes_are_refused() {
    let bytes = object().encode().unwrap();
    for length in 0..bytes.len() {
        assert!(decode(&bytes[..length]).is_err(), "{length}");
    }
    assert!(decode(&[&bytes[..], &[0]].concat()).unwrap_err().to_string().contains("truncated"));
}

#[test]
fn every_flipped_bit_is_noticed() {
    let bytes = object().encode().unwrap();
    for bit in 0..8 * bytes.len() {
        let mut changed = bytes.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        assert!(decode(&changed).is_err(), "bit {bit}");
    }
}

/// As an attacker would write it: an opening of other bytes, with its hash.
#[test]
fn openings_of_other_bytes_are_refused() {
    let bytes = object().encode().unwrap();
    let opening = HEAD_BYTES..HEAD_BYTES + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let mut accepted = 0;
    for at in opening.clone() {
        for filler in [0, 1, 250, 251, 252, 253, 255] {
            let mut changed = bytes.clone();
            changed[at] = filler;
            let hash = blake3::hash(&changed[opening.clone()]);
            changed[24..40].copy_from_slice(&hash.as_bytes()[..16]);
            // The bounds of pages and the length of the flight are hints of which the description knows nothing.
            accepted += usize::from(changed != bytes && decode(&changed).is_ok());
        }
    }
    assert!(accepted < 7 * 24, "{accepted}");
}

#[test]
fn other_kinds_and_versions_say_so() {
    let mut bytes = object().encode().unwrap();
    bytes[8] = 2;
    assert!(decode(&bytes).unwrap_err().to_string().contains("version 2, and this program reads version 6"));
    bytes[0] = b'X';
    assert!(decode(&bytes).unwrap_err().to_string().contains("not a published scene"));
}
