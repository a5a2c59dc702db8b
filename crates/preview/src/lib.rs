//! A preview of a scene: coarse meshes in one colour per material, and the ground, in a file of some tens of kilobytes
//! that a small script draws while the client loads. Format: docs/formats.md.
//!
//! A preview is an approximation. Textures are replaced by their mean colours, positions have 12 bits, and what exceeds
//! the [limits](MAX_FACES) is left out, smallest objects last in the scene's order first.

mod ground;
mod mesh;
mod refine;
mod streams;

use std::borrow::Borrow;
use std::collections::BTreeSet;
use std::io::Write as _;

use flate2::Compression;
use flate2::write::DeflateEncoder;
use lodestream_compress::decode_base;
use lodestream_geometry::DecodeError;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_scene::asset::{AssetDescription, DescriptionError};
use lodestream_scene::blob::BlobPart;
use lodestream_scene::description::{AssetEntry, Instance, SceneHeader, ScenePage};
use lodestream_scene::surroundings::Surroundings;
use serde_json::{Value, json};

use crate::mesh::PreviewMesh;
use crate::refine::{Refined, refine};
use crate::streams::Streams;

/// Most faces of all assets together.
pub const MAX_FACES: usize = 24_000;
/// Most assets, which a preview reads one after another.
pub const MAX_ASSETS: usize = 96;
/// Most instances.
pub const MAX_INSTANCES: usize = 384;
/// Longest base blob that is read, in bytes.
const MAX_BASE_BYTES: u32 = 64 << 10;
/// Version of the format, which the page's script checks.
const VERSION: u32 = 1;

/// Why there is no preview.
#[derive(Debug, thiserror::Error)]
pub enum PreviewError {
    /// A base mesh that does not decode.
    #[error("base mesh of asset {asset}: {why}")]
    Base {
        /// Number of the asset.
        asset: u32,
        /// What is wrong.
        why: DecodeError,
    },
    /// A description that does not decode.
    #[error("description of asset {asset}: {why}")]
    Description {
        /// Number of the asset.
        asset: u32,
        /// What is wrong.
        why: DescriptionError,
    },
    /// The scene has nothing that a preview would show.
    #[error("no asset of the scene fits into a preview")]
    Empty,
}

/// Encodes the preview of a scene. `pages`: its first pages, in order. `read`: reads a blob of an asset; `None` leaves the
/// asset or its refinement out. The same scene gives the same bytes.
///
/// Cost: decoding base meshes and some chunks, some milliseconds; and some 22,000 heights of the terrain.
///
/// # Errors
/// Those of `read`, a base blob that does not decode, or nothing to show.
pub fn encode<E: From<PreviewError>>(
    header: &SceneHeader,
    pages: &[impl Borrow<ScenePage>],
    mut read: impl FnMut(u32, BlobPart) -> Result<Option<Vec<u8>>, E>,
) -> Result<Vec<u8>, E> {
    let pages = || pages.iter().map(Borrow::borrow);
    let entries: Vec<&AssetEntry> = pages().flat_map(|page| &page.assets).collect();
    // Proxies stand for what the instances show.
    let proxies: BTreeSet<u32> = pages().flat_map(|page| &page.proxies).map(|proxy| proxy.asset).collect();
    let instances: Vec<&Instance> = pages().flat_map(|page| &page.instances).collect();
    let (mut refined, mut faces) = (Vec::new(), 0);
    let placed_ones = (0_u32..).zip(&entries).filter(|(asset, _)| !proxies.contains(asset));
    for (asset, entry) in placed_ones.take(MAX_ASSETS) {
        if entry.base_bytes > MAX_BASE_BYTES {
            continue;
        }
        let Some(blob) = read(asset, BlobPart::Base)? else { continue };
        let base = decode_base(&blob).map_err(|why| PreviewError::Base { asset, why })?;
        let description = AssetDescription::decode(&base.description)
            .map_err(|why| PreviewError::Description { asset, why })?;
        if faces + base.faces.len() <= MAX_FACES {
            faces += base.faces.len();
            refined.push(Refined {
                asset,
                mesh: ActiveMesh::new(&base),
                description,
                origin: base.grid.origin,
            });
        }
    }
    refine(&mut refined, &entries, &instances, &header.camera, &mut read)?;
    let mut streams = Streams::default();
    let (mut meshes, mut numbers) = (Vec::new(), vec![None; entries.len()]);
    for refined in &refined {
        let Some(mesh) = PreviewMesh::new(refined) else { continue };
        numbers[refined.asset as usize] = Some(meshes.len());
        meshes.push(mesh.write(&mut streams));
    }
    let number = |instance: &Instance| numbers.get(instance.asset as usize).copied().flatten();
    let instances: Vec<Value> = instances
        .into_iter()
        .filter_map(|instance| Some(placed(number(instance)?, instance)))
        .take(MAX_INSTANCES)
        .collect();
    if instances.is_empty() {
        return Err(PreviewError::Empty.into());
    }
    let ground =
        header.terrain.as_deref().and_then(|entry| ground::write(entry, &header.camera, &mut streams));
    let (camera, light) = (&header.camera, &header.light);
    let up = camera.up.map(f64::from);
    let camera = [&camera.eye[..], &camera.target, &up, &[camera.fov_y.into()]].concat();
    let head = json!({
        "version": VERSION,
        "camera": camera,
        "sun": { "direction": light.direction, "color": light.color },
        // The colours of a studio are those of its background.
        "sky": (header.surroundings() != Surroundings::Sky).then(|| json!({ "background": header.background, "ambient": light.ambient })),
        "meshes": meshes,
        "instances": instances,
        "ground": ground,
    });
    Ok(deflated(&head, &streams))
}

/// Name of a preview's file: it has a hash of the contents, so the file never changes under it.
#[must_use]
pub fn file_name(contents: &[u8]) -> String {
    format!("preview-{}.bin", &blake3::hash(contents).to_hex()[..16])
}

/// An instance: mesh, translation, rotation, scale.
fn placed(mesh: usize, instance: &Instance) -> Value {
    let placement = &instance.placement;
    let [x, y, z] = placement.translation;
    // f32 in full digits would take twice the bytes of what a preview needs.
    let rounded = |value: f32| (f64::from(value) * 1e5).round() / 1e5;
    let [a, b, c, d] = placement.rotation.map(rounded);
    json!([mesh, x, y, z, a, b, c, d, placement.scale])
}

/// Length of the head, head, streams; as raw DEFLATE (RFC 1951).
fn deflated(head: &Value, streams: &Streams) -> Vec<u8> {
    let head = head.to_string();
    #[expect(clippy::cast_possible_truncation, reason = "bounded by the limits on meshes and instances")]
    let length = (head.len() as u32).to_le_bytes();
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    let parts = [&length[..], head.as_bytes(), streams.bytes()];
    // Writing to memory does not fail.
    let written = parts.iter().try_for_each(|part| encoder.write_all(part));
    written.and_then(|()| encoder.finish()).unwrap_or_default()
}

#[cfg(test)]
mod tests;
