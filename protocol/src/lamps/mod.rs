//! What a scene says of its lamps: how many there are, and pages of them that a client asks for.
//!
//! A scene's few lamps are in the message that says so ([`Lamps`]). More are blobs ([`crate::blob::LampBlob`]): pages of
//! [`LAMPS_PER_PAGE`], and a directory of what each page lights, by which a client knows which ones its view wants.

mod directory;
mod numbers;
mod page;

use bincode::{Decode, Encode};
use glam::{DQuat, DVec3, Vec3};

pub use directory::{LISTED_PER_PAGE, ListedLamps, decode_directory, encode_directory};
pub use page::{MAX_PAGE_BYTES, decode_page, encode_page};

/// Most lamps of a scene.
pub const MAX_LAMPS: u32 = 1 << 18;
/// Lamps of a page; the last may have fewer.
pub const LAMPS_PER_PAGE: u32 = 64;
/// Most lamps that are in the message itself.
pub const FEW_LAMPS: u32 = 16;
/// Most pages whose directory is in the message.
pub const FEW_PAGES: u32 = 16;
/// Least and most luminous intensity of a lamp's brightest colour, in candela.
pub const INTENSITIES: [f32; 2] = [1e-6, 1e12];
/// Least and greatest range of a lamp, in world units.
pub const RANGES: [f32; 2] = [1e-6, 1e12];
/// Largest coordinate of a lamp, in world units.
pub const MAX_COORDINATE: f64 = 1e12;

/// Range over the root of the intensity, where a lamp states none: it then ends where it gives a hundredth of a lux.
const RANGE_OVER_ROOT: f32 = 10.0;

/// A light that stands in the scene, as KHR_lights_punctual has it: its light falls with the square of distance, and to
/// nothing at its range.
///
/// On a page it takes 14 bytes, a spot 22, less what it shares with the one before. Positions come back within 1/2048 of
/// the smallest range of their page on each axis (or 2⁻⁴¹ of the page's extent, where that is more), intensity and
/// range within 0.2 %, colours within 1/510 of the brightest component, directions and angles within 0.004°.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Where it is, in world units; at most [`MAX_COORDINATE`] each way.
    pub position: [f64; 3],
    /// Luminous intensity of red, green and blue, linear, in candela; the largest is within [`INTENSITIES`].
    pub intensity: [f32; 3],
    /// Distance at which it ends, in world units, within [`RANGES`].
    pub range: f32,
    /// `None` shines all around.
    pub spot: Option<Spot>,
}

/// The cone of a lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Unit vector whither it shines.
    pub direction: [f32; 3],
    /// Angle from there within which it is as bright as it gets, in radians, at most `outer`.
    pub inner: f32,
    /// Angle at which it is dark, in radians, above 0, at most π/2.
    pub outer: f32,
}

/// What a scene says of its lamps.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct Lamps {
    /// How many there are, 1 to [`MAX_LAMPS`].
    pub count: u32,
    /// The page, where there are at most [`FEW_LAMPS`] lamps; the directory, where there are at most [`FEW_PAGES`] pages;
    /// else nothing.
    pub first: Vec<u8>,
}

/// What [`Lamps::first`] holds.
#[derive(Clone, Debug, PartialEq)]
pub enum First {
    /// All lamps.
    Lamps(Vec<Lamp>),
    /// What each page lights.
    Directory(Vec<ListedLamps>),
    /// The directory is to be asked for.
    Nothing,
}

