//! Stamps: parametric shapes that change heights.

use super::mode::Mode;
use lodestream_geometry::DecodeError;
use lodestream_geometry::entropy::bytes::{Reader, put_varint};
use lodestream_geometry::numbers::id32;

/// Most stamps of a terrain.
pub const MAX_STAMPS: usize = 1024;
/// Most points of a river bed.
pub const MAX_RIVER_POINTS: usize = 16;
/// Largest radius, half width or falloff, in grid units.
pub const MAX_REACH: u32 = 1 << 20;
/// Largest difference of two ends of a segment, per axis, in grid units.
pub const MAX_SEGMENT: i64 = 1 << 22;
/// Largest coordinate.
const MAX_COORDINATE: i64 = 1 << 31;

/// A position (x, y) on the finest grid.
pub type Position = [i64; 2];

/// Outline and profile of a stamp. Lengths are grid units of the finest level.
///
/// Heights and depths of additive stamps are changes. Those of fixed stamps are heights above or below
/// [`super::Parameters::base`], with which the terrain is blended: fully where the stamp is strongest, less towards
/// its edge.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A crest between two positions, concave slopes.
    Ridge {
        /// One end.
        from: Position,
        /// The other.
        to: Position,
        /// Distance from the crest to where the slopes end.
        half_width: u32,
        /// Height of the crest.
        height: i32,
    },
    /// A trough between two positions, slopes rounded at both ends.
    Valley {
        /// One end.
        from: Position,
        /// The other.
        to: Position,
        /// Distance from the middle to where the slopes end.
        half_width: u32,
        /// Depth of the middle.
        depth: i32,
    },
    /// A bowl with a rim that falls off over another radius.
    Crater {
        /// Its middle.
        centre: Position,
        /// Radius of the rim.
        radius: u32,
        /// Depth of the bowl.
        depth: i32,
        /// Height of the rim.
        rim: i32,
    },
    /// A disc that is level (fixed) or raised (additive), with a slope around.
    Plateau {
        /// Its middle.
        centre: Position,
        /// Radius of the disc.
        radius: u32,
        /// Width of the slope.
        falloff: u32,
        /// Height of the disc.
        height: i32,
    },
    /// A channel along a line, flat for half its width.
    RiverBed {
        /// The line, 2 to [`MAX_RIVER_POINTS`] positions.
        line: Vec<Position>,
        /// Distance from the line to where the banks end.
        half_width: u32,
        /// Depth of the bed.
        depth: i32,
    },
}

/// A shape with its mode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Whether heights are set or added to.
    pub mode: Mode,
    /// The shape.
    pub shape: Shape,
}

impl Stamp {
    /// Checks that all numbers are in range.
    ///
    /// # Errors
    /// If a length is 0 or above [`MAX_REACH`], a position is beyond ±2^31, a segment longer than
    /// [`MAX_SEGMENT`], or a line has too few or too many positions.
    pub fn check(&self) -> Result<(), DecodeError> {
        let error = |why: String| Err(DecodeError::new("stamp", why));
        let line = self.line();
        if let Shape::RiverBed { line, .. } = &self.shape
            && !(2..=MAX_RIVER_POINTS).contains(&line.len())
        {
            return error(format!("a line of {} positions, must have 2 to {MAX_RIVER_POINTS}", line.len()));
        }
        for &[x, y] in &line {
            if x.unsigned_abs().max(y.unsigned_abs()) > MAX_COORDINATE as u64 {
                return error(format!("position ({x}, {y}) is beyond ±{MAX_COORDINATE}"));
            }
        }
        for pair in line.windows(2) {
            let longest = (0..2).map(|i| (pair[0][i] - pair[1][i]).abs()).max().unwrap_or(0);
            if longest > MAX_SEGMENT {
                return error(format!("a segment of {longest} grid units, at most {MAX_SEGMENT}"));
            }
        }
        let (name, length) = match self.shape {
            Shape::Ridge { half_width, .. }
            | Shape::Valley { half_width, .. }
            | Shape::RiverBed { half_width, .. } => ("half width", half_width),
            Shape::Crater { radius, .. } | Shape::Plateau { radius, .. } => ("radius", radius),
        };
        if !(1..=MAX_REACH).contains(&length) {
            return error(format!("a {name} of {length}, must be 1 to {MAX_REACH}"));
        }
        if let Shape::Plateau { falloff, .. } = self.shape
            && falloff > MAX_REACH
        {
            return error(format!("a falloff of {falloff}, at most {MAX_REACH}"));
        }
        Ok(())
    }

    /// The positions that define the shape.
    pub(super) fn line(&self) -> Vec<Position> {
        match &self.shape {
            Shape::Ridge { from, to, .. } | Shape::Valley { from, to, .. } => vec![*from, *to],
            Shape::Crater { centre, .. } | Shape::Plateau { centre, .. } => vec![*centre],
            Shape::RiverBed { line, .. } => line.clone(),
        }
    }

