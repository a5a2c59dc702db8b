//! Levels from fine to coarse, and their image files.

use std::path::Path;
use std::sync::OnceLock;

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _, ImageError};
use lodestream_geometry::pool::Pool;
use lodestream_scene::asset::{TextureKind, is_tiled, tile_grid};

use super::error::{TextureError, one_line};
use super::levels::Level;
use super::mip::Plane;

/// Halving stops at a level whose longer side is at most this: smaller levels cost a message each
/// and save nothing, since an 8 × 8 level is about 200 bytes.
const COARSEST_SIDE_PX: u32 = 8;
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

/// Encoded levels, coarse first, and the coarsest as a plane. The pool runs a task for each image.
pub(super) fn levels<const N: usize>(
    (path, kind): (&Path, TextureKind),
    plane: Plane<N>,
    halve: impl Fn(&Plane<N>) -> Plane<N>,
    encode: impl Fn(&Plane<N>) -> Result<Vec<u8>, ImageError> + Sync,
    pool: &dyn Pool,
) -> Result<(Vec<Level>, Plane<N>), TextureError> {
    let (mut finer, mut coarsest) = (Vec::new(), plane);
    while coarsest.width.max(coarsest.height) > COARSEST_SIDE_PX {
        let next = halve(&coarsest);
        finer.push(std::mem::replace(&mut coarsest, next));
    }
    let planes: Vec<&Plane<N>> = finer.iter().chain([&coarsest]).collect();
    // Fine first, as whole levels take longest.
    let images: Vec<(usize, Option<[u32; 2]>)> =
        (0..).zip(&planes).flat_map(|(at, plane)| images(at, plane, kind)).collect();
    let encoded: Vec<OnceLock<_>> = images.iter().map(|_| OnceLock::new()).collect();
    pool.run(images.len(), &|i| {
        let (at, tile) = images[i];
        encoded[i].get_or_init(|| match tile {
            Some(tile) => encode(&planes[at].tile(tile)),
            None => encode(planes[at]),
        });
    });
    let failed = |why: String| TextureError::Encode { path: path.to_owned(), why: one_line(&why) };
    let mut levels: Vec<Level> = planes.iter().map(|_| Level::new()).collect();
    for ((at, _), image) in images.into_iter().zip(encoded) {
        let image = image.into_inner().ok_or_else(|| failed("its task did not run".to_owned()))?;
        levels[at].push(image.map_err(|error| failed(error.to_string()))?);
    }
    levels.reverse();
    Ok((levels, coarsest))
}

/// The images of a level, by its number from the finest: itself, or its tiles.
fn images<const N: usize>(at: usize, plane: &Plane<N>, kind: TextureKind) -> Vec<(usize, Option<[u32; 2]>)> {
    let size = [plane.width, plane.height];
    if !is_tiled(kind, size) {
        return vec![(at, None)];
    }
    let [columns, rows] = tile_grid(size);
    (0..rows).flat_map(|row| (0..columns).map(move |column| (at, Some([column, row])))).collect()
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
