//! Seed inputs, encoded by the project's own writers: regenerate them after a format change.

mod images;
mod meshes;
mod messages;
mod models;
mod published;
mod scenes;
mod seed;

use crate::compressed;

/// The seeds of a target, by the name of its corpus, as (file name, bytes). None for an unknown name.
///
/// # Panics
/// If a seed cannot be encoded.
#[must_use]
pub fn of(target: &str) -> Vec<(String, Vec<u8>)> {
    match target {
        "pack_reader" => meshes::packs(),
        "base_decoder" => meshes::bases(),
        "chunk_decoder" => meshes::chunks(),
        "apply_undo" => meshes::sequences(),
        "obj_import" => models::models(),
        "gltf_import" => models::scenes(),
        "image_import" => images::images(),
        "gltf_compressed" => compressed::seeds(),
        "ply_import" => models::scans(),
        "messages" => messages::messages(),
        "terrain" => scenes::terrain(),
        "punctual_lights" => scenes::punctual_lights(),
        "parts" => scenes::parts(),
        "scene_object" | "range_session" => published::published(),
        _ => Vec::new(),
    }
}