    /// Distance from [`Self::line`] at which the effect ends.
    pub(super) fn reach(&self) -> i64 {
        match self.shape {
            Shape::Ridge { half_width, .. }
            | Shape::Valley { half_width, .. }
            | Shape::RiverBed { half_width, .. } => i64::from(half_width),
            Shape::Crater { radius, .. } => 2 * i64::from(radius),
            Shape::Plateau { radius, falloff, .. } => i64::from(radius) + i64::from(falloff),
        }
    }

    /// Number of segments of its line, 1 for a position; proportional to the cost per point.
    #[must_use]
    pub fn segments(&self) -> usize {
        match &self.shape {
            Shape::RiverBed { line, .. } => line.len().saturating_sub(1).max(1),
            _ => 1,
        }
    }

    /// Slope, height over width, in 65536ths.
    pub(super) fn steepness(&self) -> u64 {
        let (height, width) = match self.shape {
            Shape::Ridge { half_width, height, .. } => (height.unsigned_abs(), half_width),
            Shape::Valley { half_width, depth, .. } => (depth.unsigned_abs(), half_width),
            // The banks take half the width.
            Shape::RiverBed { half_width, depth, .. } => (depth.unsigned_abs(), half_width / 2),
            Shape::Crater { radius, depth, rim, .. } => {
                (depth.unsigned_abs().saturating_add(rim.unsigned_abs()), radius)
            }
            Shape::Plateau { falloff, height, .. } => (height.unsigned_abs(), falloff),
        };
        (u64::from(height) << 16) / u64::from(width.max(1))
    }

    fn put(&self, out: &mut Vec<u8>) {
        let kind = match self.shape {
            Shape::Ridge { .. } => 0,
            Shape::Valley { .. } => 1,
            Shape::Crater { .. } => 2,
            Shape::Plateau { .. } => 3,
            Shape::RiverBed { .. } => 4,
        };
        out.push(kind | u8::from(self.mode == Mode::Fixed) << 3);
        let line = self.line();
        if let Shape::RiverBed { .. } = self.shape {
            put_varint(out, line.len() as u64);
        }
        let mut last = [0, 0];
        for position in line {
            (0..2).for_each(|i| put_varint(out, zigzag(position[i] - last[i])));
            last = position;
        }
        let (length, heights) = match self.shape {
            Shape::Ridge { half_width, height, .. } => (half_width, [height, 0]),
            Shape::Valley { half_width, depth, .. } | Shape::RiverBed { half_width, depth, .. } => {
                (half_width, [depth, 0])
            }
            Shape::Crater { radius, depth, rim, .. } => (radius, [depth, rim]),
            Shape::Plateau { radius, height, .. } => (radius, [height, 0]),
        };
        put_varint(out, u64::from(length));
        put_varint(out, zigzag(i64::from(heights[0])));
        match self.shape {
            Shape::Crater { .. } => put_varint(out, zigzag(i64::from(heights[1]))),
            Shape::Plateau { falloff, .. } => put_varint(out, u64::from(falloff)),
            _ => {}
        }
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, DecodeError> {
        let head = reader.u8()?;
        let mode = if head & 8 == 0 { Mode::Additive } else { Mode::Fixed };
        let kind = head & !8;
        let positions = match kind {
            0 | 1 => 2,
            2 | 3 => 1,
            4 => reader.varint32(id32(MAX_RIVER_POINTS))? as usize,
            _ => return Err(reader.error(format!("unknown kind {kind}"))),
        };
        let mut line = Vec::with_capacity(positions);
        let mut last = [0_i64, 0];
        for _ in 0..positions {
            for c in &mut last {
                *c += unzigzag(reader.varint(4 * MAX_COORDINATE.unsigned_abs())?);
            }
            line.push(last);
        }
        let length = reader.varint32(MAX_REACH)?;
        let height = read_height(reader)?;
        let shape = match kind {
            0 => Shape::Ridge { from: line[0], to: line[1], half_width: length, height },
            1 => Shape::Valley { from: line[0], to: line[1], half_width: length, depth: height },
            2 => Shape::Crater { centre: line[0], radius: length, depth: height, rim: read_height(reader)? },
            3 => {
                let falloff = reader.varint32(MAX_REACH)?;
                Shape::Plateau { centre: line[0], radius: length, falloff, height }
            }
            _ => Shape::RiverBed { line, half_width: length, depth: height },
        };
        let stamp = Self { mode, shape };
        stamp.check()?;
        Ok(stamp)
    }
}

/// Fewest bytes of a stamp: kind, a position, a length and two heights.
const MIN_BYTES: usize = 6;

/// Encodes stamps: their number (LEB128), then each. A ridge or valley takes 10 to 30 bytes, a crater or plateau 8 to
/// 25, a river bed 4 to 8 per position and 5 to 10 more.
///
/// # Errors
/// If there are more than [`MAX_STAMPS`], or one fails [`Stamp::check`].
pub fn encode_stamps(stamps: &[Stamp]) -> Result<Vec<u8>, DecodeError> {
    if stamps.len() > MAX_STAMPS {
        return Err(DecodeError::new("stamps", format!("{}, at most {MAX_STAMPS}", stamps.len())));
    }
    let mut out = Vec::new();
    put_varint(&mut out, stamps.len() as u64);
    for stamp in stamps {
        stamp.check()?;
        stamp.put(&mut out);
    }
    Ok(out)
}

/// Decodes the result of [`encode_stamps`]. Memory is bounded by the input.
///
/// # Errors
/// If the bytes are not stamps that pass [`Stamp::check`], or have trailing bytes.
pub fn decode_stamps(bytes: &[u8]) -> Result<Vec<Stamp>, DecodeError> {
    let mut reader = Reader::new(bytes, "stamps");
    let count = reader.varint32(id32(MAX_STAMPS))? as usize;
    if count * MIN_BYTES > reader.remaining() {
        return Err(reader.error(format!("{count} stamps in {} bytes", reader.remaining())));
    }
    let stamps = (0..count).map(|_| Stamp::read(&mut reader)).collect::<Result<_, _>>()?;
    match reader.remaining() {
        0 => Ok(stamps),
        left => Err(reader.error(format!("{left} bytes too many"))),
    }
}

fn read_height(reader: &mut Reader<'_>) -> Result<i32, DecodeError> {
    let value = unzigzag(reader.varint(u64::from(u32::MAX))?);
    i32::try_from(value).map_err(|_| reader.error("a height is not a 32-bit number"))
}

/// Zigzag code of a signed integer.
fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)).cast_unsigned()
}

