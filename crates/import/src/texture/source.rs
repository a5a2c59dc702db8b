//! Sources of a texture: one image or several.

use std::path::Path;

use lodestream_scene::asset::TextureKind;

use crate::model::{Channel, ImageSource, SurfaceMap};

/// Use of the opacity, which determines its encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Opacity {
    /// Unused: opacity is dropped, and transparent texels count in colour means.
    Ignored,
    /// Alpha test with this threshold: coarser levels keep the share of texels that pass.
    Tested(u8),
    /// Blending.
    Blended,
    /// Chosen by the image ([`Transparency`]): an alpha test at 128, or blending.
    Guessed,
}

/// Kind of transparency in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transparency {
    /// Every texel is opaque.
    None,
    /// At most a tenth of the texels is between an eighth and seven eighths opaque: a surface with holes, whose
    /// edges are smooth.
    Holes,
    /// More are.
    Graded,
}

/// Images and channels of a texture.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TextureSource {
    /// sRGB colours, perhaps with opacity.
    Color {
        /// The colours; white where `None`.
        image: Option<ImageSource>,
        /// Opacity instead of the image's own.
        opacity: Option<Channel>,
        /// Use of the opacity.
        used: Opacity,
    },
    /// Heights: black is low, white is high; linear.
    Height(ImageSource),
    /// Normals: x along u, y along v upwards, z out of the surface.
    Normal(ImageSource),
    /// Occlusion, roughness and metal; linear.
    Surface(SurfaceMap),
}

impl TextureSource {
    /// Colours without opacity.
    #[must_use]
    pub fn opaque(image: ImageSource) -> Self {
        Self::Color { image: Some(image), opacity: None, used: Opacity::Ignored }
    }

    /// Meaning of the texels.
    #[must_use]
    pub fn kind(&self) -> TextureKind {
        match self {
            Self::Color { .. } => TextureKind::Color,
            Self::Height(_) => TextureKind::Height,
            Self::Normal(_) => TextureKind::Normal,
            Self::Surface(_) => TextureKind::Surface,
        }
    }

    /// The image that messages name.
    #[must_use]
    pub fn first_image(&self) -> Option<&ImageSource> {
        match self {
            Self::Color { image, opacity, .. } => image.as_ref().or(opacity.as_ref().map(|o| &o.image)),
            Self::Height(image) | Self::Normal(image) => Some(image),
            Self::Surface(map) => map.channels().into_iter().flatten().map(|channel| &channel.image).next(),
        }
    }

    /// The source without one of its images; `None` if no other remains.
    #[must_use]
    pub fn without(&self, path: &Path) -> Option<Self> {
        let other = |image: &ImageSource| image.path != path;
        let other_channel = |channel: &Channel| other(&channel.image);
        match self.clone() {
            Self::Color { image, opacity, used } => {
                let (image, opacity) = (image.filter(other), opacity.filter(other_channel));
                (image.is_some() || opacity.is_some()).then_some(Self::Color { image, opacity, used })
            }
            Self::Height(image) => other(&image).then_some(Self::Height(image)),
            Self::Normal(image) => other(&image).then_some(Self::Normal(image)),
            Self::Surface(map) => {
                let map = SurfaceMap {
                    occlusion: map.occlusion.filter(other_channel),
                    roughness: map.roughness.filter(other_channel),
                    metallic: map.metallic.filter(other_channel),
                };
                (!map.is_empty()).then_some(Self::Surface(map))
            }
        }
    }
}
