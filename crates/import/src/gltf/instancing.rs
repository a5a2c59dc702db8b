//! Instanced nodes (EXT_mesh_gpu_instancing): one transformation per instance, read from accessors.

use std::collections::BTreeMap;

use glam::{DMat4, DQuat, DVec3};
use gltf::json::accessor::Type;
use serde::Deserialize;

use super::accessor::Buffers;
use super::container::Document;
use super::root::Node;
use crate::error::ImportError;

const EXTENSION: &str = "EXT_mesh_gpu_instancing";

/// Most instances of one node: as many as a scene may have.
const MAX_PLACES: usize = lodestream_scene::limits::MAX_INSTANCES as usize;

#[derive(Deserialize)]
struct InstancingJson {
    #[serde(default)]
    attributes: BTreeMap<String, usize>,
}

/// Transformations of a node's instances, relative to the node; `None` for a node without the extension.
///
/// # Errors
/// Accessors of the wrong type or of different lengths, and too many instances.
pub(super) fn of_node(
    document: &Document,
    buffers: &mut Buffers<'_>,
    node: &Node,
    index: usize,
) -> Result<Option<Vec<DMat4>>, ImportError> {
    let json = node.extension(EXTENSION);
    let Some(json) = json else { return Ok(None) };
    let place = format!("nodes[{index}].extensions.{EXTENSION}");
    let error = |what: String| document.error(format!("{place}: {what}"));
    let instancing =
        InstancingJson::deserialize(json).map_err(|e| error(format!("is not understood: {e}")))?;
    let mut open = |name: &str, shape: Type| {
        let accessor = instancing.attributes.get(name);
        accessor.map(|&accessor| buffers.open(accessor, &format!("{place}.{name}"), &[shape])).transpose()
    };
    let translations = open("TRANSLATION", Type::Vec3)?;
    let rotations = open("ROTATION", Type::Vec4)?;
    let scales = open("SCALE", Type::Vec3)?;
    let mut counts =
        [&translations, &rotations, &scales].into_iter().flatten().map(|elements| elements.len());
    let Some(count) = counts.next() else {
        return Err(error("has no TRANSLATION, ROTATION or SCALE; export the file again".into()));
    };
    if counts.any(|other| other != count) {
        return Err(error("has attributes of different lengths; export the file again".into()));
    }
    // Each instance may repeat a whole mesh, so it must take at least one byte of the file, as a node does.
    let stored: u64 = instancing.attributes.values().map(|&accessor| buffers.stored_bytes(accessor)).sum();
    if count as u64 > stored {
        return Err(error(format!("has {count} places in {stored} bytes, too many; export it uncompressed")));
    }
    if count > MAX_PLACES {
        return Err(error(format!(
            "has {count} places; at most {MAX_PLACES} are supported, so split the model"
        )));
    }
    let matrix = |at: usize| {
        let rotation = rotations.as_ref().map_or(DQuat::IDENTITY, |all| DQuat::from_array(all.get(at)));
        // As for nodes: normalised, since files round; a zero quaternion counts as the identity.
        let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
        let translation = translations.as_ref().map_or(DVec3::ZERO, |all| DVec3::from_array(all.get(at)));
        let scale = scales.as_ref().map_or(DVec3::ONE, |all| DVec3::from_array(all.get(at)));
        DMat4::from_scale_rotation_translation(scale, rotation, translation)
    };
    Ok(Some((0..count).map(matrix).collect()))
}
