//! Published scenes: encoding round-trips, and damaged objects are refused.

use lodestream_geometry::index::Sphere;
use lodestream_scene::description::AssetEntry;

use lodestream_bake::compose::compose;
use lodestream_bake::scene::{Scene, parse};
use lodestream_store::{PackName, SceneObject};

/// Magic, version and hash.
const HEAD_BYTES: usize = 42;

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
    let description = compose(&scene, &[entry("a", 1), entry("b", 2)], &[Vec::new(), Vec::new()]).unwrap();
    let names = description.pages[0].assets.iter();
    let packs = names.map(|asset| PackName { name: asset.name.clone(), fingerprint: asset.fingerprint });
    SceneObject { packs: packs.collect(), description }
}

/// A body behind a head with the matching hash, as an attacker would write it.
fn sealed(body: &[u8]) -> Vec<u8> {
    [&object().encode().unwrap()[..10], blake3::hash(body).as_bytes(), body].concat()
}

#[test]
fn a_decoded_object_equals_the_encoded_one() {
    let object = object();
    let bytes = object.encode().unwrap();
    let read = SceneObject::decode(&bytes).unwrap();
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
        assert!(SceneObject::decode(&bytes[..length]).is_err(), "{length}");
        if let Some(body) = bytes[..length].get(HEAD_BYTES..) {
            assert!(SceneObject::decode(&sealed(body)).is_err(), "{length} bytes with the matching hash");
        }
    }
    let longer = [&bytes[HEAD_BYTES..], &[0]].concat();
    assert!(SceneObject::decode(&sealed(&longer)).unwrap_err().contains("left over"));
}

/// The fingerprint covers the description, so a flipped bit is refused unless it is in a pack's name or keeps the number
/// of pages of lights.
#[test]
fn a_flipped_bit_of_the_description_is_refused() {
    let object = object();
    let bytes = object.encode().unwrap();
    let mut accepted = 0;
    for bit in 8 * HEAD_BYTES..8 * bytes.len() {
        let mut changed = bytes.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        assert!(SceneObject::decode(&changed).is_err(), "bit {bit}");
        if let Ok(read) = SceneObject::decode(&sealed(&changed[HEAD_BYTES..])) {
            accepted += 1;
            assert_eq!(read.description.header, object.description.header, "bit {bit}");
            assert_eq!(read.description.pages, object.description.pages, "bit {bit}");
        }
    }
    // Seven bits each of two names of one letter, and a few of the count of lights.
    assert!(accepted <= 24, "{accepted} of {} bits", 8 * (bytes.len() - HEAD_BYTES));
}

/// Every four bytes of the body, replaced by a length that nothing justifies: the reservation that it asks for would be
/// gigabytes (the fuzz target `scene_object` bounds the bytes that are reserved).
#[test]
fn lengths_beyond_the_bytes_are_refused() {
    let bytes = object().encode().unwrap();
    let body = &bytes[HEAD_BYTES..];
    for at in 0..body.len() - 4 {
        for length in [u32::MAX, 1 << 31, 1 << 24] {
            let mut body = body.to_vec();
            if body[at..at + 4] == length.to_le_bytes() {
                continue;
            }
            body[at..at + 4].copy_from_slice(&length.to_le_bytes());
            // Only a pack's name of one letter may have become another.
            if let Ok(read) = SceneObject::decode(&sealed(&body)) {
                assert!(read.packs.iter().all(|pack| pack.name.len() == 1), "at {at}");
            }
        }
    }
    for filler in [0, 250_u8, 251, 252, 253, 254, 255] {
        for at in 0..40 {
            let mut body = vec![filler; 60];
            body[..at].fill(0);
            assert!(SceneObject::decode(&sealed(&body)).is_err());
        }
    }
}

#[test]
fn light_pages_must_be_as_many_as_the_count_needs() {
    let bytes = object().encode().unwrap();
    let one_light: [u8; 4] = 1_u32.to_le_bytes();
    // The count of lights is behind both empty lists of the terrain's blobs.
    let before = [[0; 8].as_slice(), &one_light].concat();
    let at = bytes.windows(12).position(|window| window == before).unwrap() + 8;
    for count in [0_u32, 65, 262_145, u32::MAX] {
        let mut changed = bytes[HEAD_BYTES..].to_vec();
        changed[at - HEAD_BYTES..][..4].copy_from_slice(&count.to_le_bytes());
        let error = SceneObject::decode(&sealed(&changed)).unwrap_err();
        assert!(error.contains("pages of punctual lights"), "{count}: {error}");
    }
}
