//! Errors of textures, in one line.

use std::path::{Path, PathBuf};

use super::limits::{MAX_DECODED_BYTES, MAX_PIXELS, MAX_SIDE_PX, MAX_WHOLE_PIXELS};

/// A texture that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TextureError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not a supported image.
    #[error("{}: is not a readable PNG, JPEG, WebP, AVIF or KTX2: {why}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// The image is larger than supported.
    #[error(
        "{}: is {width_px} × {height_px} pixels; at most {MAX_SIDE_PX} on a side and {MAX_PIXELS} in all are supported, so scale it down",
        path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Width in pixels.
        width_px: u32,
        /// Height in pixels.
        height_px: u32,
    },
    /// The image is too large to be decoded as a whole.
    #[error(
        "{}: is {width_px} × {height_px} pixels; of its format and use at most {} MiB are decoded, or {MAX_WHOLE_PIXELS} pixels where images are combined or heights, so scale it down or make it a PNG that is not interlaced",
        path.display(), MAX_DECODED_BYTES >> 20
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Width in pixels.
        width_px: u32,
        /// Height in pixels.
        height_px: u32,
    },
    /// A height texture that looks like a normal map.
    #[error("{}: looks like a normal map, but heights (grey) are needed for relief", path.display())]
    NormalMap {
        /// The file.
        path: PathBuf,
    },
    /// An encoder failed.
    #[error("{}: a mip level cannot be encoded: {why}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
}

impl TextureError {
    /// The image.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Read { path, .. }
            | Self::Decode { path, .. }
            | Self::TooLarge { path, .. }
            | Self::TooLong { path, .. }
            | Self::NormalMap { path }
            | Self::Encode { path, .. } => path,
        }
    }
}

pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
