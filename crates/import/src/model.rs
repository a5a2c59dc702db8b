//! The result of an import: a mesh and the materials of its faces.

use std::path::PathBuf;

use bytes::Bytes;
use lodestream_geometry::mesh::SourceMesh;
use lodestream_scene::asset::Wrap;

use crate::srgb::srgb_to_linear;

/// The part of a model file to import.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Part {
    /// Everything as one mesh; of a glTF file, every mesh of its scene in its place.
    #[default]
    Whole,
    /// One mesh of a glTF file.
    Mesh {
        /// Its index in the file.
        mesh: usize,
        /// Columns of a linear map that is applied to it.
        linear: [[f64; 3]; 3],
    },
}

/// An image that a material uses: a file, or bytes of a model file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ImageSource {
    /// The file; where `bytes` are given, a name for messages.
    pub path: PathBuf,
    /// The bytes of a PNG or JPEG file, where they were in the model.
    pub bytes: Option<Bytes>,
}

impl From<PathBuf> for ImageSource {
    fn from(path: PathBuf) -> Self {
        Self { path, bytes: None }
    }
}

/// The component of an image's texels that a channel reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Component {
    /// The first channel.
    Red,
    /// The second.
    Green,
    /// The third.
    Blue,
    /// Opacity; 1 in an image without.
    Alpha,
    /// Grey, or the luminance of a colour.
    Luminance,
    /// Opacity where any texel is transparent, else luminance: the two ways in which masks are drawn.
    Mask,
}

/// One value for each texel of an image: `1 + strength · (v − 1)`, where `v` is the component, or one minus it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Channel {
    /// The image.
    pub image: ImageSource,
    /// The component.
    pub component: Component,
    /// Whether to invert the component (glossiness to roughness).
    pub inverted: bool,
    /// Strength, in steps of 1/65535.
    pub strength: u16,
}

impl Channel {
    /// A component, neither inverted nor weakened.
    #[must_use]
    pub fn plain(image: ImageSource, component: Component) -> Self {
        Self { image, component, inverted: false, strength: u16::MAX }
    }
}

/// Sources of a surface texture's channels; a channel without a source is 1.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct SurfaceMap {
    /// How open to ambient light (glTF's `occlusionTexture`).
    pub occlusion: Option<Channel>,
    /// Factor on the roughness (glTF's `metallicRoughnessTexture`, `map_Pr`).
    pub roughness: Option<Channel>,
    /// Factor on the metal (glTF's `metallicRoughnessTexture`, `map_Pm`).
    pub metallic: Option<Channel>,
}

impl SurfaceMap {
    /// Its channels, as a surface texture has them: red, green, blue.
    #[must_use]
    pub fn channels(&self) -> [Option<&Channel>; 3] {
        [self.occlusion.as_ref(), self.roughness.as_ref(), self.metallic.as_ref()]
    }

    /// Whether no channel has a source.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.channels().iter().all(Option::is_none)
    }
}

/// Use of a material's opacity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Alpha {
    /// Ignored.
    #[default]
    Opaque,
    /// Alpha test: visible where opacity is at least this, in `0..=1`.
    Mask(f32),
    /// Blended with what is behind.
    Blend,
    /// Chosen by the texture ([`crate::texture::Transparency`]): an alpha test at 0.5 if nearly every texel is opaque or
    /// transparent, else blending.
    Guess,
}

/// A material. Its maps share one set of texture coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// Base colour, linear, in `0..=1` (`Kd`, which editors write sRGB-encoded; glTF's factor).
    pub base_color: [f32; 3],
    /// Opacity in `0..=1` (`d`).
    pub opacity: f32,
    /// Perceptual roughness in `0..=1` (`Pr`, or from `Ns`).
    pub roughness: f32,
    /// Metal in `0..=1` (`Pm`).
    pub metallic: f32,
    /// Emitted light, linear, in `0..=`[`MAX_EMISSION`](lodestream_scene::asset::MAX_EMISSION) (`Ke`).
    pub emission: [f32; 3],
    /// Use of the opacity.
    pub alpha: Alpha,
    /// Whether the material is drawn without lighting (`illum 0`; `KHR_materials_unlit`).
    pub unlit: bool,
    /// Wrap modes of the maps along u and v.
    pub wrap: [Wrap; 2],
    /// Colour texture (`map_Kd`; `baseColorTexture`).
    pub color_texture: Option<ImageSource>,
    /// Opacity of the colour texture, instead of its own (`map_d`).
    pub opacity_texture: Option<Channel>,
    /// Occlusion, roughness and metal.
    pub surface: SurfaceMap,
    /// Normal map: x along u, y along v upwards, z out of the surface (`norm`; `normalTexture`).
    ///
    /// glTF's v runs down the image, but its y runs up: "the normal vectors use the convention +X is right and +Y is
    /// up" (specification 2.0, `material.normalTexture`), which is what makes shaders that take tangents from v-down
    /// coordinates turn green around (three.js, pull request 13784). Coordinates are v-up here, so texels stay as
    /// they are.
    pub normal_texture: Option<ImageSource>,
    /// Factor on x and y of the normal map (`-bm`); 1 where not given.
    pub normal_scale: f32,
    /// Texture of emitted colours (`map_Ke`; `emissiveTexture`).
    pub emission_texture: Option<ImageSource>,
    /// Height texture (`map_Bump`, `bump` or `disp`; glTF has none).
    pub height_texture: Option<ImageSource>,
    /// Factor on the heights (`-bm`); 1 where not given.
    pub height_scale: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".to_owned(),
            base_color: [srgb_to_linear(0.8); 3],
            opacity: 1.0,
            roughness: 0.6,
            metallic: 0.0,
            emission: [0.0; 3],
            alpha: Alpha::Opaque,
            unlit: false,
            wrap: [Wrap::Repeat; 2],
            color_texture: None,
            opacity_texture: None,
            surface: SurfaceMap::default(),
            normal_texture: None,
            normal_scale: 1.0,
            emission_texture: None,
            height_texture: None,
            height_scale: 1.0,
        }
    }
}

impl Material {
    /// The images of all maps, in the order of the fields; an image may occur twice.
    pub fn images(&self) -> impl Iterator<Item = &ImageSource> {
        let channels = [self.opacity_texture.as_ref()].into_iter().chain(self.surface.channels());
        let whole = [&self.normal_texture, &self.emission_texture, &self.height_texture];
        let channels = channels.flatten().map(|channel| &channel.image);
        self.color_texture.iter().chain(channels).chain(whole.into_iter().flatten())
    }
}

/// An imported model.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The mesh; its `materials` index [`Imported::materials`].
    pub mesh: SourceMesh,
    /// Materials that at least one face uses.
    pub materials: Vec<Material>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}
