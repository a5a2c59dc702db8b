//! Encoding of texture files as mip levels, one blob each, coarse first.
//!
//! Colours, normals and surfaces become JPEG, or PNG where that is smaller or where there is transparency; heights stay
//! lossless, as grey PNG of 8 or 16 bits. The same file gives the same bytes on every machine: mips
//! are integer arithmetic, and the encoders are too.

mod channel;
mod color;
mod coverage;
mod decode;
mod encode;
mod error;
mod height;
mod levels;
mod limits;
mod mip;
mod normal;
mod source;
mod surface;

pub use lodestream_scene::asset::TextureKind;

pub use error::TextureError;
pub use levels::Texture;
pub use limits::{MAX_PIXELS, MAX_SIDE_PX};
pub use source::{Opacity, TextureSource, Transparency};

/// Reads a texture's images and encodes its mip levels.
///
/// # Errors
/// See [`TextureError`]. The size is checked before anything is decoded.
pub fn load(source: &TextureSource) -> Result<Texture, TextureError> {
    match source {
        TextureSource::Color { image, opacity, used } => color::load(image.as_ref(), opacity.as_ref(), *used),
        TextureSource::Height(image) => height::load(image),
        TextureSource::Normal(image) => normal::load(image),
        TextureSource::Surface(map) => surface::load(map),
    }
}

#[cfg(test)]
mod tests;