/// Lamps that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LampsError {
    /// None, or more than [`MAX_LAMPS`].
    #[error("a scene says that it has {0} lamps; 1 to {MAX_LAMPS} can be")]
    Count(u32),
    /// Another number than the scene says.
    #[error("a page of lamps or of their directory has {got} entries, but should have {expected}")]
    WrongCount {
        /// How many it has.
        got: u64,
        /// How many it should have.
        expected: u32,
    },
    /// Another format than this program's.
    #[error("a page of lamps has format version {0}; update viewer or server")]
    Version(u8),
    /// The bytes end within a lamp.
    #[error("a page of lamps ends too early")]
    EndsEarly,
    /// Bytes are left over.
    #[error("{0} bytes are left over behind lamps")]
    TrailingBytes(usize),
    /// A flag that is not known, or that refers to a lamp that is not there.
    #[error("a lamp has unknown flags {0:#04x}")]
    Flags(u8),
    /// Not finite, or beyond [`MAX_COORDINATE`].
    #[error("a lamp's position is not within 1e12")]
    Position,
    /// Beyond [`INTENSITIES`], or a colour without a brightest component.
    #[error("a lamp's intensity is not from 1e-6 to 1e12")]
    Intensity,
    /// Beyond [`RANGES`].
    #[error("a lamp's range is not from 1e-6 to 1e12")]
    Range,
    /// A direction that is none, or angles that are no cone.
    #[error("a lamp's cone has no direction, or not 0 <= inner <= outer <= 90 degrees with outer above 0")]
    Cone,
    /// A sphere or strength of the directory that is none.
    #[error("the directory of lamps has a sphere or strength that is not a finite positive number")]
    Listed,
    /// Longer than [`MAX_PAGE_BYTES`].
    #[error("the directory of lamps has a page of {0} bytes; at most {MAX_PAGE_BYTES} can be")]
    PageTooLong(u32),
}

impl Lamp {
    /// The range of a lamp that states none.
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

    /// The lamp of a model, where the model stands: moved and turned. Scale moves it, and changes nothing else of it, as
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

    /// Why the lamp cannot be, if so.
    ///
    /// # Errors
    /// Names what is out of range.
    pub fn check(&self) -> Result<(), LampsError> {
        let ensure = |holds, why| if holds { Ok(()) } else { Err(why) };
        ensure(self.position.iter().all(|x| x.abs() <= MAX_COORDINATE), LampsError::Position)?;
        let [least, most] = INTENSITIES;
        let all = self.intensity.iter().all(|i| (0.0..=most).contains(i));
        ensure(all && self.brightest() >= least, LampsError::Intensity)?;
        ensure((RANGES[0]..=RANGES[1]).contains(&self.range), LampsError::Range)?;
        let Some(Spot { direction, inner, outer }) = self.spot else { return Ok(()) };
        let length = Vec3::from(direction).length();
        let cone = (0.0..=outer).contains(&inner) && outer > 0.0 && outer <= std::f32::consts::FRAC_PI_2;
        ensure((0.9..=1.1).contains(&length) && cone, LampsError::Cone)
    }
}

impl Lamps {
    /// How many pages of so many lamps there are.
    #[must_use]
    pub const fn pages_of(count: u32) -> u32 {
        count.div_ceil(LAMPS_PER_PAGE)
    }

    /// How many lamps a page has of so many in all; 0 beyond the last.
    #[must_use]
    pub const fn on_page(count: u32, page: u32) -> u32 {
        let left = count.saturating_sub(page.saturating_mul(LAMPS_PER_PAGE));
        if left < LAMPS_PER_PAGE { left } else { LAMPS_PER_PAGE }
    }

    /// How many pages the directory of so many lamps has.
    #[must_use]
    pub const fn directory_pages_of(count: u32) -> u32 {
        Self::pages_of(count).div_ceil(LISTED_PER_PAGE)
    }

    /// How many entries a page of the directory of so many lamps has; 0 beyond the last.
    #[must_use]
    pub const fn on_directory_page(count: u32, page: u32) -> u32 {
        let left = Self::pages_of(count).saturating_sub(page.saturating_mul(LISTED_PER_PAGE));
        if left < LISTED_PER_PAGE { left } else { LISTED_PER_PAGE }
    }

    /// What is in the message.
    ///
    /// # Errors
    /// Lamps that cannot be. Memory is bounded by the bytes.
    pub fn first(&self) -> Result<First, LampsError> {
        if !(1..=MAX_LAMPS).contains(&self.count) {
            return Err(LampsError::Count(self.count));
        }
        if self.count <= FEW_LAMPS {
            return decode_page(&self.first, self.count).map(First::Lamps);
        }
        let pages = Self::pages_of(self.count);
        if pages <= FEW_PAGES {
            return decode_directory(&self.first, pages).map(First::Directory);
        }
        match self.first.len() {
            0 => Ok(First::Nothing),
            more => Err(LampsError::TrailingBytes(more)),
        }
    }
}

#[cfg(test)]
mod tests;
