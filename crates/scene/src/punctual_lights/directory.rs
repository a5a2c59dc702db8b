//! Directory of the pages of punctual lights: their bounds, in pages of its own.

use glam::{DVec3, Vec3};

use super::{MAX_PAGE_BYTES, PunctualLight, PunctualLightsError};
use crate::encoding::{self, CodingError, encode_fields};

/// Entries of a page of the directory.
pub const LISTED_PER_PAGE: u32 = 256;

/// Most memory that a decoded page may take, in bytes.
const MAX_MEMORY_BYTES: usize = 64 * 1024;

/// Entry of a page of punctual lights: what a client must know before it requests the page. 21 to 23 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PunctualLightPageEntry {
    /// Centre of a sphere that contains the ranges of all lights of the page, in world units.
    pub center: [f32; 3],
    /// Its radius, in world units.
    pub radius: f32,
    /// Sum over the lights of the luminous intensity of their brightest colour, in candela.
    pub intensity: f32,
    /// Length of the page, in bytes.
    pub bytes: u32,
}

encode_fields!(PunctualLightPageEntry { center, radius, intensity, bytes });

impl PunctualLightPageEntry {
    /// The entry of a page with these lights and length.
    #[must_use]
    pub fn of(punctual_lights: &[PunctualLight], bytes: u32) -> Self {
        let places = || {
            punctual_lights
                .iter()
                .map(|punctual_light| (DVec3::from(punctual_light.position), f64::from(punctual_light.range)))
        };
        let low = places().fold(DVec3::INFINITY, |low, (at, range)| low.min(at - range));
        let high = places().fold(DVec3::NEG_INFINITY, |high, (at, range)| high.max(at + range));
        let center = (0.5 * (low + high)).as_vec3();
        // Computed for the rounded centre, and enlarged by more than the rounding of the radius.
        let reach = places().map(|(at, range)| at.distance(center.as_dvec3()) + range).fold(0.0, f64::max);
        #[expect(clippy::cast_possible_truncation, reason = "enlarged by more than the rounding")]
        let radius = (reach * (1.0 + 1e-6)) as f32;
        Self {
            center: center.to_array(),
            radius,
            intensity: punctual_lights.iter().map(PunctualLight::brightest).sum(),
            bytes,
        }
    }

    fn check(&self) -> Result<(), PunctualLightsError> {
        let positive = |x: f32| x.is_finite() && x >= 0.0;
        let finite = Vec3::from(self.center).is_finite();
        if !(finite && positive(self.radius) && positive(self.intensity)) {
            return Err(PunctualLightsError::Listed);
        }
        if self.bytes > MAX_PAGE_BYTES { Err(PunctualLightsError::PageTooLong(self.bytes)) } else { Ok(()) }
    }
}

/// Encodes a page of the directory.
///
/// # Errors
/// If there are more than [`LISTED_PER_PAGE`] entries, or one is invalid.
pub fn encode_directory(listed: &[PunctualLightPageEntry]) -> Result<Vec<u8>, PunctualLightsError> {
    let wrong = PunctualLightsError::WrongCount { got: listed.len() as u64, expected: LISTED_PER_PAGE };
    if listed.len() > LISTED_PER_PAGE as usize {
        return Err(wrong);
    }
    listed.iter().try_for_each(PunctualLightPageEntry::check)?;
    // Encoding numbers into memory cannot fail.
    encoding::encode(listed).map_err(|_| wrong)
}

/// Decodes a page of the directory that must hold `count` entries. Memory is bounded by the length of `bytes`.
///
/// # Errors
/// If the bytes are not such a page.
pub fn decode_directory(
    bytes: &[u8],
    count: u32,
) -> Result<Vec<PunctualLightPageEntry>, PunctualLightsError> {
    let listed: Vec<PunctualLightPageEntry> =
        encoding::decode(bytes, MAX_MEMORY_BYTES).map_err(|why| match why {
            CodingError::EndsEarly => PunctualLightsError::EndsEarly,
            CodingError::TrailingBytes { left } => PunctualLightsError::TrailingBytes(left),
            _ => PunctualLightsError::DirectoryNumber,
        })?;
    if listed.len() != count as usize {
        return Err(PunctualLightsError::WrongCount { got: listed.len() as u64, expected: count });
    }
    listed.iter().try_for_each(PunctualLightPageEntry::check)?;
    Ok(listed)
}
