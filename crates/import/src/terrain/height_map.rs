//! Height maps: 16-bit grey images as fixed points.

use std::path::{Path, PathBuf};

use lodestream_terrain::{FeatureSet, Mode, Parameters, Point, Scratch, Terrain, TerrainError};

/// Largest side of a picture, in pixels.
const MAX_SIDE: u32 = 16_384;
/// Rows that are compared at once.
const BAND: usize = 64;

/// A picture's heights, one for each point of the finest grid.
#[derive(Clone, Debug)]
pub struct HeightMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    grey: Vec<u16>,
    /// Height units for each step of grey, and the height of black.
    scale: f64,
    offset: i32,
}

/// Difference between heights and those of a map, in height units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapError {
    /// The largest difference.
    pub max: f64,
    /// The root of the mean squared difference.
    pub rms: f64,
}

/// A picture that cannot be used as a height map.
#[derive(Debug, thiserror::Error)]
pub enum HeightMapError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not an image, or has more than 16,384 pixels a side.
    #[error("{}: is not a readable picture of at most {MAX_SIDE} pixels a side: {source}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        source: image::ImageError,
    },
    /// Its pixels are not 16-bit grey.
    #[error("{}: has {color:?} pixels; save it as 16-bit grey without alpha", path.display())]
    Color {
        /// The file.
        path: PathBuf,
        /// The type of its pixels.
        color: image::ColorType,
    },
    /// White would be at a height beyond 32 bits.
    #[error("{}: white would be at {white}, beyond 32 bits; give a smaller scale", path.display())]
    TooHigh {
        /// The file.
        path: PathBuf,
        /// The height of white, in height units.
        white: f64,
    },
}

impl HeightMap {
    /// Reads a picture: black is `offset`, each step of grey `scale` height units.
    ///
    /// # Errors
    /// See [`HeightMapError`].
    pub fn open(path: &Path, scale: f64, offset: i32) -> Result<Self, HeightMapError> {
        let mut reader = image::ImageReader::open(path)
            .and_then(image::ImageReader::with_guessed_format)
            .map_err(|source| HeightMapError::Read { path: path.to_owned(), source })?;
        let mut limits = image::Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE), Some(MAX_SIDE));
        reader.limits(limits);
        let picture =
            reader.decode().map_err(|source| HeightMapError::Decode { path: path.to_owned(), source })?;
        let image::DynamicImage::ImageLuma16(picture) = picture else {
            return Err(HeightMapError::Color { path: path.to_owned(), color: picture.color() });
        };
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let map = Self { width, height, grey: picture.into_raw(), scale, offset };
        let white = scale * f64::from(u16::MAX) + f64::from(offset);
        if !(f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&white) {
            return Err(HeightMapError::TooHigh { path: path.to_owned(), white });
        }
        Ok(map)
    }

    /// The height of a pixel, rounded.
    fn at(&self, x: usize, y: usize) -> i32 {
        let exact = f64::from(self.grey[y * self.width + x]) * self.scale + f64::from(self.offset);
        exact.round() as i32
    }

    /// Every `every`th pixel of every `every`th row as a fixed point, the first at `at`, for a terrain of
    /// `finest_level`.
    ///
    /// Where the map does not end on a patch's border, one more row or column beyond repeats the last pixels,
    /// because what lies between listed points follows from those on all sides.
    #[must_use]
    pub fn features(&self, at: [i64; 2], every: usize, finest_level: u8) -> FeatureSet {
        let columns = samples(at[0], self.width, every.max(1), finest_level);
        let rows = samples(at[1], self.height, every.max(1), finest_level);
        let point = |&(x, column): &(i64, usize), &(y, row): &(i64, usize)| Point {
            x,
            y,
            height: self.at(column, row),
        };
        let points = rows.iter().flat_map(|row| columns.iter().map(move |column| point(column, row)));
        FeatureSet { mode: Mode::Fixed, points: points.collect(), stamps: Vec::new() }
    }

    /// Error of the terrain with these features against the map, over all pixels.
    ///
    /// # Errors
    /// If the features do not fit the terrain, or the map lies outside the world.
    pub fn error(
        &self,
        parameters: Parameters,
        features: &FeatureSet,
        at: [i64; 2],
    ) -> Result<MapError, TerrainError> {
        let terrain = Terrain::with_features(parameters, std::slice::from_ref(features))?;
        let (mut scratch, mut heights) = (Scratch::new(), Vec::new());
        let (mut max, mut squares) = (0.0_f64, 0.0);
        for top in (0..self.height).step_by(BAND) {
            let rows = BAND.min(self.height - top);
            let y = at[1] + top as i64;
            terrain.window(terrain.finest_level(), at[0], y, self.width, rows, &mut scratch, &mut heights)?;
            for (i, &height) in heights.iter().enumerate() {
                let error = f64::from(height) - f64::from(self.at(i % self.width, top + i / self.width));
                max = max.max(error.abs());
                squares += error * error;
            }
        }
        Ok(MapError { max, rms: (squares / (self.width * self.height) as f64).sqrt() })
    }
}

