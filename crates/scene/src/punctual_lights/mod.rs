//! Punctual lights of a scene: their number, pages of lights, and a directory of the pages.
//!
//! The message [`PunctualLights`] contains up to [`FEW_PUNCTUAL_LIGHTS`] lights itself. More are blobs
//! ([`crate::blob::PunctualLightBlob`]): pages of [`PUNCTUAL_LIGHTS_PER_PAGE`], and a directory with the bounds of each
//! page, by which a client selects the pages for its view.

mod directory;
mod numbers;
mod page;

use glam::{DVec3, Vec3};

use crate::encoding::encode_fields;
use crate::placement::Placement;

pub use directory::{LISTED_PER_PAGE, PunctualLightPageEntry, decode_directory, encode_directory};
pub use page::{MAX_PAGE_BYTES, decode_page, encode_page};

/// Most punctual lights of a scene.
pub const MAX_PUNCTUAL_LIGHTS: u32 = 1 << 18;
/// Punctual lights per page; the last page may have fewer.
pub const PUNCTUAL_LIGHTS_PER_PAGE: u32 = 64;
/// Most punctual lights that the message contains itself.
pub const FEW_PUNCTUAL_LIGHTS: u32 = 16;
/// Most pages whose directory the message contains.
pub const FEW_PAGES: u32 = 16;
/// Least and greatest luminous intensity of a punctual light's brightest colour, in candela.
pub const INTENSITIES: [f32; 2] = [1e-6, 1e12];
/// Least and greatest range of a punctual light, in world units.
pub const RANGES: [f32; 2] = [1e-6, 1e12];
/// Largest coordinate of a punctual light, in world units.
pub const MAX_COORDINATE: f64 = 1e12;

/// Range divided by the square root of the intensity, for lights without a range: it ends at an illuminance of 0.01 lx.
const RANGE_OVER_ROOT: f32 = 10.0;

/// A point or spot light as in KHR_lights_punctual: its intensity falls with the square of the distance, and to zero
/// at its range.
///
/// On a page it takes 14 bytes, a spot 22, less what it shares with the one before. Positions are exact within 1/2048
/// of the smallest range of their page on each axis (or 2⁻⁴¹ of the page's extent, where that is more), intensity and
/// range within 0.2 %, colours within 1/510 of the brightest component, directions and angles within 0.004°.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PunctualLight {
    /// Position in world units; each coordinate within ±[`MAX_COORDINATE`].
    pub position: [f64; 3],
    /// Luminous intensity of red, green and blue, linear, in candela; the largest is within [`INTENSITIES`].
    pub intensity: [f32; 3],
    /// Distance at which it ends, in world units, within [`RANGES`].
    pub range: f32,
    /// Cone of a spot light; `None` for a point light.
    pub spot: Option<Spot>,
}

/// The cone of a spot light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Unit vector in which it shines.
    pub direction: [f32; 3],
    /// Half angle of full intensity, in radians, at most `outer`.
    pub inner: f32,
    /// Half angle of zero intensity, in radians, above 0, at most π/2.
    pub outer: f32,
}

/// Number of a scene's punctual lights, and their first page or directory if short.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PunctualLights {
    /// Number of lights, 1 to [`MAX_PUNCTUAL_LIGHTS`].
    pub count: u32,
    /// The page for up to [`FEW_PUNCTUAL_LIGHTS`] lights; else the directory for up to [`FEW_PAGES`] pages; else empty.
    pub first: Vec<u8>,
}

encode_fields!(PunctualLights { count, first });

/// The decoded [`PunctualLights::first`].
#[derive(Clone, Debug, PartialEq)]
pub enum First {
    /// All punctual lights.
    PunctualLights(Vec<PunctualLight>),
    /// The only page of the directory.
    Directory(Vec<PunctualLightPageEntry>),
    /// Nothing; the directory must be requested.
    Nothing,
}

/// Invalid punctual lights or pages of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PunctualLightsError {
    /// None, or more than [`MAX_PUNCTUAL_LIGHTS`].
    #[error("a scene states {0} punctual lights; 1 to {MAX_PUNCTUAL_LIGHTS} are allowed")]
    Count(u32),
    /// Another number of entries than the scene states.
    #[error("a page of punctual lights or of their directory has {got} entries, but should have {expected}")]
    WrongCount {
        /// How many it has.
        got: u64,
        /// How many it should have.
        expected: u32,
    },
    /// An unknown format version.
    #[error("a page of punctual lights has format version {0}; update viewer or server")]
    Version(u8),
    /// The bytes end within a punctual light.
    #[error("a page of punctual lights ends too early")]
    EndsEarly,
    /// An integer out of range or not in its shortest form, or too many entries.
    #[error("the directory of punctual lights has a malformed number")]
    DirectoryNumber,
    /// Bytes are left over.
    #[error("{0} bytes are left over behind punctual lights")]
    TrailingBytes(usize),
    /// An unknown flag, or one that refers to a missing previous light.
    #[error("a punctual light has unknown flags {0:#04x}")]
    Flags(u8),
    /// Not finite, or beyond [`MAX_COORDINATE`].
    #[error("a punctual light's position is not within 1e12")]
    Position,
    /// Beyond [`INTENSITIES`], or a colour without a brightest component.
    #[error("a punctual light's intensity is not from 1e-6 to 1e12")]
    Intensity,
    /// Beyond [`RANGES`].
    #[error("a punctual light's range is not from 1e-6 to 1e12")]
    Range,
    /// A direction that is not a unit vector, or invalid angles.
    #[error(
        "a punctual light's cone has no direction, or not 0 <= inner <= outer <= 90 degrees with outer above 0"
    )]
    Cone,
    /// An invalid sphere or strength in the directory.
    #[error("the directory of punctual lights has a sphere or strength that is not a finite positive number")]
    Listed,
    /// Longer than [`MAX_PAGE_BYTES`].
    #[error("the directory of punctual lights has a page of {0} bytes; at most {MAX_PAGE_BYTES} are allowed")]
    PageTooLong(u32),
}

