//! A texture's encoded levels.

use lodestream_scene::asset::TextureKind;

use super::source::Transparency;

/// A texture's mip levels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Meaning of the texels.
    pub kind: TextureKind,
    /// Width of the finest level, in pixels.
    pub width_px: u32,
    /// Height of the finest level, in pixels.
    pub height_px: u32,
    /// Channels that WebP files hold as grey planes, as [`lodestream_scene::asset::TextureInfo`] has them.
    pub planes: u8,
    /// Transparency of the texels.
    pub transparency: Transparency,
    /// Mean colour, sRGB, taken in linear light and weighted by opacity; of surfaces the mean of each channel; of
    /// heights and normals none.
    pub mean: Option<[u8; 3]>,
    /// Encoded levels, coarse first. Counted from the finest, level k is
    /// `max(1, width_px >> k) × max(1, height_px >> k)`, as GPUs have it.
    pub levels: Vec<Level>,
}

/// The image files of a level: one, or those of its tiles row by row ([`lodestream_scene::asset::is_tiled`]).
pub type Level = Vec<Vec<u8>>;
