//! Sizes of meshes as a file states them, without reading vertices: what decides which meshes are gathered into batches.

use gltf::json;
use gltf::json::material::AlphaMode;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::container::Document;

/// Most primitives of a mesh in a batch, since a batch has a limited number of materials.
const MAX_PRIMITIVES: usize = 4;

/// Faces and bounds of a mesh, about its own origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSize {
    /// Triangles, as indices or vertices say.
    pub faces: usize,
    /// Least coordinates.
    pub low: [f64; 3],
    /// Largest coordinates.
    pub high: [f64; 3],
}

/// What a file states of a part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PartSize {
    /// Triangles, over all members of a batch.
    pub faces: usize,
    /// Whether it has textures, blends, or may for all that is known.
    pub textured: bool,
}

/// What the file states of some of its meshes.
pub(super) fn of_part(document: &Document, meshes: impl Iterator<Item = usize>) -> PartSize {
    let primitives =
        meshes.filter_map(|mesh| document.root.meshes.get(mesh)).flat_map(|mesh| &mesh.primitives);
    primitives.fold(PartSize::default(), |size, primitive| PartSize {
        faces: size.faces.saturating_add(corners(document, primitive).unwrap_or(0) / 3),
        textured: size.textured || !is_plain(document, primitive),
    })
}

/// Corners of a primitive, as its indices or vertices say.
fn corners(document: &Document, primitive: &Primitive) -> Option<usize> {
    let positions = *primitive.attributes.get(&Checked::Valid(Semantic::Positions))?;
    let accessor = document.root.accessors.get(primitive.indices.unwrap_or(positions).value())?;
    usize::try_from(accessor.count.0).ok()
}

/// The size of each mesh; `None` where the file does not state it, and for meshes with textures or blending: texture
/// coordinates would share a grid, and blended objects are drawn by distance.
pub(super) fn of_meshes(document: &Document) -> Vec<Option<MeshSize>> {
    let size = |mesh: &json::Mesh| {
        let parts: Option<Vec<MeshSize>> =
            mesh.primitives.iter().map(|primitive| of_primitive(document, primitive)).collect();
        parts.filter(|parts| parts.len() <= MAX_PRIMITIVES)?.into_iter().reduce(|one, other| MeshSize {
            faces: one.faces.saturating_add(other.faces),
            low: [0, 1, 2].map(|axis| one.low[axis].min(other.low[axis])),
            high: [0, 1, 2].map(|axis| one.high[axis].max(other.high[axis])),
        })
    };
    document.root.meshes.iter().map(size).collect()
}

fn of_primitive(document: &Document, primitive: &Primitive) -> Option<MeshSize> {
    if !matches!(primitive.mode, Checked::Valid(Mode::Triangles)) || !is_plain(document, primitive) {
        return None;
    }
    let accessor = |index: usize| document.root.accessors.get(index);
    let positions = accessor(primitive.attributes.get(&Checked::Valid(Semantic::Positions))?.value())?;
    if positions.normalized {
        return None;
    }
    let point = |value: &Option<json::Value>| {
        let numbers = value.as_ref()?.as_array()?;
        let [x, y, z] = [0, 1, 2].map(|axis| numbers.get(axis).and_then(json::Value::as_f64));
        Some([x?, y?, z?]).filter(|point| point.iter().all(|number| number.is_finite()))
    };
    let faces = corners(document, primitive)? / 3;
    Some(MeshSize { faces, low: point(&positions.min)?, high: point(&positions.max)? })
}

/// Whether its material has no textures and does not blend.
fn is_plain(document: &Document, primitive: &Primitive) -> bool {
    let Some(material) = primitive.material else { return true };
    let Some(material) = document.root.materials.get(material.value()) else { return false };
    let metallic = &material.pbr_metallic_roughness;
    let textured = metallic.base_color_texture.is_some()
        || metallic.metallic_roughness_texture.is_some()
        || material.normal_texture.is_some()
        || material.occlusion_texture.is_some()
        || material.emissive_texture.is_some()
        // An extension may name others.
        || material.extensions.as_ref().is_some_and(|extensions| !extensions.others.is_empty());
    let transmits = matches!(material.alpha_mode, Checked::Valid(AlphaMode::Blend));
    !textured && !transmits
}