impl PunctualLight {
    /// Default range of a light with this intensity.
    #[must_use]
    pub fn usual_range(intensity: [f32; 3]) -> f32 {
        let brightest = intensity.into_iter().fold(0.0, f32::max);
        (RANGE_OVER_ROOT * brightest.sqrt()).clamp(RANGES[0], RANGES[1])
    }

    /// The largest of the three intensities.
    #[must_use]
    pub fn brightest(&self) -> f32 {
        self.intensity.into_iter().fold(0.0, f32::max)
    }

    /// The light of a model that is placed in the world. Scale affects its position only, as KHR_lights_punctual
    /// requires.
    #[must_use]
    pub fn within(&self, model: &Placement) -> Self {
        let (rotation, scale) = (model.orientation_f64(), f64::from(model.scale));
        let position = DVec3::from(model.translation) + rotation * (DVec3::from(self.position) * scale);
        let turned = |spot: Spot| Spot {
            direction: (rotation * Vec3::from(spot.direction).as_dvec3()).as_vec3().to_array(),
            ..spot
        };
        Self { position: position.to_array(), spot: self.spot.map(turned), ..*self }
    }

    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), PunctualLightsError> {
        let ensure = |holds, why| if holds { Ok(()) } else { Err(why) };
        ensure(self.position.iter().all(|x| x.abs() <= MAX_COORDINATE), PunctualLightsError::Position)?;
        let [least, most] = INTENSITIES;
        let all = self.intensity.iter().all(|i| (0.0..=most).contains(i));
        ensure(all && self.brightest() >= least, PunctualLightsError::Intensity)?;
        ensure((RANGES[0]..=RANGES[1]).contains(&self.range), PunctualLightsError::Range)?;
        let Some(Spot { direction, inner, outer }) = self.spot else { return Ok(()) };
        let length = Vec3::from(direction).length();
        let cone = (0.0..=outer).contains(&inner) && outer > 0.0 && outer <= std::f32::consts::FRAC_PI_2;
        ensure((0.9..=1.1).contains(&length) && cone, PunctualLightsError::Cone)
    }
}

impl PunctualLights {
    /// Number of pages of `count` lights.
    #[must_use]
    pub const fn pages_of(count: u32) -> u32 {
        count.div_ceil(PUNCTUAL_LIGHTS_PER_PAGE)
    }

    /// Number of lights on a page, of `count` in all; 0 beyond the last page.
    #[must_use]
    pub const fn on_page(count: u32, page: u32) -> u32 {
        let left = count.saturating_sub(page.saturating_mul(PUNCTUAL_LIGHTS_PER_PAGE));
        if left < PUNCTUAL_LIGHTS_PER_PAGE { left } else { PUNCTUAL_LIGHTS_PER_PAGE }
    }

    /// Number of pages of the directory of `count` lights.
    #[must_use]
    pub const fn directory_pages_of(count: u32) -> u32 {
        Self::pages_of(count).div_ceil(LISTED_PER_PAGE)
    }

    /// Number of entries on a page of the directory of `count` lights; 0 beyond the last page.
    #[must_use]
    pub const fn on_directory_page(count: u32, page: u32) -> u32 {
        let left = Self::pages_of(count).saturating_sub(page.saturating_mul(LISTED_PER_PAGE));
        if left < LISTED_PER_PAGE { left } else { LISTED_PER_PAGE }
    }

    /// What is in the message.
    ///
    /// # Errors
    /// Invalid punctual lights or pages of them. Memory is bounded by the bytes.
    pub fn first(&self) -> Result<First, PunctualLightsError> {
        if !(1..=MAX_PUNCTUAL_LIGHTS).contains(&self.count) {
            return Err(PunctualLightsError::Count(self.count));
        }
        if self.count <= FEW_PUNCTUAL_LIGHTS {
            return decode_page(&self.first, self.count).map(First::PunctualLights);
        }
        let pages = Self::pages_of(self.count);
        if pages <= FEW_PAGES {
            return decode_directory(&self.first, pages).map(First::Directory);
        }
        match self.first.len() {
            0 => Ok(First::Nothing),
            more => Err(PunctualLightsError::TrailingBytes(more)),
        }
    }
}

#[cfg(test)]
mod tests;
