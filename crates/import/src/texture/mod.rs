//! Encoding of texture files as mip levels, one blob each, coarse first.
//!
//! Colours become WebP, normals and surfaces JPEG, all of them PNG where that is smaller; heights stay lossless, as grey
//! PNG of 8 or 16 bits. The same file gives the same bytes on every machine and number of threads: mips are integer
//! arithmetic, and the encoders are too.

mod channel;
mod color;
mod coverage;
mod decode;
mod encode;
mod error;
mod height;
mod ktx2;
mod levels;
mod limits;
mod mip;
mod normal;
mod source;
mod surface;
mod webp;

use lodestream_geometry::pool::Pool;
pub use lodestream_scene::asset::TextureKind;

pub use decode::{decode, size};
pub use error::TextureError;
pub use levels::{Level, Texture};
pub use limits::{MAX_PIXELS, MAX_SIDE_PX};
pub use source::{Opacity, TextureSource, Transparency};

/// Reads a texture's images and encodes its mip levels, each in a task of the pool.
///
/// # Errors
/// See [`TextureError`]. The size is checked before anything is decoded.
pub fn load(source: &TextureSource, pool: &dyn Pool) -> Result<Texture, TextureError> {
    match source {
        TextureSource::Color { image, opacity, used } => {
            color::load(image.as_ref(), opacity.as_ref(), *used, pool)
        }
        TextureSource::Height(image) => height::load(image, pool),
        TextureSource::Normal(image) => normal::load(image, pool),
        TextureSource::Surface(map) => surface::load(map, pool),
    }
}

#[cfg(test)]
mod tests;
