//! What a scene says of its punctual lights: how many there are, and pages of them that a client asks for.
//!
//! A scene's few punctual lights are in the message that says so ([`PunctualLights`]). More are blobs ([`crate::blob::PunctualLightBlob`]): pages of
//! [`PUNCTUAL_LIGHTS_PER_PAGE`], and a directory of what each page lights, by which a client knows which ones its view wants.

mod directory;
mod numbers;
mod page;

use bincode::{Decode, Encode};
use glam::{DQuat, DVec3, Vec3};

pub use directory::{LISTED_PER_PAGE, PunctualLightPageEntry, decode_directory, encode_directory};
pub use page::{MAX_PAGE_BYTES, decode_page, encode_page};

/// Most punctual lights of a scene.
pub const MAX_PUNCTUAL_LIGHTS: u32 = 1 << 18;
/// Punctual lights of a page; the last may have fewer.
pub const PUNCTUAL_LIGHTS_PER_PAGE: u32 = 64;
/// Most punctual lights that are in the message itself.
pub const FEW_PUNCTUAL_LIGHTS: u32 = 16;
/// Most pages whose directory is in the message.
pub const FEW_PAGES: u32 = 16;
/// Least and most luminous intensity of a punctual light's brightest colour, in candela.
pub const INTENSITIES: [f32; 2] = [1e-6, 1e12];
/// Least and greatest range of a punctual light, in world units.
pub const RANGES: [f32; 2] = [1e-6, 1e12];
/// Largest coordinate of a punctual light, in world units.
pub const MAX_COORDINATE: f64 = 1e12;

/// Range over the root of the intensity, where a punctual light states none: it then ends where it gives a hundredth of a lux.
const RANGE_OVER_ROOT: f32 = 10.0;

/// A light that stands in the scene, as KHR_lights_punctual has it: its light falls with the square of distance, and to
/// nothing at its range.
///
/// On a page it takes 14 bytes, a spot 22, less what it shares with the one before. Positions come back within 1/2048 of
/// the smallest range of their page on each axis (or 2⁻⁴¹ of the page's extent, where that is more), intensity and
/// range within 0.2 %, colours within 1/510 of the brightest component, directions and angles within 0.004°.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PunctualLight {
    /// Where it is, in world units; at most [`MAX_COORDINATE`] each way.
    pub position: [f64; 3],
    /// Luminous intensity of red, green and blue, linear, in candela; the largest is within [`INTENSITIES`].
    pub intensity: [f32; 3],
    /// Distance at which it ends, in world units, within [`RANGES`].
    pub range: f32,
    /// `None` shines all around.
    pub spot: Option<Spot>,
}

/// The cone of a punctual light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Unit vector whither it shines.
    pub direction: [f32; 3],
    /// Angle from there within which it is as bright as it gets, in radians, at most `outer`.
    pub inner: f32,
    /// Angle at which it is dark, in radians, above 0, at most π/2.
    pub outer: f32,
}

/// What a scene says of its punctual lights.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct PunctualLights {
    /// How many there are, 1 to [`MAX_PUNCTUAL_LIGHTS`].
    pub count: u32,
    /// The page, where there are at most [`FEW_PUNCTUAL_LIGHTS`] punctual lights; the directory, where there are at most [`FEW_PAGES`] pages;
    /// else nothing.
    pub first: Vec<u8>,
}

/// What [`PunctualLights::first`] holds.
#[derive(Clone, Debug, PartialEq)]
pub enum First {
    /// All punctual lights.
    PunctualLights(Vec<PunctualLight>),
    /// What each page lights.
    Directory(Vec<PunctualLightPageEntry>),
    /// The directory is to be asked for.
    Nothing,
}

/// Punctual lights that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PunctualLightsError {
    /// None, or more than [`MAX_PUNCTUAL_LIGHTS`].
    #[error("a scene says that it has {0} punctual lights; 1 to {MAX_PUNCTUAL_LIGHTS} can be")]
    Count(u32),
    /// Another number than the scene says.
    #[error("a page of punctual lights or of their directory has {got} entries, but should have {expected}")]
    WrongCount {
        /// How many it has.
        got: u64,
        /// How many it should have.
        expected: u32,
    },
    /// Another format than this program's.
    #[error("a page of punctual lights has format version {0}; update viewer or server")]
    Version(u8),
    /// The bytes end within a punctual light.
    #[error("a page of punctual lights ends too early")]
    EndsEarly,
    /// Bytes are left over.
    #[error("{0} bytes are left over behind punctual lights")]
    TrailingBytes(usize),
    /// A flag that is not known, or that refers to a punctual light that is not there.
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
    /// A direction that is none, or angles that are no cone.
    #[error(
        "a punctual light's cone has no direction, or not 0 <= inner <= outer <= 90 degrees with outer above 0"
    )]
    Cone,
    /// A sphere or strength of the directory that is none.
    #[error("the directory of punctual lights has a sphere or strength that is not a finite positive number")]
    Listed,
    /// Longer than [`MAX_PAGE_BYTES`].
    #[error("the directory of punctual lights has a page of {0} bytes; at most {MAX_PAGE_BYTES} can be")]
    PageTooLong(u32),
}

impl PunctualLight {
    /// The range of a punctual light that states none.
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

    /// The punctual light of a model, where the model stands: moved and turned. Scale moves it, and changes nothing else of it, as
    /// KHR_lights_punctual wants it of nodes.
    #[must_use]
    pub fn within(&self, translation: DVec3, rotation: DQuat, scale: f64) -> Self {
        let position = translation + rotation * (DVec3::from(self.position) * scale);
        let turned = |spot: Spot| Spot {
            direction: (rotation * Vec3::from(spot.direction).as_dvec3()).as_vec3().to_array(),
            ..spot
        };
        Self { position: position.to_array(), spot: self.spot.map(turned), ..*self }
    }

    /// Why the punctual light cannot be, if so.
    ///
    /// # Errors
    /// Names what is out of range.
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
    /// How many pages of so many punctual lights there are.
    #[must_use]
    pub const fn pages_of(count: u32) -> u32 {
        count.div_ceil(PUNCTUAL_LIGHTS_PER_PAGE)
    }

    /// How many punctual lights a page has of so many in all; 0 beyond the last.
    #[must_use]
    pub const fn on_page(count: u32, page: u32) -> u32 {
        let left = count.saturating_sub(page.saturating_mul(PUNCTUAL_LIGHTS_PER_PAGE));
        if left < PUNCTUAL_LIGHTS_PER_PAGE { left } else { PUNCTUAL_LIGHTS_PER_PAGE }
    }

    /// How many pages the directory of so many punctual lights has.
    #[must_use]
    pub const fn directory_pages_of(count: u32) -> u32 {
        Self::pages_of(count).div_ceil(LISTED_PER_PAGE)
    }

    /// How many entries a page of the directory of so many punctual lights has; 0 beyond the last.
    #[must_use]
    pub const fn on_directory_page(count: u32, page: u32) -> u32 {
        let left = Self::pages_of(count).saturating_sub(page.saturating_mul(LISTED_PER_PAGE));
        if left < LISTED_PER_PAGE { left } else { LISTED_PER_PAGE }
    }

    /// What is in the message.
    ///
    /// # Errors
    /// Punctual lights that cannot be. Memory is bounded by the bytes.
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
