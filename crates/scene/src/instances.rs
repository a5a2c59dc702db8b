//! Instances of a scene page, each coded by its differences from the one before.
//!
//! Programs that export buildings repeat windows, lamps and seats in rows: neighbours share the asset, the rotation, the
//! scale and often a coordinate, and their places are multiples of a power of two. Such an instance takes 6 to 11 bytes;
//! one without a rule, 12 for its translation, up to 16 for its rotation and 4 for its scale. Nothing is lost, and an
//! instance has one encoding.

use glam::{DVec3, Vec3};

use crate::encoding::{
    CodingError, Decode, Encode, Reader, Writer, decode_vector, encode_vector, vector_fits_f32,
};
use crate::placement::Placement;

/// One placed asset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Number of the asset.
    pub asset: u32,
    /// Where the asset stands.
    pub placement: Placement,
}

impl Instance {
    /// An instance without rotation and scale.
    #[must_use]
    pub const fn at(asset: u32, translation: [f64; 3]) -> Self {
        Self { asset, placement: Placement::at(translation) }
    }

    /// World position of a point given in asset units relative to the grid origin `origin`.
    #[must_use]
    pub fn to_world(&self, origin: [f64; 3], point: [f32; 3]) -> DVec3 {
        self.placement.to_world(DVec3::from(origin) + Vec3::from(point).as_dvec3())
    }
}

const FORM: u8 = 0b11;
const OTHER_ASSET: u8 = 1 << 2;
const TURN: u8 = 0b11 << 3;
const OTHER_SCALE: u8 = 1 << 5;
const FLAGS: u8 = FORM | OTHER_ASSET | TURN | OTHER_SCALE;

/// How a translation is coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// Multiples of the power of two of the instance before, as differences from its own.
    Steps,
    /// The same with another power of two.
    OtherSteps,
    Short,
    Long,
}

const FORMS: [Form; 4] = [Form::Steps, Form::OtherSteps, Form::Short, Form::Long];

/// How a rotation is coded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// As the instance before.
    Same,
    None,
    /// y and w; x and z are 0.
    AboutY,
    Any,
}

const TURNS: [Turn; 4] = [Turn::Same, Turn::None, Turn::AboutY, Turn::Any];

const NO_ROTATION: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// What an instance is coded against.
#[derive(Clone, Copy, Debug)]
struct Before {
    instance: Instance,
    /// Translations are multiples of 2 to the power of this, where they are coded as such.
    exponent: i8,
}

impl Before {
    const NOTHING: Self = Self { instance: Instance::at(0, [0.0; 3]), exponent: 0 };

    /// The translation before in steps, rounded; 0 where that is beyond the range of steps.
    fn steps(&self, exponent: i8) -> [i64; 3] {
        self.instance.placement.translation.map(|x| {
            let steps = (x * power(-i32::from(exponent))).round();
            #[expect(clippy::cast_possible_truncation, reason = "an integer within 2^53")]
            if steps.abs() <= MAX_STEPS { steps as i64 } else { 0 }
        })
    }

    fn choose(&self, instance: &Instance) -> Choice {
        let Placement { translation, rotation, scale } = instance.placement;
        let before = &self.instance.placement;
        let with = |exponent: i8, form, extra| {
            let steps = steps(&translation, exponent)?;
            let from = self.steps(exponent);
            let bytes: usize = steps.iter().zip(from).map(|(to, from)| zigzag_bytes(to - from)).sum();
            Some((bytes + extra, form, exponent))
        };
        let finest = finest_exponent(&translation).filter(|&exponent| exponent != self.exponent);
        let candidates = [
            with(self.exponent, Form::Steps, 0),
            finest.and_then(|exponent| with(exponent, Form::OtherSteps, 1)),
            vector_fits_f32(&translation).then_some((12, Form::Short, self.exponent)),
            Some((24, Form::Long, self.exponent)),
        ];
        let best = candidates.into_iter().flatten().min_by_key(|&(bytes, ..)| bytes);
        let (_, form, exponent) = best.unwrap_or((24, Form::Long, self.exponent));
        let turn = if same(&rotation, &before.rotation) {
            Turn::Same
        } else if same(&rotation, &NO_ROTATION) {
            Turn::None
        } else if same(&[rotation[0], rotation[2]], &[0.0; 2]) {
            Turn::AboutY
        } else {
            Turn::Any
        };
        Choice {
            form,
            exponent,
            other_asset: instance.asset != self.instance.asset,
            turn,
            other_scale: !same(&[scale], &[before.scale]),
        }
    }
}

