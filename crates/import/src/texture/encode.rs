//! Image files of levels.

use std::path::Path;
use std::sync::{Mutex, OnceLock};

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _, ImageError};
use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::TextureKind;

use super::error::{TextureError, one_line};
use super::levels::Level;
use super::mip::{Average, Plane};
use super::pyramid::{Image, Pyramid};
use super::strips::Strips;

/// PNG is taken up to these many bytes above 4/3 of the lossy file: what it codes so well is flat or drawn, and shows
/// errors most.
const WORTH_BYTES: usize = 64;
/// Most texels of a rectangle of which PNG is tried without a sample.
const SMALL_TEXELS: usize = 1 << 16;
/// Rows of each band of the sample, of so many rows. A band is longer than deflate's window of 32 kB at 1,000 pixels and
/// more, so what PNG saves by repetition shows within it.
const SAMPLE: (usize, usize) = (16, 128);
/// How many times too long the sample may find PNG for PNG to be tried.
const SAMPLE_SLACK: usize = 2;

/// Encoded levels, coarse first, and the coarsest as a plane. The pool runs a task for each image, and reads the next
/// strip beside those of the last one. `encode` is given a level's number, from the finest, and an image.
pub(super) fn levels<const N: usize, A: Average<N>>(
    (path, kind): (&Path, TextureKind),
    strips: &mut dyn Strips<N>,
    encode: impl Fn(usize, &Plane<N>) -> Result<Vec<u8>, ImageError> + Sync,
    pool: &dyn Pool,
) -> Result<(Vec<Level>, Plane<N>), TextureError> {
    let failed = |why: String| TextureError::Encode { path: path.to_owned(), why: one_line(&why) };
    let not_run = || failed("its task did not run".to_owned());
    let pyramid = Pyramid::<N>::new(strips.size(), kind);
    let mut levels: Vec<Level> =
        pyramid.levels.iter().map(|level| vec![Vec::new(); level.images.count()]).collect();
    let reading = Mutex::new((strips, pyramid));
    let mut coarsest = Plane { width: 0, height: 0, samples: Vec::new() };
    let (mut images, mut is_read): (Vec<Image<N>>, bool) = (Vec::new(), false);
    while !(is_read && images.is_empty()) {
        let read = usize::from(!is_read);
        let next = OnceLock::new();
        let encoded: Vec<OnceLock<_>> = images.iter().map(|_| OnceLock::new()).collect();
        pool.run(read + images.len(), &|task| match task.checked_sub(read) {
            Some(i) => {
                encoded[i].get_or_init(|| encode(images[i].level, &images[i].plane));
            }
            None => {
                next.get_or_init(|| {
                    let mut reading = reading.lock().map_err(|_| failed("a task panicked".to_owned()))?;
                    let (strips, pyramid) = &mut *reading;
                    let rows = strips.next()?;
                    Ok((rows.is_empty(), pyramid.push::<A>(&rows)))
                });
            }
        });
        for (image, encoded) in images.drain(..).zip(encoded) {
            let file =
                encoded.into_inner().ok_or_else(not_run)?.map_err(|error| failed(error.to_string()))?;
            levels[image.level][image.number] = file;
            if image.level + 1 == levels.len() {
                coarsest = image.plane;
            }
        }
        if !is_read {
            (is_read, images) = next.into_inner().ok_or_else(not_run)??;
        }
    }
    levels.reverse();
    Ok((levels, coarsest))
}

/// Texels of a rectangle, row by row. Its files depend on nothing else.
#[derive(Clone, Copy)]
pub(super) struct Rectangle<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) format: ExtendedColorType,
}

impl Rectangle<'_> {
    pub(super) fn png(self) -> Result<Vec<u8>, ImageError> {
        let mut out = Vec::new();
        PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive).write_image(
            self.bytes,
            self.width,
            self.height,
            self.format,
        )?;
        Ok(out)
    }

    /// JPEG of three full channels or of grey.
    pub(super) fn jpeg(self, quality: u8) -> Result<Vec<u8>, ImageError> {
        let mut out = Vec::new();
        JpegEncoder::new_with_quality(&mut out, quality).encode(
            self.bytes,
            self.width,
            self.height,
            self.format,
        )?;
        Ok(out)
    }

    /// PNG, or the lossy file if that saves enough.
    pub(super) fn png_or(self, lossy: Vec<u8>) -> Result<Vec<u8>, ImageError> {
        let longest = lossy.len() + lossy.len() / 3 + WORTH_BYTES;
        if !self.png_may_take(longest)? {
            return Ok(lossy);
        }
        let lossless = self.png()?;
        Ok(if lossless.len() <= longest { lossless } else { lossy })
    }

    /// Whether PNG may take at most so many bytes, by a sample of rows: it takes ten times as long as JPEG, and of
    /// large photographs is many times as long.
    fn png_may_take(self, longest: usize) -> Result<bool, ImageError> {
        let (width, height) = (self.width as usize, self.height as usize);
        if width * height <= SMALL_TEXELS {
            return Ok(true);
        }
        let (rows, of) = SAMPLE;
        let stride = self.bytes.len() / height;
        let mut bytes = 0;
        for top in ((of - rows) / 2..height).step_by(of) {
            let band = top..height.min(top + rows);
            let height = band.len() as u32;
            let bytes_of_band = &self.bytes[band.start * stride..band.end * stride];
            bytes += Rectangle { bytes: bytes_of_band, height, ..self }.png()?.len();
            if bytes * of / rows > longest * SAMPLE_SLACK {
                return Ok(false);
            }
        }
        Ok(true)
    }
}
