//! Statistics of a pack.

use std::path::Path;

use lodestream_geometry::mesh::NO_COLOR;
use lodestream_geometry::mesh::components::components;
use lodestream_scene::asset::{Alpha, AssetDescription, Material, TextureKind};
use serde::Serialize;

use lodestream_store::{PackFile, StoreError};

/// Statistics of a pack; lengths are in the asset's units.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Preparation settings.
    pub settings: String,
    /// Vertices that a face uses, after welding.
    pub vertices: u64,
    /// Faces.
    pub faces: u64,
    /// Wedges.
    pub wedges: u64,
    /// Wedges that carry a normal; the others' is derived from the faces.
    pub explicit_normals: u64,
    /// Whether any wedge has a colour.
    pub colors: bool,
    /// Parts of the mesh that share no vertex with each other.
    pub components: u64,
    /// Materials.
    pub materials: u64,
    /// Materials with an alpha test.
    pub masked_materials: u64,
    /// Transparent materials.
    pub blended_materials: u64,
    /// Unlit materials.
    pub unlit_materials: u64,
    /// Materials whose faces are shaded by their own normals.
    pub flat_materials: u64,
    /// Emissive materials.
    pub emissive_materials: u64,
    /// Metallic materials.
    pub metallic_materials: u64,
    /// Textures, of every kind.
    pub textures: u64,
    /// Textures of colours, emitted ones too.
    pub color_textures: u64,
    /// Height maps.
    pub height_textures: u64,
    /// Normal maps.
    pub normal_textures: u64,
    /// Textures of occlusion, roughness and metal.
    pub surface_textures: u64,
    /// Codec of base mesh and chunks.
    pub codec: String,
    /// Bits per axis of positions.
    pub position_bits: u8,
    /// Bits per axis of texture coordinates; 0 without any.
    pub uv_bits: u8,
    /// Levels above the base mesh.
    pub levels: u8,
    /// Chunks.
    pub chunks: u64,
    /// Faces of the base mesh.
    pub base_faces: u64,
    /// Vertices of the base mesh.
    pub base_vertices: u64,
    /// Length of the base blob.
    pub base_bytes: u64,
    /// Length of all index pages.
    pub index_bytes: u64,
    /// Length of all chunks.
    pub payload_bytes: u64,
    /// Length of all texture levels.
    pub texture_bytes: u64,
    /// Length of the pack.
    pub total_bytes: u64,
    /// Bits of base, index and chunks per vertex: what streaming the geometry whole takes.
    pub bits_per_vertex: f64,
    /// Geometric error of the base mesh.
    pub base_error: f64,
    /// Diagonal of the bounding box.
    pub diagonal: f64,
    /// Size of a grid cell.
    pub grid_step: f64,
}

/// Reads a whole pack, verifies every blob, and counts.
///
/// # Errors
/// A file that is not a pack, or damaged.
pub fn inspect(path: &Path) -> Result<Summary, StoreError> {
    let pack = PackFile::open(path)?;
    let texture_bytes = pack.verify_textures()?;
    let asset = pack.load()?;
    let mesh = asset.refined(&asset.everything()).map_err(|source| pack.damaged(source))?.to_mesh();
    let faces: Vec<[u32; 3]> =
        mesh.faces.iter().map(|face| face.wedges.map(|w| mesh.wedges[w as usize].vertex)).collect();
    let attributes = || mesh.wedges.iter().map(|wedge| wedge.attributes);
    let payload_bytes = asset.payload_bytes;
    let base = &asset.base;
    let AssetDescription { materials, textures, .. } = &asset.description;
    let materials = |of: &dyn Fn(&Material) -> bool| materials.iter().filter(|m| of(m)).count() as u64;
    let textures = |kind| textures.iter().filter(|texture| texture.kind == kind).count() as u64;
    Ok(Summary {
        settings: pack.settings()?,
        vertices: base.totals.vertices,
        faces: base.totals.faces,
        wedges: base.totals.wedges,
        explicit_normals: attributes().filter(|a| a.normal.is_some()).count() as u64,
        colors: attributes().any(|a| a.color != NO_COLOR),
        components: count_components(mesh.positions.len(), &faces),
        materials: u64::from(base.material_count),
        masked_materials: materials(&|m| matches!(m.alpha, Alpha::Mask(_))),
        blended_materials: materials(&|m| m.alpha == Alpha::Blend),
        unlit_materials: materials(&|m| m.unlit),
        flat_materials: materials(&|m| m.flat),
        emissive_materials: materials(&|m| m.emission != [0.0; 3]),
        metallic_materials: materials(&|m| m.metallic > 0.0),
        textures: asset.description.textures.len() as u64,
        color_textures: textures(TextureKind::Color),
        height_textures: textures(TextureKind::Height),
        normal_textures: textures(TextureKind::Normal),
        surface_textures: textures(TextureKind::Surface),
        codec: base.codec.to_string(),
        position_bits: base.grid.bits,
        uv_bits: base.uv_grid.bits,
        levels: base.level_count,
        chunks: u64::from(base.chunk_count),
        base_faces: base.faces.len() as u64,
        base_vertices: base.positions.len() as u64,
        base_bytes: asset.base_bytes,
        index_bytes: asset.index_bytes,
        payload_bytes,
        texture_bytes,
        total_bytes: pack.total_bytes(),
        bits_per_vertex: 8.0 * (asset.head_bytes() + payload_bytes) as f64
            / base.totals.vertices.max(1) as f64,
        base_error: f64::from(base.geometric_error),
        diagonal: f64::from(base.diagonal),
        grid_step: base.grid.step,
    })
}

/// Number of connected components.
fn count_components(vertices: usize, faces: &[[u32; 3]]) -> u64 {
    let least = components(vertices, faces);
    least.iter().zip(0..).filter(|&(&least, v)| least == v).count() as u64
}