/// The shortest encoding of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Choice {
    form: Form,
    /// The exponent afterwards.
    exponent: i8,
    other_asset: bool,
    turn: Turn,
    other_scale: bool,
}

impl Choice {
    const fn flags(self) -> u8 {
        let asset = if self.other_asset { OTHER_ASSET } else { 0 };
        let scale = if self.other_scale { OTHER_SCALE } else { 0 };
        self.form as u8 | (self.turn as u8) << TURN.trailing_zeros() | asset | scale
    }
}

/// Largest number of steps: below, every integer is exact in f64.
const MAX_STEPS: f64 = 9_007_199_254_740_992.0;

/// 2 to the power of an exponent within ±128.
fn power(exponent: i32) -> f64 {
    f64::from_bits(u64::from((1023 + exponent).unsigned_abs()) << 52)
}

/// Whether numbers have the same bits: −0 is not 0.
fn same(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

/// A vector as multiples of a power of two, if it is exactly that.
fn steps(v: &[f64; 3], exponent: i8) -> Option<[i64; 3]> {
    let [down, up] = [power(-i32::from(exponent)), power(exponent.into())];
    let mut steps = [0; 3];
    for (&x, step) in v.iter().zip(&mut steps) {
        // Adding 0 makes −0, which is no number of steps, another number. NaN is not within the limit.
        let number = (x * down).trunc() + 0.0;
        if !(number.abs() <= MAX_STEPS && (number * up).to_bits() == x.to_bits()) {
            return None;
        }
        #[expect(clippy::cast_possible_truncation, reason = "an integer within 2^53")]
        let number = number as i64;
        *step = number;
    }
    Some(steps)
}

/// The largest exponent of which a vector's components are multiples; `None` for zero, for what is not finite, and beyond
/// the range of exponents.
fn finest_exponent(v: &[f64; 3]) -> Option<i8> {
    let lowest = |x: &f64| {
        let bits = x.to_bits();
        let exponent = i32::try_from(bits >> 52 & 0x7ff).unwrap_or(0);
        let lowest_bit = (bits & ((1 << 52) - 1) | 1 << 52).trailing_zeros();
        exponent - 1075 + lowest_bit.cast_signed()
    };
    v.iter().filter(|x| **x != 0.0).map(lowest).min().and_then(|exponent| i8::try_from(exponent).ok())
}

/// Signed integers as 0, −1, 1, −2 … in groups of 7 bits, the lowest first (LEB128).
fn zigzag(number: i64) -> u64 {
    (number << 1 ^ number >> 63).cast_unsigned()
}

fn zigzag_bytes(number: i64) -> usize {
    let bits = u64::BITS - zigzag(number).leading_zeros();
    bits.div_ceil(7).max(1) as usize
}

fn write_zigzag<W: Writer>(number: i64, writer: &mut W) -> Result<(), CodingError> {
    let mut code = zigzag(number);
    while code >= 0x80 {
        let [low, ..] = code.to_le_bytes();
        (low | 0x80).encode(writer)?;
        code >>= 7;
    }
    let [low, ..] = code.to_le_bytes();
    low.encode(writer)
}

/// Reads an integer of at most 56 bits: steps are within 2^53.
fn read_zigzag<R: Reader>(reader: &mut R) -> Result<i64, CodingError> {
    let mut code = 0;
    for group in 0..8 {
        let byte = u8::decode(reader)?;
        code |= u64::from(byte & 0x7f) << (7 * group);
        if byte < 0x80 {
            if byte == 0 && group > 0 {
                return Err(CodingError::IntegerNotShortest);
            }
            return Ok((code >> 1).cast_signed() ^ -(code & 1).cast_signed());
        }
    }
    Err(CodingError::IntegerRange)
}

/// Appends the number of instances, then each.
///
/// # Errors
/// The writer's errors.
pub fn encode<W: Writer>(instances: &[Instance], writer: &mut W) -> Result<(), CodingError> {
    u64::try_from(instances.len()).map_err(|_| CodingError::LimitExceeded)?.encode(writer)?;
    let mut before = Before::NOTHING;
    for instance in instances {
        let choice = before.choose(instance);
        let Placement { translation, rotation, scale } = instance.placement;
        choice.flags().encode(writer)?;
        if choice.other_asset {
            instance.asset.encode(writer)?;
        }
        match choice.form {
            Form::Steps | Form::OtherSteps => {
                if choice.form == Form::OtherSteps {
                    choice.exponent.cast_unsigned().encode(writer)?;
                }
                let to = steps(&translation, choice.exponent)
                    .ok_or_else(|| CodingError::value("a translation without steps"))?;
                for (to, from) in to.iter().zip(before.steps(choice.exponent)) {
                    write_zigzag(to - from, writer)?;
                }
            }
            Form::Short => encode_vector(&translation, true, writer)?,
            Form::Long => encode_vector(&translation, false, writer)?,
        }
        match choice.turn {
            Turn::Same | Turn::None => {}
            Turn::AboutY => [rotation[1], rotation[3]].encode(writer)?,
            Turn::Any => rotation.encode(writer)?,
        }
        if choice.other_scale {
            scale.encode(writer)?;
        }
        before = Before { instance: *instance, exponent: choice.exponent };
    }
    Ok(())
}

/// Inverse of [`encode`]. Instances count against the reader's limit of memory.
///
/// # Errors
/// Bytes that are not the encoding of a list, or too few of them.
pub fn decode<R: Reader>(reader: &mut R) -> Result<Vec<Instance>, CodingError> {
    let count = u64::decode(reader)?;
    let mut instances = Vec::new();
    let mut before = Before::NOTHING;
    for _ in 0..count {
        reader.claim(size_of::<Instance>())?;
        let (instance, exponent) = decode_one(&before, reader)?;
        instances.push(instance);
        before = Before { instance, exponent };
    }
    Ok(instances)
}

fn decode_one<R: Reader>(before: &Before, reader: &mut R) -> Result<(Instance, i8), CodingError> {
    let flags = u8::decode(reader)?;
    if flags & !FLAGS != 0 {
        return Err(CodingError::value("unknown instance flags"));
    }
    let form = FORMS[usize::from(flags & FORM)];
    let turn = TURNS[usize::from((flags & TURN) >> TURN.trailing_zeros())];
    let asset = if flags & OTHER_ASSET != 0 { u32::decode(reader)? } else { before.instance.asset };
    let mut exponent = before.exponent;
    let translation = match form {
        Form::Steps | Form::OtherSteps => {
            if form == Form::OtherSteps {
                exponent = u8::decode(reader)?.cast_signed();
            }
            let mut translation = [0.0; 3];
            for (x, from) in translation.iter_mut().zip(before.steps(exponent)) {
                let steps = from + read_zigzag(reader)?;
                #[expect(clippy::cast_precision_loss, reason = "exact within the limit, and refused beyond")]
                let steps = steps as f64;
                if steps.abs() > MAX_STEPS {
                    return Err(CodingError::value("a translation of too many steps"));
                }
                *x = steps * power(exponent.into());
            }
            translation
        }
        Form::Short | Form::Long => decode_vector(form == Form::Short, reader)?,
    };
    let rotation = match turn {
        Turn::Same => before.instance.placement.rotation,
        Turn::None => NO_ROTATION,
        Turn::AboutY => {
            let [y, w] = <[f32; 2]>::decode(reader)?;
            [0.0, y, 0.0, w]
        }
        Turn::Any => <[f32; 4]>::decode(reader)?,
    };
    let scale = if flags & OTHER_SCALE != 0 { f32::decode(reader)? } else { before.instance.placement.scale };
    let instance = Instance { asset, placement: Placement { translation, rotation, scale } };
    let choice = before.choose(&instance);
    if (choice.flags(), choice.exponent) != (flags, exponent) {
        return Err(CodingError::value("an instance in another form than its shortest"));
    }
    Ok((instance, exponent))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::encoding::SliceReader;

    fn encoded(instances: &[Instance]) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode(instances, &mut bytes).unwrap();
        bytes
    }

    fn decoded(bytes: &[u8]) -> Result<Vec<Instance>, CodingError> {
        let mut reader = SliceReader::new(bytes, 1 << 20);
        let instances = decode(&mut reader)?;
        reader.finish()?;
        Ok(instances)
    }

    /// Compares bits: −0 equals 0 otherwise.
    fn bits(instances: &[Instance]) -> Vec<(u32, [u64; 3], [u32; 4], u32)> {
        let of = |instance: &Instance| {
            let Placement { translation, rotation, scale } = instance.placement;
            (instance.asset, translation.map(f64::to_bits), rotation.map(f32::to_bits), scale.to_bits())
        };
        instances.iter().map(of).collect()
    }

    #[test]
    fn rows_of_equal_objects_take_few_bytes() {
        let turned = [0.0, 0.6, 0.0, 0.8];
        let row = |n: u32| {
            let translation = [4_000.25 + 1.5 * f64::from(n), 2.0, -310.125];
            Instance { asset: 300, placement: Placement { translation, rotation: turned, scale: 0.5 } }
        };
        let instances: Vec<Instance> = (0..64).map(row).collect();
        let bytes = encoded(&instances);
        assert_eq!(bits(&decoded(&bytes).unwrap()), bits(&instances));
        // Flags and three differences each; the first has everything.
        assert_eq!(bytes.len(), 1 + 23 + 63 * 4);
    }

    #[test]
    fn damaged_and_unusual_encodings_are_refused() {
        let good = encoded(&[Instance::at(1, [0.5, 0.0, 0.0]), Instance::at(1, [1.5, 0.0, 0.0])]);
        for length in 0..good.len() {
            assert!(decoded(&good[..length]).is_err(), "{length} bytes");
        }
        // Flags, asset, exponent −1, one step, then a difference of two steps.
        assert_eq!(good, [2, 5, 1, 255, 2, 0, 0, 0, 4, 0, 0]);
        let cases: [(&str, &[u8]); 8] = [
            ("unknown flags", &[1, 0x40, 0, 0, 0]),
            ("the asset again", &[1, 4, 0, 0, 0, 0]),
            ("the rotation again", &[1, 8, 0, 0, 0]),
            ("a finer step than needed", &[1, 1, 254, 4, 0, 0]),
            ("a longer integer than needed", &[1, 0, 0x80, 0, 0, 0]),
            ("too long an integer", &[1, 0, 255, 255, 255, 255, 255, 255, 255, 255, 0, 0, 0]),
            ("too many steps", &[1, 0, 254, 255, 255, 255, 255, 255, 255, 127, 0, 0]),
            ("an f32 where steps are shorter", &[1, 2, 0, 0, 128, 63, 0, 0, 0, 0, 0, 0, 0, 0]),
        ];
        for (what, bytes) in cases {
            assert!(decoded(bytes).is_err(), "{what}");
        }
        let many = [&[253, 255, 255, 255, 255, 255, 255, 255, 0][..], &[0; 4 << 16]].concat();
        assert!(decoded(&many).is_err(), "more than the limit of memory");
    }

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![
            Just(0.0),
            Just(-0.0),
            (-4_000_i32..4_000).prop_map(|n| f64::from(n) / 64.0),
            (-1e6_f32..1e6).prop_map(f64::from),
            -1e9..1e9,
            any::<f64>(),
        ]
    }

    fn instance() -> impl Strategy<Value = Instance> {
        let rotation = prop_oneof![
            Just(NO_ROTATION),
            (-1.0_f32..1.0).prop_map(|y| [0.0, y, 0.0, (1.0 - y * y).sqrt()]),
            prop::array::uniform4(any::<f32>()),
        ];
        let scale = prop_oneof![Just(1.0), Just(0.5), any::<f32>()];
        (0..400_u32, prop::array::uniform3(number()), rotation, scale).prop_map(
            |(asset, translation, rotation, scale)| Instance {
                asset,
                placement: Placement { translation, rotation, scale },
            },
        )
    }

    proptest! {
        #[test]
        fn instances_come_back_to_the_bit(list in prop::collection::vec((instance(), 1..4_usize), 0..20)) {
            let list: Vec<Instance> =
                list.into_iter().flat_map(|(instance, count)| std::iter::repeat_n(instance, count)).collect();
            let bytes = encoded(&list);
            prop_assert_eq!(bits(&decoded(&bytes).unwrap()), bits(&list));
        }

        #[test]
        fn bytes_that_decode_are_the_encoding(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            if let Ok(list) = decoded(&bytes) {
                prop_assert_eq!(encoded(&list), bytes);
            }
        }
    }
}
