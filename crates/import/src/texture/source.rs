//! What a texture is made of: one image or several.

use std::path::Path;

use lodestream_scene::asset::TextureKind;

use crate::model::{Channel, ImageSource, SurfaceMap};

/// What opacity is for, which decides what becomes of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Opacity {
    /// Nothing: it is dropped, and colours count whatever theirs is.
    Ignored,
    /// It is compared with this byte: coarser levels keep the share of texels that reach it.
    Tested(u8),
    /// It is blended by.
    Blended,
    /// What it looks like ([`Transparency`]): compared with 128, or blended by.
    Guessed,
}

/// What an image's opacity looks like.
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

/// What a texture is made of.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TextureSource {
    /// sRGB colours, perhaps with opacity.
    Color {
        /// The colours; white where `None`.
        image: Option<ImageSource>,
        /// Opacity instead of the image's own.
        opacity: Option<Channel>,
        /// What opacity is for.
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
    /// Colours that nothing is seen through.
    #[must_use]
    pub fn opaque(image: ImageSource) -> Self {
        Self::Color { image: Some(image), opacity: None, used: Opacity::Ignored }
    }

    /// What its texels mean.
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

    /// What is left without one of its images; nothing where that was all.
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
