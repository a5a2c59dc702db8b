//! Image files to pixels, within limits.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder as _, ImageError, ImageReader, Limits};

use super::avif::Avif;
use super::error::{TextureError, one_line};
use super::ktx2::Ktx2;
use super::limits::{MAX_DECODED_BYTES, MAX_PIXELS, MAX_SIDE_PX, MAX_WHOLE_PIXELS};
use crate::error::ImportError;
use crate::file::read_file;
use crate::model::ImageSource;

/// Largest texture file, in bytes.
pub(super) const MAX_FILE_BYTES: u64 = 1 << 30;

/// Reads an image. The size is checked before anything is decoded.
///
/// # Errors
/// Files that cannot be read or decoded, and sizes beyond [`MAX_SIDE_PX`] or above 1 GiB of decoded pixels.
pub fn decode(source: &ImageSource) -> Result<DynamicImage, TextureError> {
    opened(source, |image| image.decode())
}

/// [`decode`] of an image of which all pixels are needed at once.
pub(super) fn decode_whole(source: &ImageSource) -> Result<DynamicImage, TextureError> {
    opened(source, |image| {
        let (width_px, height_px) = image.size_px;
        if u64::from(width_px) * u64::from(height_px) > MAX_WHOLE_PIXELS {
            return Err(TextureError::TooLong { path: image.path.to_owned(), width_px, height_px });
        }
        image.decode()
    })
}

/// Width and height of an image, in pixels, from its header.
///
/// # Errors
/// As [`decode`], but for what the header does not tell.
pub fn size(source: &ImageSource) -> Result<(u32, u32), TextureError> {
    opened(source, |image| Ok(image.size_px))
}

fn opened<T>(
    source: &ImageSource,
    then: impl FnOnce(&ImageFile<'_>) -> Result<T, TextureError>,
) -> Result<T, TextureError> {
    let path = &*source.path;
    match &source.bytes {
        Some(bytes) => then(&ImageFile::open(path, bytes)?),
        None => then(&ImageFile::open(path, &read(path)?)?),
    }
}

fn read(path: &Path) -> Result<Vec<u8>, TextureError> {
    read_file(path, MAX_FILE_BYTES).map_err(|error| read_error(path, error))
}

pub(super) fn read_error(path: &Path, error: ImportError) -> TextureError {
    TextureError::Read {
        path: path.to_owned(),
        source: match error {
            ImportError::Read { source, .. } => source,
            _ => std::io::Error::other("not a regular file, or too large"),
        },
    }
}

/// An error for sizes beyond the limits, and for images without pixels.
pub(super) fn check_size(path: &Path, (width_px, height_px): (u32, u32)) -> Result<(), TextureError> {
    let pixels = u64::from(width_px) * u64::from(height_px);
    if width_px > MAX_SIDE_PX || height_px > MAX_SIDE_PX || pixels > MAX_PIXELS {
        return Err(TextureError::TooLarge { path: path.to_owned(), width_px, height_px });
    }
    if pixels == 0 {
        return Err(TextureError::Decode { path: path.to_owned(), why: "it has no pixels".to_owned() });
    }
    Ok(())
}

/// An image file whose size is within the limits.
struct ImageFile<'a> {
    /// For messages.
    path: &'a Path,
    bytes: &'a [u8],
    /// The file, if it is of a format that the crate `image` does not read.
    other: Option<Other<'a>>,
    size_px: (u32, u32),
}

enum Other<'a> {
    Avif(Avif<'a>),
    Ktx2(Ktx2<'a>),
}

impl<'a> Other<'a> {
    fn open(bytes: &'a [u8]) -> Result<Option<Self>, String> {
        if Avif::is_one(bytes) {
            return Avif::open(bytes).map(|file| Some(Self::Avif(file)));
        }
        Ktx2::is_one(bytes).then(|| Ktx2::open(bytes).map(Self::Ktx2)).transpose()
    }

    fn size(&self) -> (u32, u32) {
        match self {
            Self::Avif(file) => file.size(),
            Self::Ktx2(file) => file.size(),
        }
    }

    fn decode(&self) -> Result<DynamicImage, String> {
        match self {
            Self::Avif(file) => file.decode(),
            Self::Ktx2(file) => file.decode(),
        }
    }
}

impl<'a> ImageFile<'a> {
    fn open(path: &'a Path, bytes: &'a [u8]) -> Result<Self, TextureError> {
        let bad = |why: String| TextureError::Decode { path: path.to_owned(), why: one_line(&why) };
        let other = Other::open(bytes).map_err(bad)?;
        let size_px = match &other {
            Some(file) => file.size(),
            None => reader(bytes)
                .and_then(ImageReader::into_dimensions)
                .map_err(|error| bad(error.to_string()))?,
        };
        check_size(path, size_px)?;
        Ok(Self { path, bytes, other, size_px })
    }

    fn decode(&self) -> Result<DynamicImage, TextureError> {
        let bad = |why: String| TextureError::Decode { path: self.path.to_owned(), why: one_line(&why) };
        let (width_px, height_px) = self.size_px;
        let too_long = || TextureError::TooLong { path: self.path.to_owned(), width_px, height_px };
        let pixels = u64::from(width_px) * u64::from(height_px);
        if let Some(file) = &self.other {
            if pixels > MAX_WHOLE_PIXELS {
                return Err(too_long());
            }
            return file.decode().map_err(bad);
        }
        let mut reader = reader(self.bytes).map_err(|error| bad(error.to_string()))?;
        let mut limits = Limits::default();
        limits.max_image_width = Some(MAX_SIDE_PX);
        limits.max_image_height = Some(MAX_SIDE_PX);
        // The rest is the decoders' own.
        limits.max_alloc = Some(MAX_DECODED_BYTES + (64 << 20));
        reader.limits(limits.clone());
        let mut decoder = reader.into_decoder().map_err(|error| bad(error.to_string()))?;
        if decoder.total_bytes() > MAX_DECODED_BYTES {
            return Err(too_long());
        }
        decoder.set_limits(limits).map_err(|_| too_long())?;
        DynamicImage::from_decoder(decoder).map_err(|error| match error {
            ImageError::Limits(_) => too_long(),
            other => bad(other.to_string()),
        })
    }
}

fn reader(bytes: &[u8]) -> Result<ImageReader<Cursor<&[u8]>>, ImageError> {
    Ok(ImageReader::new(Cursor::new(bytes)).with_guessed_format()?)
}
