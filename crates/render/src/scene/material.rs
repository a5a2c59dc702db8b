//! Materials.

use lodestream_scene::asset as protocol;
pub use lodestream_scene::asset::{Alpha, Wrap};

use crate::resources::texture::{TextureKind, TextureShape};

/// A metallic–roughness material as in glTF 2.0. Textures are indices among the asset's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Colour, linear; multiplied with the colour texture.
    pub base_colour: [f32; 3],
    /// 0 to 1; multiplied with the colour texture's.
    pub opacity: f32,
    /// Alpha mode.
    pub alpha: Alpha,
    /// Perceptual: 0 = mirror-like highlights, 1 = matt; multiplied with the surface texture's green.
    pub roughness: f32,
    /// 0 = like glass or plastic, 1 = metal of that colour; multiplied with the surface texture's blue.
    pub metallic: f32,
    /// Emitted linear radiance; multiplied with the emission texture.
    pub emission: [f32; 3],
    /// Shows the base colour without lighting and without emission.
    pub unlit: bool,
    /// Wrap modes of the textures along u and v.
    pub wrap: [Wrap; 2],
    /// Depth of the height map below the surface, in units of texture coordinates (0.05 = a
    /// twentieth of the texture's width); 0 = no relief.
    pub relief_depth: f32,
    /// Factor on the slopes of the normal map.
    pub normal_scale: f32,
    /// A [`TextureKind::Colour`].
    pub colour_texture: Option<usize>,
    /// A [`TextureKind::Surface`].
    pub surface_texture: Option<usize>,
    /// A [`TextureKind::Normal`].
    pub normal_texture: Option<usize>,
    /// A [`TextureKind::Colour`].
    pub emission_texture: Option<usize>,
    /// A [`TextureKind::Height`].
    pub height_texture: Option<usize>,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            base_colour: [0.7; 3],
            opacity: 1.0,
            alpha: Alpha::Opaque,
            roughness: 0.8,
            metallic: 0.0,
            emission: [0.0; 3],
            unlit: false,
            wrap: [Wrap::Repeat; 2],
            relief_depth: 0.0,
            normal_scale: 1.0,
            colour_texture: None,
            surface_texture: None,
            normal_texture: None,
            emission_texture: None,
            height_texture: None,
        }
    }
}

impl Material {
    /// Whether the material uses a texture.
    pub(crate) fn uses(&self, texture: usize) -> bool {
        [
            self.colour_texture,
            self.surface_texture,
            self.normal_texture,
            self.emission_texture,
            self.height_texture,
        ]
        .contains(&Some(texture))
    }

    /// Whether the material emits light.
    pub(crate) fn emits(&self) -> bool {
        !self.unlit && self.emission.iter().any(|&light| light > 0.0)
    }
}

impl From<&protocol::Material> for Material {
    fn from(m: &protocol::Material) -> Self {
        let [r, g, b, opacity] = m.base_color;
        Self {
            base_colour: [r, g, b],
            opacity,
            alpha: m.alpha,
            roughness: m.roughness,
            metallic: m.metallic,
            emission: m.emission,
            unlit: m.unlit,
            wrap: m.wrap,
            relief_depth: m.relief_depth,
            normal_scale: m.normal_scale,
            colour_texture: m.base_color_texture.map(usize::from),
            surface_texture: m.surface_texture.map(usize::from),
            normal_texture: m.normal_texture.map(usize::from),
            emission_texture: m.emission_texture.map(usize::from),
            height_texture: m.height_texture.map(usize::from),
        }
    }
}

/// Linear light of an sRGB byte (IEC 61966-2-1).
fn from_srgb(encoded: u8) -> f32 {
    let encoded = f32::from(encoded) / 255.0;
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

impl From<&protocol::TextureInfo> for TextureShape {
    fn from(t: &protocol::TextureInfo) -> Self {
        let kind = match t.kind {
            protocol::TextureKind::Color => TextureKind::Colour,
            protocol::TextureKind::Height => TextureKind::Height,
            protocol::TextureKind::Normal => TextureKind::Normal,
            protocol::TextureKind::Surface => TextureKind::Surface,
        };
        let decode = |encoded| match kind {
            TextureKind::Colour => from_srgb(encoded),
            _ => f32::from(encoded) / 255.0,
        };
        let mean = t.mean.map_or([1.0; 3], |mean| mean.map(decode));
        Self { width: t.width, height: t.height, levels: t.levels.len() as u32, kind, mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_colour_is_linear_and_white_where_none_is_said() {
        let info = |mean| protocol::TextureInfo {
            kind: protocol::TextureKind::Color,
            width: 8,
            height: 8,
            mean,
            levels: vec![protocol::TextureLevel {
                width: 8,
                height: 8,
                bytes: 100,
                format: protocol::TextureFormat::Png,
            }],
        };
        assert_eq!(TextureShape::from(&info(None)).mean, [1.0; 3]);
        let [r, g, b] = TextureShape::from(&info(Some([255, 188, 10]))).mean;
        assert!(
            (r - 1.0).abs() < 1e-6 && (g - 0.5029).abs() < 1e-4 && (b - 0.003_035).abs() < 1e-6,
            "{r} {g} {b}"
        );
    }
}
