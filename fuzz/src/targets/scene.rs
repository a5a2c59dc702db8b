//! A published scene: one object with everything but the packs.

use lodestream_store::SceneObject;

use crate::meter::{Ceiling, within};

/// Bytes before the hashed part: magic, version, hash.
const HEAD_BYTES: usize = 8 + 2 + 32;

/// Reads the bytes as they are, and again with a corrected hash. An accepted scene is encoded to the same bytes.
pub fn scene_object(data: &[u8]) -> bool {
    let plain = within(SCENE, data.len(), || read(data));
    let Some((head, body)) = data.split_at_checked(HEAD_BYTES) else { return plain };
    let sealed = [&head[..10], blake3::hash(body).as_bytes(), body].concat();
    within(SCENE, sealed.len(), || read(&sealed)) | plain
}

/// Decoding reserves 32 bytes per byte, in steps that may be sixteen times as large; validation and encoding as much
/// again.
const SCENE: Ceiling =
    Ceiling { base_bytes: 1 << 20, bytes_per_byte: 1 << 11, base_steps: 1 << 20, steps_per_byte: 1 << 12 };

fn read(bytes: &[u8]) -> bool {
    let Ok(object) = SceneObject::decode(bytes) else { return false };
    let again = object.encode().expect("what was read can be written");
    let twice = SceneObject::decode(&again).expect("what was written can be read");
    assert_eq!(twice.encode().as_ref(), Ok(&again), "a scene is another after it was written");
    true
}
