//! Published scenes: what is read is what was written, and what is damaged is refused.

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

/// The bytes, with the hash made right: as of somebody who means it.
fn sealed(body: &[u8]) -> Vec<u8> {
    [&object().encode().unwrap()[..10], blake3::hash(body).as_bytes(), body].concat()
}

#[test]
fn what_is_read_is_what_was_written() {
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
            assert_eq!(read.description.header, object.description.header, "bit {bit}");
            assert_eq!(read.description.pages, object.description.pages, "bit {bit}");
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
