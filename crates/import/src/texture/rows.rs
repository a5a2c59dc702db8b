//! Rows of an image, a strip at a time, so that large images need not be in memory.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read as _, Seek};
use std::path::PathBuf;

use bytes::Bytes;
use image::{DynamicImage, ImageBuffer};
use png::{BitDepth, ColorType};

use super::decode::{MAX_FILE_BYTES, check_size, decode, read_error};
use super::error::{TextureError, one_line};
use crate::file::check_file;
use crate::model::ImageSource;

/// First bytes of a PNG file.
const PNG_SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Place of the byte that tells whether a PNG file is interlaced.
const INTERLACED: usize = 28;

/// An image's rows, from top to bottom. PNG files are decoded as they are read, unless they are interlaced; others are
/// decoded when they are opened.
pub(super) struct Rows {
    path: PathBuf,
    size: [u32; 2],
    /// Rows that were read.
    read: u32,
    from: From,
}

enum From {
    Png(Box<png::Reader<Input>>, ImageSource),
    Whole(DynamicImage),
}

/// A file, or one that was in a model.
enum Input {
    File(BufReader<File>),
    Bytes(Cursor<Bytes>),
}

impl Rows {
    pub(super) fn open(source: &ImageSource) -> Result<Self, TextureError> {
        let path = source.path.clone();
        if let Some(input) = png_input(source)? {
            let reader = reader(input, source)?;
            let size = reader.info().size();
            return Ok(Self {
                path,
                size: size.into(),
                read: 0,
                from: From::Png(Box::new(reader), source.clone()),
            });
        }
        Ok(Self::of(path, decode(source)?))
    }

    /// The rows of a decoded image.
    pub(super) fn of(path: PathBuf, image: DynamicImage) -> Self {
        Self { path, size: [image.width(), image.height()], read: 0, from: From::Whole(image) }
    }

    pub(super) fn path(&self) -> &PathBuf {
        &self.path
    }

    pub(super) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Whether pixels have opacity.
    pub(super) fn has_alpha(&self) -> bool {
        match &self.from {
            From::Png(reader, _) => {
                matches!(reader.output_color_type().0, ColorType::Rgba | ColorType::GrayscaleAlpha)
            }
            From::Whole(image) => image.color().has_alpha(),
        }
    }

    /// Goes back to the first row.
    pub(super) fn rewind(&mut self) -> Result<(), TextureError> {
        if let From::Png(current, source) = &mut self.from {
            let changed = || TextureError::Decode {
                path: self.path.clone(),
                why: "it was changed while it was read".to_owned(),
            };
            let kind = current.output_color_type();
            **current = reader(png_input(source)?.ok_or_else(changed)?, source)?;
            if self.size != <[u32; 2]>::from(current.info().size()) || kind != current.output_color_type() {
                return Err(changed());
            }
        }
        self.read = 0;
        Ok(())
    }

    /// The next rows, at most so many; none at the end.
    pub(super) fn next(&mut self, most: u32) -> Result<DynamicImage, TextureError> {
        let [width, height] = self.size;
        let (first, rows) = (self.read, most.min(height - self.read));
        self.read += rows;
        match &mut self.from {
            From::Whole(image) => Ok(image.crop_imm(0, first, width, rows)),
            From::Png(reader, _) => png_rows(reader, width, rows)
                .map_err(|why| TextureError::Decode { path: self.path.clone(), why: one_line(&why) }),
        }
    }
}

/// What to read, if it is a PNG file that is not interlaced.
fn png_input(source: &ImageSource) -> Result<Option<Input>, TextureError> {
    let streamed = |header: &[u8]| header.starts_with(PNG_SIGNATURE) && header.get(INTERLACED) == Some(&0);
    if let Some(bytes) = &source.bytes {
        return Ok(streamed(bytes).then(|| Input::Bytes(Cursor::new(bytes.clone()))));
    }
    let path = &source.path;
    check_file(path, MAX_FILE_BYTES).map_err(|error| read_error(path, error))?;
    let read = |source| TextureError::Read { path: path.clone(), source };
    let mut file = BufReader::new(File::open(path).map_err(read)?);
    let mut header = Vec::new();
    file.by_ref().take(INTERLACED as u64 + 1).read_to_end(&mut header).map_err(read)?;
    file.rewind().map_err(read)?;
    Ok(streamed(&header).then_some(Input::File(file)))
}

/// Reads a PNG file's header; its size is within the limits.
fn reader(input: Input, source: &ImageSource) -> Result<png::Reader<Input>, TextureError> {
    let bad = |error: png::DecodingError| TextureError::Decode {
        path: source.path.clone(),
        why: one_line(&error.to_string()),
    };
    let mut decoder = png::Decoder::new(input);
    let info = decoder.read_header_info().map_err(bad)?;
    check_size(&source.path, info.size())?;
    // Less than eight bits become eight, and palettes colours.
    decoder.set_transformations(png::Transformations::EXPAND);
    decoder.read_info().map_err(bad)
}

fn png_rows(reader: &mut png::Reader<Input>, width: u32, rows: u32) -> Result<DynamicImage, String> {
    let (kind, depth) = reader.output_color_type();
    let mut bytes = Vec::with_capacity(reader.output_line_size(width).unwrap_or(0) * rows as usize);
    for _ in 0..rows {
        let row = reader.next_row().map_err(|error| error.to_string())?;
        bytes.extend_from_slice(row.ok_or("it ends early")?.data());
    }
    let image = if depth == BitDepth::Sixteen {
        let words = bytes.as_chunks::<2>().0.iter().map(|word| u16::from_be_bytes(*word)).collect();
        match kind {
            ColorType::Grayscale => ImageBuffer::from_raw(width, rows, words).map(DynamicImage::ImageLuma16),
            ColorType::GrayscaleAlpha => {
                ImageBuffer::from_raw(width, rows, words).map(DynamicImage::ImageLumaA16)
            }
            ColorType::Rgb => ImageBuffer::from_raw(width, rows, words).map(DynamicImage::ImageRgb16),
            ColorType::Rgba => ImageBuffer::from_raw(width, rows, words).map(DynamicImage::ImageRgba16),
            ColorType::Indexed => None,
        }
    } else {
        match kind {
            ColorType::Grayscale => ImageBuffer::from_raw(width, rows, bytes).map(DynamicImage::ImageLuma8),
            ColorType::GrayscaleAlpha => {
                ImageBuffer::from_raw(width, rows, bytes).map(DynamicImage::ImageLumaA8)
            }
            ColorType::Rgb => ImageBuffer::from_raw(width, rows, bytes).map(DynamicImage::ImageRgb8),
            ColorType::Rgba => ImageBuffer::from_raw(width, rows, bytes).map(DynamicImage::ImageRgba8),
            ColorType::Indexed => None,
        }
    };
    image.ok_or_else(|| "its rows have an unexpected length".to_owned())
}

impl std::io::Read for Input {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        match self {
            Self::File(file) => file.read(into),
            Self::Bytes(bytes) => bytes.read(into),
        }
    }
}

impl BufRead for Input {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        match self {
            Self::File(file) => file.fill_buf(),
            Self::Bytes(bytes) => bytes.fill_buf(),
        }
    }

    fn consume(&mut self, amount: usize) {
        match self {
            Self::File(file) => file.consume(amount),
            Self::Bytes(bytes) => bytes.consume(amount),
        }
    }
}

impl Seek for Input {
    fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            Self::Bytes(bytes) => bytes.seek(to),
        }
    }
}
