//! Encodes imported materials and their texture files as an asset's description and blobs.

mod error;
#[cfg(test)]
mod tests;
mod textures;

use crate::preparation_settings::ReliefDepth;
use lodestream_import::srgb::srgb_to_linear;
use lodestream_import::texture::{Opacity, TextureKind, TextureSource, Transparency};
use lodestream_scene::asset::{Alpha, AssetDescription, MAX_NORMAL_SCALE, Material};
use lodestream_scene::limits::MAX_NAME_BYTES;

pub use error::DescribeError;
use textures::{EncodedTexture, Textures};

/// Depth of relief at `-bm 1`, in units of texture coordinates, by default: brick and cobble
/// textures of a metre or two then have joints of a few centimetres.
pub const DEFAULT_RELIEF_DEPTH: f32 = 0.04;
/// Base colour of materials whose colour texture is missing.
const FALLBACK_COLOR: [f32; 3] = [0.8; 3];

/// An asset's description with its texture blobs.
#[derive(Clone, Debug)]
pub struct EncodedDescription {
    /// Materials and textures.
    pub description: AssetDescription,
    /// For each texture its levels, coarse first.
    pub textures: Vec<Vec<Vec<u8>>>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}

/// Describes an asset: reads and encodes the textures of its materials.
///
/// Missing and unreadable textures become warnings, and the material's factors replace them. Equal textures are stored
/// once.
///
/// # Errors
/// See [`DescribeError`].
pub fn describe(
    name: &str,
    materials: &[lodestream_import::Material],
    relief_depth: Option<ReliefDepth>,
) -> Result<EncodedDescription, DescribeError> {
    let mut textures = Textures::default();
    let materials: Result<Vec<Material>, DescribeError> =
        materials.iter().map(|material| describe_one(material, relief_depth, &mut textures)).collect();
    let description =
        AssetDescription { name: truncated(name), materials: materials?, textures: textures.infos };
    // The encoder checks all limits: fail before the preparation, not after it.
    description.encode()?;
    Ok(EncodedDescription { description, textures: textures.levels, warnings: textures.warnings })
}

fn describe_one(
    material: &lodestream_import::Material,
    relief_depth: Option<ReliefDepth>,
    textures: &mut Textures,
) -> Result<Material, DescribeError> {
    let color = textures.make(color_source(material))?;
    let surface = (!material.surface.is_empty()).then(|| TextureSource::Surface(material.surface.clone()));
    let surface = textures.make(surface)?;
    let mut normal = textures.make(material.normal_texture.clone().map(TextureSource::Normal))?;
    let emission = textures.make(material.emission_texture.clone().map(TextureSource::opaque))?;
    let mut normal_scale = material.normal_scale;
    let mut height = match &material.height_texture {
        Some(image) if material.normal_texture.is_none() => textures.heights_or_normals(image.clone())?,
        other => textures.make(other.clone().map(TextureSource::Height))?,
    };
    if height.as_ref().is_some_and(|made| made.of.kind() == TextureKind::Normal) {
        (normal, normal_scale) = (height.take(), material.height_scale.abs().min(MAX_NORMAL_SCALE));
    }

    let mut base_color = material.base_color;
    if material.color_texture.is_some() && !has_colors(color.as_ref()) && base_color == [1.0; 3] {
        base_color = FALLBACK_COLOR.map(srgb_to_linear);
    }
    // Factors multiply their maps: with the maps missing, everything would be metallic or emissive.
    let metallic = if has_metal(surface.as_ref()) == material.surface.metallic.is_some() {
        material.metallic
    } else {
        0.0
    };
    let shines = emission.is_some() == material.emission_texture.is_some();
    let [r, g, b] = base_color;
    let depth = relief_depth.map_or(DEFAULT_RELIEF_DEPTH * material.height_scale.abs(), ReliefDepth::get);
    Ok(Material {
        name: truncated(&material.name),
        base_color: [r, g, b, material.opacity],
        roughness: material.roughness,
        metallic,
        emission: if shines { material.emission } else { [0.0; 3] },
        alpha: alpha(material.alpha, color.as_ref()),
        unlit: material.unlit,
        wrap: material.wrap,
        base_color_texture: index(color.as_ref()),
        surface_texture: index(surface.as_ref()),
        normal_scale: if normal.is_some() { normal_scale } else { 1.0 },
        normal_texture: index(normal.as_ref()),
        emission_texture: index(emission.as_ref()),
        relief_depth: if height.is_some() { depth.clamp(0.0, 1.0) } else { 0.0 },
        height_texture: index(height.as_ref()),
    })
}

/// Source of a material's colour texture, with the use of its opacity.
fn color_source(material: &lodestream_import::Material) -> Option<TextureSource> {
    let (image, opacity) = (material.color_texture.clone(), material.opacity_texture.clone());
    if image.is_none() && opacity.is_none() {
        return None;
    }
    let used = match material.alpha {
        lodestream_import::Alpha::Opaque => Opacity::Ignored,
        // The texture's opacity is compared after it is multiplied by the material's.
        lodestream_import::Alpha::Mask(cutoff) => {
            Opacity::Tested((255.0 * cutoff / material.opacity.max(f32::MIN_POSITIVE)).ceil().min(255.0) as u8)
        }
        lodestream_import::Alpha::Blend => Opacity::Blended,
        lodestream_import::Alpha::Guess => Opacity::Guessed,
    };
    Some(TextureSource::Color { image, opacity, used })
}

fn alpha(alpha: lodestream_import::Alpha, color: Option<&EncodedTexture>) -> Alpha {
    match (alpha, color.map(|made| made.transparency)) {
        (lodestream_import::Alpha::Mask(cutoff), _) => Alpha::Mask(cutoff),
        (lodestream_import::Alpha::Blend, _)
        | (lodestream_import::Alpha::Guess, Some(Transparency::Graded)) => Alpha::Blend,
        (lodestream_import::Alpha::Guess, Some(Transparency::Holes)) => Alpha::Mask(0.5),
        (lodestream_import::Alpha::Opaque | lodestream_import::Alpha::Guess, _) => Alpha::Opaque,
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
fn truncated(name: &str) -> String {
    name[..name.floor_char_boundary(MAX_NAME_BYTES)].to_owned()
}
