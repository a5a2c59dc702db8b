//! What a scene says of its terrain: the few bytes from which a client makes all of it.

mod directory;

use bincode::de::Decoder;
use bincode::enc::Encoder;
use bincode::error::{DecodeError, EncodeError};
use bincode::{Decode, Encode};
use lodestream_terrain::{PARAMETERS_BYTES, Parameters, Stamp, decode_stamps, encode_stamps};

pub use directory::{DirectoryError, OverridePatch, PATCHES_PER_PAGE, decode_directory, encode_directory};

/// Most segments of all stamps of a scene's terrain: with so many around it, a tile takes some ten milliseconds.
pub const MAX_SEGMENTS: usize = 2048;
/// Most passes of erosion of a scene's terrain: a tile of points far apart, each eroded alone, takes some 30 ms.
pub const MAX_EROSION_PASSES: u8 = 32;

/// A terrain and how it lies in the world: grid x is world x, grid y world z, height world y; grid point (0, 0) with
/// height 0 is the world's origin.
///
/// Parameters and units take 32 bytes on the wire, water 8.
#[derive(Clone, Debug, PartialEq)]
pub struct TerrainEntry {
    /// What heights follow from.
    pub parameters: Parameters,
    /// World units per grid unit, above 0.
    pub unit: f32,
    /// World units per height unit, above 0.
    pub height_unit: f32,
    /// Heights above which grass, hill and snow begin (sand is below), ascending, in world units.
    pub zones: [f32; 3],
    /// Features that a few numbers describe, in order; 20 to 100 bytes each.
    pub stamps: Vec<Stamp>,
    /// Number of patches whose listed points are blobs of their own, at most [`MAX_LISTED`].
    pub patches: u32,
    /// Water over it.
    pub water: Option<Water>,
}

/// Water that stands at one height all over a terrain: where the ground rises over it there is land.
#[derive(Clone, Copy, Debug, PartialEq, Encode, Decode)]
pub struct Water {
    /// Height of its surface, world y.
    pub level: f32,
    /// World units of water after which a tenth of green light is left, 1e-6 to 1e9.
    pub clarity: f32,
}

/// Most patches with listed points: the highest bit of their number says whether there is water.
pub const MAX_LISTED: u32 = (1 << 31) - 1;

/// A terrain that a scene cannot have: what of it is out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TerrainEntryError {
    /// What heights follow from.
    #[error("the terrain's parameters are out of range")]
    Parameters,
    /// World units per grid or height unit.
    #[error("the terrain's units are not between 1e-6 and 1e6")]
    Units,
    /// Where sand, grass and hill end.
    #[error("the terrain's zones are not three ascending heights")]
    Zones,
    /// More than [`MAX_EROSION_PASSES`].
    #[error("the terrain's erosion has more than 32 passes")]
    Erosion,
    /// More than [`MAX_SEGMENTS`].
    #[error("the terrain's stamps have more than 2048 segments together")]
    Segments,
    /// More than [`MAX_LISTED`].
    #[error("the terrain has points in more than 2147483647 patches")]
    Patches,
    /// Where water stands, or how clear it is.
    #[error(
        "the terrain's water has a level that is not within 1e9, or a clarity that is not between 1e-6 and 1e9"
    )]
    Water,
}

/// Added to the number of patches where water follows.
const WET: u32 = MAX_LISTED + 1;

impl Encode for TerrainEntry {
    fn encode<E: Encoder>(&self, e: &mut E) -> Result<(), EncodeError> {
        self.parameters.encode().encode(e)?;
        self.unit.encode(e)?;
        self.height_unit.encode(e)?;
        self.zones.encode(e)?;
        let stamps = if self.stamps.is_empty() {
            Vec::new()
        } else {
            encode_stamps(&self.stamps).map_err(|why| EncodeError::OtherString(why.to_string()))?
        };
        stamps.encode(e)?;
        (self.patches | if self.water.is_some() { WET } else { 0 }).encode(e)?;
        self.water.map_or(Ok(()), |water| water.encode(e))
    }
}

impl<Context> Decode<Context> for TerrainEntry {
    fn decode<D: Decoder<Context = Context>>(d: &mut D) -> Result<Self, DecodeError> {
        let bytes = <[u8; PARAMETERS_BYTES]>::decode(d)?;
        let parameters =
            Parameters::decode(&bytes).map_err(|why| DecodeError::OtherString(why.to_string()))?;
        let (unit, height_unit) = (f32::decode(d)?, f32::decode(d)?);
        let zones = <[f32; 3]>::decode(d)?;
        let stamps = match &Vec::<u8>::decode(d)?[..] {
            [] => Vec::new(),
            bytes => decode_stamps(bytes).map_err(|why| DecodeError::OtherString(why.to_string()))?,
        };
        let patches = u32::decode(d)?;
        let water = if patches & WET == 0 { None } else { Some(Water::decode(d)?) };
        Ok(Self { parameters, unit, height_unit, zones, stamps, patches: patches & MAX_LISTED, water })
    }
}