/// Grid coordinates that are listed along an axis, and the pixel that each takes its height from.
fn samples(at: i64, pixels: usize, every: usize, finest_level: u8) -> Vec<(i64, usize)> {
    let steps = (pixels - 1).div_ceil(every) as i64;
    let place = |step: i64| at + step * every as i64;
    let open = |step: i64| every > 1 && place(step) & ((1 << finest_level) - 1) != 0;
    let (first, last) = (-i64::from(open(0)), steps + i64::from(open(steps)));
    let pixel = |step: i64| (step.max(0) as usize * every).min(pixels - 1);
    (first..=last).map(|step| (place(step), pixel(step))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: usize, height: usize) -> HeightMap {
        let grey = |i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            (30_000.0 + 9000.0 * (x * 0.05).sin() + 7000.0 * (y * 0.07).cos()) as u16
        };
        HeightMap { width, height, grey: (0..width * height).map(grey).collect(), scale: 1.5, offset: -1000 }
    }

    #[test]
    fn all_pixels_are_exact_and_fewer_are_nearly() {
        let parameters =
            Parameters { finest_level: 6, extent_log2: 9, amplitude: 0, ..Parameters::default() };
        let map = map(150, 99);
        let at = [-40, 30];
        let all = map.features(at, 1, 6);
        assert_eq!(all.points.len(), 150 * 99);
        assert_eq!(map.error(parameters, &all, at).unwrap(), MapError { max: 0.0, rms: 0.0 });
        let at = [-64, 64];
        let (four, sixteen) = (map.features(at, 4, 6), map.features(at, 16, 6));
        // Columns -64 to 88, one beyond; rows 64 to 164, one beyond.
        assert_eq!(four.points.len(), 40 * 27);
        let [four, sixteen] = [four, sixteen].map(|features| map.error(parameters, &features, at).unwrap());
        assert!(four.rms < sixteen.rms / 8.0 && four.rms > 0.0 && four.max < 1000.0, "{four:?} {sixteen:?}");
    }

    #[test]
    fn a_picture_that_is_no_height_map_is_refused_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.png");
        let refusal = |scale| HeightMap::open(&path, scale, 0).unwrap_err().to_string();
        assert!(refusal(1.0).contains("map.png: cannot be read: "), "{}", refusal(1.0));
        std::fs::write(&path, "no picture").unwrap();
        assert!(refusal(1.0).contains("map.png: is not a readable picture"), "{}", refusal(1.0));
        image::RgbImage::new(2, 2).save(&path).unwrap();
        assert!(
            refusal(1.0).ends_with("Rgb8 pixels; save it as 16-bit grey without alpha"),
            "{}",
            refusal(1.0)
        );
        image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::new(2, 2).save(&path).unwrap();
        assert!(refusal(1e6).ends_with("beyond 32 bits; give a smaller scale"), "{}", refusal(1e6));
        assert!(HeightMap::open(&path, 1.0, 0).is_ok());
    }
}