fn unzigzag(code: u64) -> i64 {
    (code >> 1).cast_signed() ^ -(code & 1).cast_signed()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const HEIGHTS: [i32; 5] = [i32::MIN, -300, 0, 40_000, i32::MAX];

    /// A shape with arbitrary numbers.
    pub(crate) fn any_stamp() -> impl Strategy<Value = Stamp> {
        let near = -3000_i64..3000;
        let centre =
            (-MAX_COORDINATE + 9000..MAX_COORDINATE - 9000, -MAX_COORDINATE + 9000..MAX_COORDINATE - 9000);
        let ends = prop::collection::vec((near.clone(), near), 2..=MAX_RIVER_POINTS);
        let heights = (0..HEIGHTS.len(), 0..HEIGHTS.len()).prop_map(|(a, b)| (HEIGHTS[a], HEIGHTS[b]));
        (0..5, any::<bool>(), centre, ends, 1..=MAX_REACH, 0..=MAX_REACH, heights).prop_map(
            |(kind, fixed, centre, ends, length, falloff, (height, rim))| {
                let line: Vec<Position> = ends.iter().map(|e| [centre.0 + e.0, centre.1 + e.1]).collect();
                let (from, to) = (line[0], line[1]);
                let shape = match kind {
                    0 => Shape::Ridge { from, to, half_width: length, height },
                    1 => Shape::Valley { from, to, half_width: length, depth: height },
                    2 => Shape::Crater { centre: from, radius: length, depth: height, rim },
                    3 => Shape::Plateau { centre: from, radius: length, falloff, height },
                    _ => Shape::RiverBed { line, half_width: length, depth: height },
                };
                Stamp { mode: if fixed { Mode::Fixed } else { Mode::Additive }, shape }
            },
        )
    }

    proptest! {
        #[test]
        fn stamps_survive_in_a_hundred_bytes_each(stamps in prop::collection::vec(any_stamp(), 0..6)) {
            let bytes = encode_stamps(&stamps).unwrap();
            prop_assert_eq!(&decode_stamps(&bytes).unwrap(), &stamps);
            prop_assert!(bytes.len() <= 1 + 100 * stamps.len());
            for cut in 0..bytes.len() {
                prop_assert!(decode_stamps(&bytes[..cut]).is_err());
            }
            let more = [&bytes[..], &[0]].concat();
            prop_assert!(decode_stamps(&more).is_err());
        }

        #[test]
        fn any_bytes_give_sound_stamps_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            if let Ok(stamps) = decode_stamps(&bytes) {
                prop_assert_eq!(decode_stamps(&encode_stamps(&stamps).unwrap()).unwrap(), stamps);
            }
        }
    }

    #[test]
    fn stamps_out_of_range_are_refused_with_a_reason() {
        let valley = |to: Position, half_width| {
            let shape = Shape::Valley { from: [0, 0], to, half_width, depth: 1 };
            Stamp { mode: Mode::Additive, shape }.check().map_err(|e| e.to_string())
        };
        assert_eq!(valley([100, 0], 5), Ok(()));
        assert!(valley([100, 0], 0).unwrap_err().contains("half width of 0"));
        assert!(valley([MAX_SEGMENT + 1, 0], 5).unwrap_err().contains("a segment of 4194305"));
        assert!(valley([0, i64::MIN], 5).unwrap_err().contains("beyond"));
        let line = Shape::RiverBed { line: vec![[0, 0]; 17], half_width: 1, depth: 1 };
        let stamp = Stamp { mode: Mode::Additive, shape: line };
        assert!(stamp.check().unwrap_err().to_string().contains("17 positions"));
        assert!(decode_stamps(&[0xff, 0x7f]).unwrap_err().to_string().contains("exceeds"));
        assert!(decode_stamps(&[100, 0, 0, 0]).unwrap_err().to_string().contains("100 stamps in 3 bytes"));
    }
}
