//! Sizes of meshes as a file states them, without reading vertices: what decides which meshes are gathered into batches.

use gltf::json::material::AlphaMode;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;

use gltf::json::accessor::Type;

use super::accessor::Buffers;
use super::container::Document;
use super::root::{Mesh, Primitive};

/// Most primitives of a mesh in a batch, since a batch has a limited number of materials.
const MAX_PRIMITIVES: usize = 4;

/// Largest absolute texture coordinate of a mesh in a batch, in repeats of its textures. The finest grid of a batch then
/// has cells of 1/4096 of a repeat.
const MAX_UV: f64 = 8.0;

/// Faces and bounds of a mesh, about its own origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSize {
    /// Triangles, as indices or vertices say.
    pub faces: usize,
    /// Least coordinates.
    pub low: [f64; 3],
    /// Largest coordinates.
    pub high: [f64; 3],
    /// Least and largest texture coordinates, v up, of its primitives with textures.
    pub uvs: Option<[[f64; 2]; 2]>,
}

/// What a file states of a part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PartSize {
    /// Triangles, over all members of a batch.
    pub faces: usize,
}

/// What the file states of some of its meshes.
pub(super) fn of_part(document: &Document, meshes: impl Iterator<Item = usize>) -> PartSize {
    let primitives =
        meshes.filter_map(|mesh| document.root.meshes.get(mesh)).flat_map(|mesh| mesh.primitives.iter());
    primitives.fold(PartSize::default(), |size, primitive| PartSize {
        faces: size.faces.saturating_add(corners(document, primitive).unwrap_or(0) / 3),
    })
}

/// Corners of a primitive, as its indices or vertices say.
fn corners(document: &Document, primitive: &Primitive) -> Option<usize> {
    let positions = primitive.attribute(&Semantic::Positions)?;
    let accessor = document.root.accessors.get(primitive.indices.unwrap_or(positions).value())?;
    usize::try_from(accessor.count).ok()
}

/// The least and largest of two ranges of texture coordinates.
#[must_use]
pub fn join_uvs(one: Option<[[f64; 2]; 2]>, other: Option<[[f64; 2]; 2]>) -> Option<[[f64; 2]; 2]> {
    let (Some(a), Some(b)) = (one, other) else { return one.or(other) };
    Some([[0, 1].map(|axis| a[0][axis].min(b[0][axis])), [0, 1].map(|axis| a[1][axis].max(b[1][axis]))])
}

/// The size of each mesh; `None` where the file does not state it, as in a pose, and for meshes that blend, since blended objects are
/// drawn by distance, and whose texture coordinates need a grid of their own: beyond 8 repeats, transformed, compressed.
pub(super) fn of_meshes(document: &Document) -> Vec<Option<MeshSize>> {
    let mut buffers = Buffers::new(document);
    let mut size = |mesh: &Mesh| {
        if !mesh.pose.is_plain() {
            return None;
        }
        let parts: Option<Vec<MeshSize>> =
            mesh.primitives.iter().map(|primitive| of_primitive(document, &mut buffers, primitive)).collect();
        parts.filter(|parts| parts.len() <= MAX_PRIMITIVES)?.into_iter().reduce(|one, other| MeshSize {
            faces: one.faces.saturating_add(other.faces),
            low: [0, 1, 2].map(|axis| one.low[axis].min(other.low[axis])),
            high: [0, 1, 2].map(|axis| one.high[axis].max(other.high[axis])),
            uvs: join_uvs(one.uvs, other.uvs),
        })
    };
    document.root.meshes.iter().map(&mut size).collect()
}

fn of_primitive(document: &Document, buffers: &mut Buffers<'_>, primitive: &Primitive) -> Option<MeshSize> {
    if primitive.mode() != Some(Mode::Triangles) {
        return None;
    }
    let uvs = match lookup(document, primitive)? {
        Lookup::None => None,
        Lookup::Set(set) => Some(uv_range(document, buffers, primitive, set)?),
    };
    let accessor = |index: usize| document.root.accessors.get(index);
    let positions = accessor(primitive.attribute(&Semantic::Positions)?.value())?;
    if positions.normalized {
        return None;
    }
    let faces = corners(document, primitive)? / 3;
    let [low, high] = *positions.bounds.as_deref()?;
    Some(MeshSize { faces, low, high, uvs })
}

/// How the textures of a material are looked up.
enum Lookup {
    /// It has none.
    None,
    /// All by TEXCOORD_n, untransformed.
    Set(u32),
}

/// `None` for a material that blends, or whose textures have extensions or different coordinates.
fn lookup(document: &Document, primitive: &Primitive) -> Option<Lookup> {
    let Some(material) = primitive.material else { return Some(Lookup::None) };
    let material = document.root.materials.get(material.value())?;
    // Extensions may name other textures, or blend.
    let is_extended = material.extensions.as_ref().is_some_and(|extensions| {
        extensions.pbr_specular_glossiness.is_some()
            || extensions.transmission.is_some()
            || !extensions.others.is_empty()
    });
    if is_extended || matches!(material.alpha_mode, Checked::Valid(AlphaMode::Blend)) {
        return None;
    }
    let metallic = &material.pbr_metallic_roughness;
    let colors =
        [&metallic.base_color_texture, &metallic.metallic_roughness_texture, &material.emissive_texture];
    let colors = colors.into_iter().flatten().map(|map| (map.tex_coord, map.extensions.is_some()));
    let normal = material.normal_texture.iter().map(|map| (map.tex_coord, map.extensions.is_some()));
    let occlusion = material.occlusion_texture.iter().map(|map| (map.tex_coord, map.extensions.is_some()));
    let mut found = Lookup::None;
    for (set, is_extended) in colors.chain(normal).chain(occlusion) {
        if is_extended || matches!(found, Lookup::Set(other) if other != set) {
            return None;
        }
        found = Lookup::Set(set);
    }
    Some(found)
}

/// Least and largest texture coordinates of a primitive, v up; `None` if they are compressed, damaged, or beyond
/// [`MAX_UV`].
fn uv_range(
    document: &Document,
    buffers: &mut Buffers<'_>,
    primitive: &Primitive,
    set: u32,
) -> Option<[[f64; 2]; 2]> {
    let index = primitive.attribute(&Semantic::TexCoords(set))?.value();
    // A compressed accessor has no view.
    document.root.accessors.get(index)?.buffer_view?;
    let elements = buffers.open(index, "texture coordinates", &[Type::Vec2]).ok()?;
    let points = (0..elements.len()).map(|i| elements.get::<2>(i)).map(|[u, v]| [u, 1.0 - v]);
    let mut range = None;
    for point in points {
        if !point.iter().all(|number| number.abs() <= MAX_UV) {
            return None;
        }
        range = join_uvs(range, Some([point; 2]));
    }
    range
}
