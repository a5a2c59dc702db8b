//! Encodes imported materials and their texture files as an asset's description and blobs.

mod error;
#[cfg(test)]
mod tests;
mod textures;

use crate::preparation_settings::{PreparationSettings, ReliefDepth};
use lodestream_geometry::pool::Pool;
use lodestream_import::srgb::srgb_to_linear;
use lodestream_import::texture::{Level, Opacity, TextureKind, TextureSource, Transparency};
use lodestream_import::{ImportedMaterial, SurfaceMap};
use lodestream_scene::asset::{Alpha, AssetDescription, MAX_NORMAL_SCALE, Material};
use lodestream_scene::limits::MAX_NAME_BYTES;

pub use error::DescribeError;
use textures::{EncodedTexture, Textures};

/// Depth of relief at `-bm 1`, in units of texture coordinates, by default: brick and cobble
/// textures of a metre or two then have joints of a few centimetres.
pub const DEFAULT_RELIEF_DEPTH: f32 = 0.04;
/// Base colour of materials whose colour texture is missing.
pub(super) const FALLBACK_COLOR: [f32; 3] = [0.8; 3];

/// An asset's description with its texture blobs.
#[derive(Clone, Debug)]
pub struct EncodedDescription {
    /// Materials and textures.
    pub description: AssetDescription,
    /// For each texture its levels, coarse first.
    pub textures: Vec<Vec<Level>>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}

/// Describes an asset: reads and encodes the textures of its materials.
///
/// Missing and unreadable textures become warnings, and the material's factors replace them. Equal textures are stored
/// once. The pool does not change the result.
///
/// # Errors
/// See [`DescribeError`].
pub fn describe(
    name: &str,
    materials: &[ImportedMaterial],
    settings: &PreparationSettings,
    pool: &dyn Pool,
) -> Result<EncodedDescription, DescribeError> {
    let mut textures = Textures::new(settings.texture_settings(), pool);
    let materials: Result<Vec<Material>, DescribeError> = materials
        .iter()
        .map(|material| describe_one(material, settings.relief_depth, &mut textures))
        .collect();
    let description =
        AssetDescription { name: truncated(name), materials: materials?, textures: textures.infos };
    // The encoder checks all limits: fail before the preparation, not after it.
    description.encode()?;
    Ok(EncodedDescription { description, textures: textures.levels, warnings: textures.warnings })
}

fn describe_one(
    imported: &ImportedMaterial,
    relief_depth: Option<ReliefDepth>,
    textures: &mut Textures<'_>,
) -> Result<Material, DescribeError> {
    let ImportedMaterial { material, maps, .. } = imported;
    let color = textures.make(color_source(imported))?;
    let surface = (!maps.surface.is_empty()).then(|| TextureSource::Surface(maps.surface.clone()));
    let surface = textures.make(surface)?;
    let apart = maps.occlusion.clone();
    let apart = apart.map(|occlusion| SurfaceMap { occlusion: Some(occlusion), ..SurfaceMap::default() });
    let occlusion = textures.make(apart.map(TextureSource::Surface))?;
    let mut normal = textures.make(maps.normal.clone().map(TextureSource::Normal))?;
    let emission = textures.make(maps.emission.clone().map(TextureSource::opaque))?;
    let mut normal_scale = material.normal_scale;
    let height_scale = maps.height.as_ref().map_or(0.0, |height| height.scale.abs());
    let heights = maps.height.as_ref().map(|height| height.image.clone());
    let mut height = match heights {
        Some(image) if maps.normal.is_none() => textures.heights_or_normals(image)?,
        heights => textures.make(heights.map(TextureSource::Height))?,
    };
    if height.as_ref().is_some_and(|made| made.of.kind() == TextureKind::Normal) {
        (normal, normal_scale) = (height.take(), height_scale.min(MAX_NORMAL_SCALE));
    }

    let [r, g, b, opacity] = material.base_color;
    let missing = maps.color.is_some() && !has_colors(color.as_ref());
    let [r, g, b] =
        if missing && [r, g, b] == [1.0; 3] { FALLBACK_COLOR.map(srgb_to_linear) } else { [r, g, b] };
    // Factors multiply their maps: with the maps missing, everything would be metallic or emissive.
    let metallic =
        if has_metal(surface.as_ref()) == maps.surface.metallic.is_some() { material.metallic } else { 0.0 };
    let shines = emission.is_some() == maps.emission.is_some();
    let depth = relief_depth.map_or(DEFAULT_RELIEF_DEPTH * height_scale, ReliefDepth::get);
    Ok(Material {
        name: truncated(&material.name),
        base_color: [r, g, b, opacity],
        metallic,
        emission: if shines { material.emission } else { [0.0; 3] },
        alpha: alpha(imported, color.as_ref()),
        base_color_texture: index(color.as_ref()),
        surface_texture: index(surface.as_ref()),
        occlusion_texture: index(occlusion.as_ref()),
        normal_scale: if normal.is_some() { normal_scale } else { 1.0 },
        normal_texture: index(normal.as_ref()),
        emission_texture: index(emission.as_ref()),
        relief_depth: if height.is_some() { depth.clamp(0.0, 1.0) } else { 0.0 },
        height_texture: index(height.as_ref()),
        ..*material
    })
}

/// Source of a material's colour texture, with the use of its opacity.
fn color_source(imported: &ImportedMaterial) -> Option<TextureSource> {
    let ImportedMaterial { material, maps, alpha_from_map } = imported;
    if maps.color.is_none() && maps.opacity.is_none() {
        return None;
    }
    let used = match material.alpha {
        _ if *alpha_from_map => Opacity::Guessed,
        Alpha::Opaque => Opacity::Ignored,
        // The texture's opacity is compared after it is multiplied by the material's.
        Alpha::Mask(cutoff) => {
            let opacity = material.base_color[3].max(f32::MIN_POSITIVE);
            Opacity::Tested((255.0 * cutoff / opacity).ceil().min(255.0) as u8)
        }
        Alpha::Blend => Opacity::Blended,
    };
    Some(TextureSource::Color { image: maps.color.clone(), opacity: maps.opacity.clone(), used })
}

/// The alpha mode: as stated, or by the texels of the opacity map.
fn alpha(imported: &ImportedMaterial, color: Option<&EncodedTexture>) -> Alpha {
    match color.map(|made| made.transparency) {
        Some(Transparency::Graded) if imported.alpha_from_map => Alpha::Blend,
        Some(Transparency::Holes) if imported.alpha_from_map => Alpha::Mask(0.5),
        _ => imported.material.alpha,
    }
}

fn index(made: Option<&EncodedTexture>) -> Option<u16> {
    made.map(|made| made.index)
}

fn has_colors(made: Option<&EncodedTexture>) -> bool {
    matches!(made, Some(EncodedTexture { of: TextureSource::Color { image: Some(_), .. }, .. }))
}

fn has_metal(made: Option<&EncodedTexture>) -> bool {
    matches!(made, Some(EncodedTexture { of: TextureSource::Surface(map), .. }) if map.metallic.is_some())
}

/// A name cut to what the protocol carries, between characters.
pub(super) fn truncated(name: &str) -> String {
    name[..name.floor_char_boundary(MAX_NAME_BYTES)].to_owned()
}
