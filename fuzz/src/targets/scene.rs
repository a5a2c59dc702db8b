//! A published scene: one object that says all of a scene but its packs.

use lodestream_store::SceneObject;

use crate::meter::{Ceiling, within};

/// Bytes before what is hashed: magic, version, hash.
const HEAD_BYTES: usize = 8 + 2 + 32;

/// The bytes as they are, and once more with the hash made right. What is accepted is the same, to the byte, after it was
/// written.
pub fn scene_object(data: &[u8]) -> bool {
    let plain = within(SCENE, data.len(), || read(data));
    let Some((head, body)) = data.split_at_checked(HEAD_BYTES) else { return plain };
    let sealed = [&head[..10], blake3::hash(body).as_bytes(), body].concat();
    within(SCENE, sealed.len(), || read(&sealed)) | plain
}

/// Decoding claims 32 bytes a byte, by steps of sixteen times as much; the same again while it is checked and written.
const SCENE: Ceiling =
    Ceiling { base_bytes: 1 << 20, bytes_per_byte: 1 << 11, base_steps: 1 << 20, steps_per_byte: 1 << 12 };

fn read(bytes: &[u8]) -> bool {
    let Ok(object) = SceneObject::decode(bytes) else { return false };
    let again = object.encode().expect("what was read can be written");
    let twice = SceneObject::decode(&again).expect("what was written can be read");
    assert_eq!(twice.encode().as_ref(), Ok(&again), "a scene is another after it was written");
    true
}
