//! The targets. Each takes any bytes, panics on a finding, and returns whether the input was accepted.

mod asset;
mod import;
mod messages;
mod parts;
mod punctual_lights;
mod scene;
mod sequence;
mod terrain;

pub use asset::{base_decoder, chunk_decoder, pack_reader, rehashed};
pub use import::{gltf_compressed, gltf_import, image_import, obj_import, ply_import};
pub use messages::messages;
pub use parts::parts;
pub use punctual_lights::punctual_lights;
pub use scene::{range_session, scene_object};
pub use sequence::apply_undo;
pub use terrain::terrain;

/// A target: returns whether it accepts the input.
pub type Target = fn(&[u8]) -> bool;

/// Every target by the name of its corpus.
pub const ALL: [(&str, Target); 15] = [
    ("pack_reader", pack_reader),
    ("base_decoder", base_decoder),
    ("chunk_decoder", chunk_decoder),
    ("apply_undo", apply_undo),
    ("obj_import", obj_import),
    ("gltf_import", gltf_import),
    ("gltf_compressed", gltf_compressed),
    ("image_import", image_import),
    ("ply_import", ply_import),
    ("messages", messages),
    ("terrain", terrain),
    ("punctual_lights", punctual_lights),
    ("parts", parts),
    ("scene_object", scene_object),
    ("range_session", range_session),
];
