//! A scene's terrain: the parameters from which a client generates it.

mod directory;

use lodestream_terrain::{PARAMETERS_BYTES, Parameters, Stamp, decode_stamps, encode_stamps};

use crate::encoding::{CodingError, Decode, Encode, Reader, Writer, encode_fields};

pub use directory::{DirectoryError, OverridePatch, PATCHES_PER_PAGE, decode_directory, encode_directory};

/// Most segments of all stamps of a terrain. With all of them near one tile, generating it takes some ten milliseconds.
pub const MAX_SEGMENTS: usize = 2048;
/// Most passes of erosion of a terrain. A coarse tile, whose points are eroded separately, then takes some 30 ms.
pub const MAX_EROSION_PASSES: u8 = 32;

/// A terrain and its placement: grid x is world x, grid y is world z, height is world y; grid point (0, 0) at height
/// 0 is the world's origin.
///
/// Parameters and units take 32 bytes on the wire, water 8.
#[derive(Clone, Debug, PartialEq)]
pub struct TerrainEntry {
    /// Parameters of the height function.
    pub parameters: Parameters,
    /// World units per grid unit, above 0.
    pub unit: f32,
    /// World units per height unit, above 0.
    pub height_unit: f32,
    /// Heights above which grass, hill and snow begin (sand is below), ascending, in world units.
    pub zones: [f32; 3],
    /// Features that a few numbers describe, in order; 20 to 100 bytes each.
    pub stamps: Vec<Stamp>,
    /// Number of patches with height overrides, each a blob of its own; at most [`MAX_OVERRIDE_PATCHES`].
    pub patches: u32,
    /// Water, if any.
    pub water: Option<Water>,
}

/// Water at one height over the whole terrain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Water {
    /// Height of its surface, world y.
    pub level: f32,
    /// World units of water after which a tenth of green light is left, 1e-6 to 1e9.
    pub clarity: f32,
}

encode_fields!(Water { level, clarity });

/// Most patches with height overrides. On the wire, the highest bit of their number says whether there is water.
pub const MAX_OVERRIDE_PATCHES: u32 = (1 << 31) - 1;

/// A terrain with a value out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TerrainEntryError {
    /// Parameters of the height function.
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
    /// More than [`MAX_OVERRIDE_PATCHES`].
    #[error("the terrain has height overrides in more than 2147483647 patches")]
    Patches,
    /// Where water stands, or how clear it is.
    #[error(
        "the terrain's water has a level that is not within 1e9, or a clarity that is not between 1e-6 and 1e9"
    )]
    Water,
}

/// Added to the number of patches where water follows.
const HAS_WATER: u32 = MAX_OVERRIDE_PATCHES + 1;

impl Encode for TerrainEntry {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.parameters.encode().encode(writer)?;
        self.unit.encode(writer)?;
        self.height_unit.encode(writer)?;
        self.zones.encode(writer)?;
        let stamps = if self.stamps.is_empty() {
            Vec::new()
        } else {
            encode_stamps(&self.stamps).map_err(CodingError::value)?
        };
        stamps.encode(writer)?;
        (self.patches | if self.water.is_some() { HAS_WATER } else { 0 }).encode(writer)?;
        self.water.map_or(Ok(()), |water| water.encode(writer))
    }
}

impl Decode for TerrainEntry {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let bytes = <[u8; PARAMETERS_BYTES]>::decode(reader)?;
        let parameters = Parameters::decode(&bytes).map_err(CodingError::value)?;
        let (unit, height_unit) = (f32::decode(reader)?, f32::decode(reader)?);
        let zones = <[f32; 3]>::decode(reader)?;
        let stamps = match &Vec::<u8>::decode(reader)?[..] {
            [] => Vec::new(),
            bytes => decode_stamps(bytes).map_err(CodingError::value)?,
        };
        let patches = u32::decode(reader)?;
        let water = if patches & HAS_WATER == 0 { None } else { Some(Water::decode(reader)?) };
        Ok(Self {
            parameters,
            unit,
            height_unit,
            zones,
            stamps,
            patches: patches & MAX_OVERRIDE_PATCHES,
            water,
        })
    }
}

impl TerrainEntry {
    /// Checks the ranges of all values.
    ///
    /// # Errors
    /// The first value that is out of range.
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
        // The next two limits bound the client's work per tile.
        if self.parameters.erosion.passes > MAX_EROSION_PASSES {
            return Err(TerrainEntryError::Erosion);
        }
        if self.stamps.iter().map(Stamp::segments).sum::<usize>() > MAX_SEGMENTS {
            return Err(TerrainEntryError::Segments);
        }
        if self.patches > MAX_OVERRIDE_PATCHES {
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
    use crate::encoding;

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
        let bytes = encoding::encode(&entry()).unwrap();
        // Parameters and units are 32 bytes, the zones 12, and two say that there are no features.
        assert_eq!(bytes.len(), 32 + 12 + 2);
        assert_eq!(encoding::decode(&bytes, 0), Ok(entry()));
        entry().check().unwrap();
        let wet = TerrainEntry { water: Some(Water { level: -4.0, clarity: 6.0 }), patches: 3, ..entry() };
        let bytes = encoding::encode(&wet).unwrap();
        // The number of patches is a long one with its highest bit.
        assert_eq!(bytes.len(), 32 + 12 + 2 + 4 + 8);
        assert_eq!(encoding::decode(&bytes, 0).as_ref(), Ok(&wet));
        wet.check().unwrap();
        for end in 0..bytes.len() {
            assert!(encoding::decode::<TerrainEntry>(&bytes[..end], 0).is_err(), "{end}");
        }
    }

    #[test]
    fn invalid_entries_are_refused() {
        let bad = |change: fn(&mut TerrainEntry)| {
            let mut entry = entry();
            change(&mut entry);
            entry.check().unwrap_err().to_string()
        };
        assert!(bad(|e| e.water = Some(Water { level: f32::NAN, clarity: 1.0 })).contains("water"));
        assert!(bad(|e| e.water = Some(Water { level: 0.0, clarity: 0.0 })).contains("clarity"));
        assert!(bad(|e| e.patches = MAX_OVERRIDE_PATCHES + 1).contains("patches"));
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
