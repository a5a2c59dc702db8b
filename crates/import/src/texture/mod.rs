//! Encoding of texture files as mip levels, one blob each, coarse first.
//!
//! Colours, normals and surfaces become WebP, or PNG where that is about as small; heights stay lossless, as grey PNG of
//! 8 or 16 bits. The same file gives the same bytes on every machine and number of threads: mips are integer arithmetic,
//! and the encoders are too.

mod avif;
mod channel;
mod chroma;
mod color;
mod coverage;
mod decode;
mod encode;
mod error;
mod height;
mod ktx2;
mod level_images;
mod levels;
mod limits;
mod mip;
mod normal;
mod planes;
mod pyramid;
mod quality;
mod rows;
mod source;
mod strips;
mod subsampling;
mod surface;
mod webp;

use lodestream_geometry::pool::Pool;
pub use lodestream_scene::asset::TextureKind;

pub use decode::{decode, size};
pub use error::TextureError;
pub use levels::{Level, Texture};
pub use limits::{MAX_PIXELS, MAX_SIDE_PX};
pub use quality::{TextureEffort, TextureQuality, TextureSettings};
pub use source::{Opacity, TextureSource, Transparency};

/// Reads a texture's images and encodes its mip levels, each in a task of the pool.
///
/// # Errors
/// See [`TextureError`]. The size is checked before anything is decoded.
pub fn load(
    source: &TextureSource,
    settings: TextureSettings,
    pool: &dyn Pool,
) -> Result<Texture, TextureError> {
    match source {
        TextureSource::Color { image, opacity, used } => {
            color::load(image.as_ref(), opacity.as_ref(), *used, (settings, pool))
        }
        TextureSource::Height(image) => height::load(image, pool),
        TextureSource::Normal(image) => normal::load(image, (settings, pool)),
        TextureSource::Surface(map) => surface::load(map, (settings, pool)),
    }
}

#[cfg(test)]
mod tests;