bincode::impl_borrow_decode!(TerrainEntry);

impl TerrainEntry {
    /// Why the terrain cannot be used, if so.
    ///
    /// # Errors
    /// Names what is out of range.
    pub fn check(&self) -> Result<(), TerrainEntryError> {
        self.parameters.check().map_err(|_| TerrainEntryError::Parameters)?;
        let length = |x: f32| x.is_finite() && (1e-6..=1e6).contains(&x);
        if !length(self.unit) || !length(self.height_unit) {
            return Err(TerrainEntryError::Units);
        }
        let [sand, grass, hill] = self.zones;
        if !(self.zones.iter().all(|z| z.is_finite()) && sand < grass && grass < hill) {
            return Err(TerrainEntryError::Zones);
        }
        // What follows bounds the work of a viewer for each tile.
        if self.parameters.erosion.passes > MAX_EROSION_PASSES {
            return Err(TerrainEntryError::Erosion);
        }
        if self.stamps.iter().map(Stamp::segments).sum::<usize>() > MAX_SEGMENTS {
            return Err(TerrainEntryError::Segments);
        }
        if self.patches > MAX_LISTED {
            return Err(TerrainEntryError::Patches);
        }
        let sound = |water: &Water| water.level.abs() <= 1e9 && (1e-6..=1e9).contains(&water.clarity);
        if !self.water.as_ref().is_none_or(sound) {
            return Err(TerrainEntryError::Water);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use lodestream_terrain::{Mode, Shape};

    use super::*;

    fn entry() -> TerrainEntry {
        TerrainEntry {
            parameters: Parameters { seed: 7, ..Parameters::default() },
            unit: 2.0,
            height_unit: 0.01,
            zones: [0.0, 120.0, 300.0],
            stamps: Vec::new(),
            patches: 0,
            water: None,
        }
    }

    #[test]
    fn entries_survive_the_wire() {
        let config = bincode::config::standard();
        let bytes = bincode::encode_to_vec(entry(), config).unwrap();
        // Parameters and units are 32 bytes, the zones 12, and two say that there are no features.
        assert_eq!(bytes.len(), 32 + 12 + 2);
        let (decoded, used) = bincode::decode_from_slice::<TerrainEntry, _>(&bytes, config).unwrap();
        assert_eq!((decoded, used), (entry(), bytes.len()));
        entry().check().unwrap();
        let wet = TerrainEntry { water: Some(Water { level: -4.0, clarity: 6.0 }), patches: 3, ..entry() };
        let bytes = bincode::encode_to_vec(&wet, config).unwrap();
        // The number of patches is a long one with its highest bit.
        assert_eq!(bytes.len(), 32 + 12 + 2 + 4 + 8);
        let (decoded, used) = bincode::decode_from_slice::<TerrainEntry, _>(&bytes, config).unwrap();
        assert_eq!((&decoded, used), (&wet, bytes.len()));
        wet.check().unwrap();
        for end in 0..bytes.len() {
            assert!(bincode::decode_from_slice::<TerrainEntry, _>(&bytes[..end], config).is_err(), "{end}");
        }
    }

    #[test]
    fn unusable_entries_are_named() {
        let bad = |change: fn(&mut TerrainEntry)| {
            let mut entry = entry();
            change(&mut entry);
            entry.check().unwrap_err().to_string()
        };
        assert!(bad(|e| e.water = Some(Water { level: f32::NAN, clarity: 1.0 })).contains("water"));
        assert!(bad(|e| e.water = Some(Water { level: 0.0, clarity: 0.0 })).contains("clarity"));
        assert!(bad(|e| e.patches = MAX_LISTED + 1).contains("patches"));
        assert!(bad(|e| e.unit = 0.0).contains("units"));
        assert!(bad(|e| e.height_unit = f32::NAN).contains("units"));
        assert!(bad(|e| e.zones = [0.0, 0.0, 1.0]).contains("zones"));
        assert!(bad(|e| e.parameters.finest_level = 0).contains("parameters"));
        assert!(bad(|e| e.parameters.erosion.passes = 33).contains("32 passes"));
        assert!(
            bad(|e| {
                let line = (0..16).map(|i| [i, i]).collect();
                let shape = Shape::RiverBed { line, half_width: 9, depth: 1 };
                e.stamps = vec![Stamp { mode: Mode::Additive, shape }; 137];
            })
            .contains("2048 segments")
        );
    }
}
