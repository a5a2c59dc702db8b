//! The result of an import: a mesh and the materials of its faces.

use std::path::PathBuf;
use std::sync::Arc;

use bytes::Bytes;
use lodestream_geometry::mesh::SourceMesh;
use lodestream_scene::asset::Material;

use crate::srgb::srgb_to_linear;

/// The part of a model file to import.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Part {
    /// Everything as one mesh; of a glTF file, every mesh of its scene in its place, each a part of its own.
    #[default]
    Whole,
    /// One mesh of a glTF file.
    Mesh {
        /// Its index in the file.
        mesh: usize,
        /// Columns of a linear map that is applied to it.
        linear: [[f64; 3]; 3],
    },
    /// Several meshes of a glTF file, in their places, as one.
    Batch(Arc<[BatchMember]>),
}

/// A mesh in a batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchMember {
    /// Its index in the file.
    pub mesh: usize,
    /// Columns of the map from the mesh to the file's scene.
    pub to_scene: [[f64; 4]; 4],
}

/// An image that a material uses: a file, or bytes of a model file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ImageSource {
    /// The file; where `bytes` are given, a name for messages.
    pub path: PathBuf,
    /// The bytes of a PNG, JPEG, WebP, AVIF or KTX2 file, where they were in the model.
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

/// A height map (`map_Bump`, `bump` or `disp`; glTF has none).
#[derive(Clone, Debug, PartialEq)]
pub struct HeightMap {
    /// The image.
    pub image: ImageSource,
    /// Factor on the heights (`-bm`).
    pub scale: f32,
}

/// The images of a material's maps. [`Material::second_uv`] tells which are laid by the second set of texture coordinates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MaterialMaps {
    /// Base colour (`map_Kd`; `baseColorTexture`).
    pub color: Option<ImageSource>,
    /// Opacity of the colour texture, instead of its own (`map_d`).
    pub opacity: Option<Channel>,
    /// Occlusion, roughness and metal.
    pub surface: SurfaceMap,
    /// Occlusion that is laid by the other set of texture coordinates than [`MaterialMaps::surface`].
    pub occlusion: Option<Channel>,
    /// Normals: x along u, y along v upwards, z out of the surface (`norm`; `normalTexture`).
    ///
    /// glTF's v runs down the image, but its y runs up: "the normal vectors use the convention +X is right and +Y is
    /// up" (specification 2.0, `material.normalTexture`), which is what makes shaders that take tangents from v-down
    /// coordinates turn green around (three.js, pull request 13784). Coordinates are v-up here, so texels stay as
    /// they are.
    pub normal: Option<ImageSource>,
    /// Emitted colours (`map_Ke`; `emissiveTexture`).
    pub emission: Option<ImageSource>,
    /// Heights.
    pub height: Option<HeightMap>,
}

impl MaterialMaps {
    /// The images of all maps, in the order of the fields; an image may occur twice.
    pub fn images(&self) -> impl Iterator<Item = &ImageSource> {
        let channels =
            [self.opacity.as_ref(), self.occlusion.as_ref()].into_iter().chain(self.surface.channels());
        let channels = channels.flatten().map(|channel| &channel.image);
        let height = self.height.as_ref().map(|height| &height.image);
        self.color.iter().chain(channels).chain(&self.normal).chain(&self.emission).chain(height)
    }
}

/// A material of a model file.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedMaterial {
    /// Its constants: factors on the maps, alpha mode and wrap modes. The indices of its textures are `None`: the
    /// images become textures when the asset is prepared.
    pub material: Material,
    /// The images of its maps.
    pub maps: MaterialMaps,
    /// Whether the opacity map chooses the alpha mode, which the file leaves open, by its texels
    /// ([`crate::texture::Transparency`]): an alpha test at 0.5 if nearly every texel is opaque or transparent, else
    /// blending.
    pub alpha_from_map: bool,
}

impl Default for ImportedMaterial {
    fn default() -> Self {
        let grey = srgb_to_linear(0.8);
        let material = Material {
            name: "default".to_owned(),
            base_color: [grey, grey, grey, 1.0],
            roughness: 0.6,
            ..Material::default()
        };
        Self { material, maps: MaterialMaps::default(), alpha_from_map: false }
    }
}

impl ImportedMaterial {
    /// The default material under another name.
    #[must_use]
    pub fn named(name: impl Into<String>) -> Self {
        let mut this = Self::default();
        this.material.name = name.into();
        this
    }
}

/// An imported model.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The mesh; its `materials` index [`Imported::materials`].
    pub mesh: SourceMesh,
    /// Materials that at least one face uses.
    pub materials: Vec<ImportedMaterial>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}
