//! What the pages of lamps light: pages of a directory.

use bincode::config::{Configuration, Limit, LittleEndian, Varint};
use bincode::{Decode, Encode};
use glam::{DVec3, Vec3};

use super::{Lamp, LampsError, MAX_PAGE_BYTES};

/// Pages of lamps on one page of the directory.
pub const LISTED_PER_PAGE: u32 = 256;

const CONFIG: Configuration<LittleEndian, Varint, Limit<{ 64 * 1024 }>> =
    bincode::config::standard().with_limit::<{ 64 * 1024 }>();

/// A page of lamps, as far as must be known before it is asked for. 21 to 23 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct ListedLamps {
    /// Centre of a sphere that holds all that the page's lamps reach, in world units.
    pub center: [f32; 3],
    /// Its radius, in world units.
    pub radius: f32,
    /// Sum over the lamps of their brightest colour's luminous intensity, in candela.
    pub intensity: f32,
    /// Length of the page, in bytes.
    pub bytes: u32,
}

impl ListedLamps {
    /// The entry of a page that is so long.
    #[must_use]
    pub fn of(lamps: &[Lamp], bytes: u32) -> Self {
        let places = || lamps.iter().map(|lamp| (DVec3::from(lamp.position), f64::from(lamp.range)));
        let low = places().fold(DVec3::INFINITY, |low, (at, range)| low.min(at - range));
        let high = places().fold(DVec3::NEG_INFINITY, |high, (at, range)| high.max(at + range));
        let center = (0.5 * (low + high)).as_vec3();
        // About the centre as it is written, and a little more for what 32 bits make of the radius.
        let reach = places().map(|(at, range)| at.distance(center.as_dvec3()) + range).fold(0.0, f64::max);
        #[expect(clippy::cast_possible_truncation, reason = "made larger first by more than is lost")]
        let radius = (reach * (1.0 + 1e-6)) as f32;
        Self { center: center.to_array(), radius, intensity: lamps.iter().map(Lamp::brightest).sum(), bytes }
    }

    fn check(&self) -> Result<(), LampsError> {
        let positive = |x: f32| x.is_finite() && x >= 0.0;
        let finite = Vec3::from(self.center).is_finite();
        if !(finite && positive(self.radius) && positive(self.intensity)) {
            return Err(LampsError::Listed);
        }
        if self.bytes > MAX_PAGE_BYTES { Err(LampsError::PageTooLong(self.bytes)) } else { Ok(()) }
    }
}

/// A page of the directory as bytes. At most [`LISTED_PER_PAGE`] entries.
///
/// # Errors
/// If there are more, or an entry cannot be.
pub fn encode_directory(listed: &[ListedLamps]) -> Result<Vec<u8>, LampsError> {
    let wrong = LampsError::WrongCount { got: listed.len() as u64, expected: LISTED_PER_PAGE };
    if listed.len() > LISTED_PER_PAGE as usize {
        return Err(wrong);
    }
    listed.iter().try_for_each(ListedLamps::check)?;
    // Plain numbers into memory: nothing else can fail.
    bincode::encode_to_vec(listed, CONFIG).map_err(|_| wrong)
}

/// Reads a page of the directory that must hold `count` entries.
///
/// # Errors
/// If the bytes are not such a page. Memory is bounded by the bytes.
pub fn decode_directory(bytes: &[u8], count: u32) -> Result<Vec<ListedLamps>, LampsError> {
    let (listed, used): (Vec<ListedLamps>, usize) =
        bincode::decode_from_slice(bytes, CONFIG).map_err(|_| LampsError::EndsEarly)?;
    if used != bytes.len() {
        return Err(LampsError::TrailingBytes(bytes.len() - used));
    }
    if listed.len() != count as usize {
        return Err(LampsError::WrongCount { got: listed.len() as u64, expected: count });
    }
    listed.iter().try_for_each(ListedLamps::check)?;
    Ok(listed)
}
