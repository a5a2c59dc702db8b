//! An animated model as bytes. Equal models have equal bytes: numbers are in f32 where all of a group are exact in it.

use glam::DAffine3;

use super::{
    AnimatedModel, AnimatedNode, AnimatedPart, AnimatedSkin, AnimationError, Channel, Clip,
    MAX_ANIMATION_BYTES, Rest, SkinJoint,
};
use crate::encoding::{self, CodingError, Decode, Encode, Reader, Writer, encode_fields};

const VERSION: u8 = 2;
/// Memory that a decoded model may take: so much for each byte, but at most…
const MEMORY_PER_BYTE: usize = 64;
/// …so much for each byte…
const LONG_MEMORY_PER_BYTE: usize = 4;
/// …and this.
const MEMORY_BYTES: usize = 32 << 20;

/// As the default says.
const DEFAULT: u8 = 0;
/// In f32.
const SHORT: u8 = 1;
/// In f64.
const LONG: u8 = 2;

/// Numbers with a default that takes one byte.
struct Numbers<const N: usize>([f64; N]);

#[expect(clippy::cast_possible_truncation, reason = "only used where it is exact")]
fn short(value: f64) -> f32 {
    value as f32
}

impl<const N: usize> Numbers<N> {
    fn form(&self, default: &[f64; N]) -> u8 {
        let same = |a: &f64, b: &f64| a.to_bits() == b.to_bits();
        if self.0.iter().zip(default).all(|(a, b)| same(a, b)) {
            DEFAULT
        } else if self.0.iter().all(|x| same(&f64::from(short(*x)), x)) {
            SHORT
        } else {
            LONG
        }
    }

    fn encode<W: Writer>(&self, default: &[f64; N], writer: &mut W) -> Result<(), CodingError> {
        let form = self.form(default);
        form.encode(writer)?;
        match form {
            DEFAULT => Ok(()),
            SHORT => self.0.map(short).encode(writer),
            _ => self.0.encode(writer),
        }
    }

    fn decode<R: Reader>(default: &[f64; N], reader: &mut R) -> Result<[f64; N], CodingError> {
        let form = u8::decode(reader)?;
        let mut numbers = *default;
        for number in numbers.iter_mut().filter(|_| form != DEFAULT) {
            *number = if form == SHORT { f32::decode(reader)?.into() } else { f64::decode(reader)? };
        }
        if !numbers.iter().all(|x| x.is_finite()) || Self(numbers).form(default) != form {
            return Err(CodingError::value(
                "numbers of an animation are not finite, or not in their shortest form",
            ));
        }
        Ok(numbers)
    }
}

fn encode_affine<W: Writer>(map: &DAffine3, writer: &mut W) -> Result<(), CodingError> {
    Numbers(map.to_cols_array()).encode(&DAffine3::IDENTITY.to_cols_array(), writer)
}

fn decode_affine<R: Reader>(reader: &mut R) -> Result<DAffine3, CodingError> {
    let columns = Numbers::decode(&DAffine3::IDENTITY.to_cols_array(), reader)?;
    Ok(DAffine3::from_cols_array(&columns))
}

impl Encode for AnimatedNode {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.parent.encode(writer)?;
        encode_affine(&self.to_parent, writer)?;
        let (Rest { translation, rotation, scale }, usual) = (self.rest, Rest::default());
        Numbers(translation).encode(&usual.translation, writer)?;
        Numbers(rotation).encode(&usual.rotation, writer)?;
        Numbers(scale).encode(&usual.scale, writer)
    }
}

impl Decode for AnimatedNode {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let usual = Rest::default();
        Ok(Self {
            parent: Option::decode(reader)?,
            to_parent: decode_affine(reader)?,
            rest: Rest {
                translation: Numbers::decode(&usual.translation, reader)?,
                rotation: Numbers::decode(&usual.rotation, reader)?,
                scale: Numbers::decode(&usual.scale, reader)?,
            },
        })
    }
}

impl Encode for AnimatedPart {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.node.encode(writer)?;
        encode_affine(&self.to_node, writer)?;
        encode_affine(&self.from_model, writer)
    }
}

impl Decode for AnimatedPart {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        Ok(Self {
            node: u32::decode(reader)?,
            to_node: decode_affine(reader)?,
            from_model: decode_affine(reader)?,
        })
    }
}

impl Encode for SkinJoint {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.node.encode(writer)?;
        encode_affine(&self.to_node, writer)
    }
}

impl Decode for SkinJoint {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        Ok(Self { node: Option::decode(reader)?, to_node: decode_affine(reader)? })
    }
}

encode_fields!(Channel { node, property, interpolation, timeline, values });
encode_fields!(Clip { name, channels });
encode_fields!(AnimatedSkin { joints });
encode_fields!(AnimatedModel { nodes, parts, skins, places, timelines, clips });

impl AnimatedModel {
    /// The model as a blob.
    ///
    /// # Errors
    /// A model that its decoder would refuse.
    pub fn to_bytes(&self) -> Result<Vec<u8>, AnimationError> {
        self.check()?;
        let mut bytes = vec![VERSION];
        self.encode(&mut bytes)?;
        if bytes.len() > MAX_ANIMATION_BYTES as usize {
            return Err(AnimationError::TooLong(bytes.len()));
        }
        Ok(bytes)
    }

    /// The model of a blob. Memory is bounded by its length.
    ///
    /// # Errors
    /// Bytes that are no model.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, AnimationError> {
        if bytes.len() > MAX_ANIMATION_BYTES as usize {
            return Err(AnimationError::TooLong(bytes.len()));
        }
        let (&version, rest) = bytes.split_first().ok_or(CodingError::EndsEarly)?;
        if version != VERSION {
            return Err(AnimationError::Version(version));
        }
        let most = MEMORY_BYTES + rest.len().saturating_mul(LONG_MEMORY_PER_BYTE);
        let model: Self = encoding::decode(rest, most.min(rest.len().saturating_mul(MEMORY_PER_BYTE)))?;
        model.check()?;
        Ok(model)
    }
}
