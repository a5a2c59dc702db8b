//! Encodings of numbers, texts, lists and options, and macros for structs and enums of them.

use super::{CodingError, Reader, SliceReader, Writer};

/// A value with an encoding.
pub trait Encode {
    /// Appends the value's bytes.
    ///
    /// # Errors
    /// A value that its decoder would refuse; the writer's errors.
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError>;
}

/// A value that can be read from its encoding, which takes at least one byte.
pub trait Decode: Sized {
    /// Reads a value.
    ///
    /// # Errors
    /// Bytes that are not the value's encoding, or too few of them.
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError>;
}

/// The bytes of a value.
///
/// # Errors
/// A value that its decoder would refuse.
pub fn encode<T: Encode + ?Sized>(value: &T) -> Result<Vec<u8>, CodingError> {
    let mut bytes = Vec::new();
    value.encode(&mut bytes)?;
    Ok(bytes)
}

/// Reads a value from all of `bytes`. It may take `limit_bytes` of memory on the heap.
///
/// # Errors
/// Bytes that are not the value's encoding, too few or too many of them, or a value beyond the limit.
pub fn decode<T: Decode>(bytes: &[u8], limit_bytes: usize) -> Result<T, CodingError> {
    let mut reader = SliceReader::new(bytes, limit_bytes);
    let value = T::decode(&mut reader)?;
    reader.finish()?;
    Ok(value)
}

/// The greatest integer that takes one byte. Greater ones follow a byte that tells their width.
const MAX_ONE_BYTE: u8 = 250;
const TWO_BYTES: u8 = 251;
const FOUR_BYTES: u8 = 252;
const EIGHT_BYTES: u8 = 253;

fn write_integer<W: Writer>(value: u64, writer: &mut W) -> Result<(), CodingError> {
    let [a, b, c, d, ..] = value.to_le_bytes();
    if value <= u64::from(MAX_ONE_BYTE) {
        writer.write(&[a])
    } else if value <= u64::from(u16::MAX) {
        writer.write(&[TWO_BYTES, a, b])
    } else if value <= u64::from(u32::MAX) {
        writer.write(&[FOUR_BYTES, a, b, c, d])
    } else {
        writer.write(&[EIGHT_BYTES])?;
        writer.write(&value.to_le_bytes())
    }
}

/// Reads an integer. Longer forms than the shortest are refused, so that equal values have equal bytes.
fn read_integer<R: Reader>(reader: &mut R) -> Result<u64, CodingError> {
    let [first] = reader.array()?;
    let (value, least) = match first {
        0..=MAX_ONE_BYTE => return Ok(first.into()),
        TWO_BYTES => (u16::from_le_bytes(reader.array()?).into(), u64::from(MAX_ONE_BYTE) + 1),
        FOUR_BYTES => (u32::from_le_bytes(reader.array()?).into(), u64::from(u16::MAX) + 1),
        EIGHT_BYTES => (u64::from_le_bytes(reader.array()?), u64::from(u32::MAX) + 1),
        _ => return Err(CodingError::IntegerRange),
    };
    if value < least { Err(CodingError::IntegerNotShortest) } else { Ok(value) }
}

macro_rules! unsigned_integers {
    ($($type:ty),+) => {
        $(impl Encode for $type {
            fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
                write_integer((*self).into(), writer)
            }
        }

        impl Decode for $type {
            fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
                Self::try_from(read_integer(reader)?).map_err(|_| CodingError::IntegerRange)
            }
        })+
    };
}

unsigned_integers!(u16, u32, u64);

macro_rules! fixed_width {
    ($($type:ty),+) => {
        $(impl Encode for $type {
            fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
                writer.write(&self.to_le_bytes())
            }
        }

        impl Decode for $type {
            fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
                reader.array().map(Self::from_le_bytes)
            }
        })+
    };
}

fixed_width!(u8, f32, f64);

// Zigzag: 0, −1, 1, −2 … as 0, 1, 2, 3 …
impl Encode for i32 {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        ((self << 1) ^ (self >> 31)).cast_unsigned().encode(writer)
    }
}

impl Decode for i32 {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let code = u32::decode(reader)?;
        Ok((code >> 1).cast_signed() ^ -(code & 1).cast_signed())
    }
}

impl<T: Encode + ?Sized> Encode for &T {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        T::encode(self, writer)
    }
}

macro_rules! tuples {
    ($(($($name:ident),+)),+) => {
        $(impl<$($name: Encode),+> Encode for ($($name,)+) {
            #[expect(non_snake_case, reason = "a field is named as its type")]
            fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
                let ($($name,)+) = self;
                $($name.encode(writer)?;)+
                Ok(())
            }
        })+
    };
}

tuples!((A, B), (A, B, C), (A, B, C, D));

impl<T: Encode, const N: usize> Encode for [T; N] {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.iter().try_for_each(|value| value.encode(writer))
    }
}

impl<T: Decode + Copy + Default, const N: usize> Decode for [T; N] {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let mut values = [T::default(); N];
        for value in &mut values {
            *value = T::decode(reader)?;
        }
        Ok(values)
    }
}

/// Writes a length or count, as a u64.
fn write_length<W: Writer>(length: usize, writer: &mut W) -> Result<(), CodingError> {
    u64::try_from(length).map_err(|_| CodingError::LimitExceeded)?.encode(writer)
}

/// Reads a length or count of what takes at least one byte each.
fn read_length<R: Reader>(reader: &mut R) -> Result<usize, CodingError> {
    let length = usize::try_from(u64::decode(reader)?).map_err(|_| CodingError::EndsEarly)?;
    if reader.has(length) { Ok(length) } else { Err(CodingError::EndsEarly) }
}

impl Encode for str {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        write_length(self.len(), writer)?;
        writer.write(self.as_bytes())
    }
}

impl Encode for String {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.as_str().encode(writer)
    }
}

impl Decode for String {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let length = read_length(reader)?;
        reader.claim(length)?;
        let mut bytes = vec![0; length];
        reader.read(&mut bytes)?;
        Self::from_utf8(bytes).map_err(|_| CodingError::Utf8)
    }
}

impl<T: Encode> Encode for [T] {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        write_length(self.len(), writer)?;
        self.iter().try_for_each(|value| value.encode(writer))
    }
}

impl<T: Encode> Encode for Vec<T> {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        self.as_slice().encode(writer)
    }
}

impl<T: Decode> Decode for Vec<T> {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let count = read_length(reader)?;
        // Grows with the elements that were read: an element may take many times its bytes in memory, so the count alone
        // justifies no reservation.
        let mut values = Self::new();
        for _ in 0..count {
            reader.claim(size_of::<T>())?;
            values.push(T::decode(reader)?);
        }
        Ok(values)
    }
}

impl<T: Encode> Encode for Box<T> {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        T::encode(self, writer)
    }
}

impl<T: Decode> Decode for Box<T> {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        reader.claim(size_of::<T>())?;
        T::decode(reader).map(Self::new)
    }
}

impl<T: Encode> Encode for Option<T> {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        match self {
            None => writer.write(&[0]),
            Some(value) => {
                writer.write(&[1])?;
                value.encode(writer)
            }
        }
    }
}

impl<T: Decode> Decode for Option<T> {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        match reader.array()? {
            [0] => Ok(None),
            [1] => T::decode(reader).map(Some),
            _ => Err(CodingError::UnknownVariant("Option")),
        }
    }
}

/// Encodes a struct as its fields, in the order given.
macro_rules! encode_fields {
    ($type:ident { $($field:ident),+ $(,)? }) => {
        impl $crate::encoding::Encode for $type {
            fn encode<W: $crate::encoding::Writer>(
                &self,
                writer: &mut W,
            ) -> Result<(), $crate::encoding::CodingError> {
                $($crate::encoding::Encode::encode(&self.$field, writer)?;)+
                Ok(())
            }
        }

        impl $crate::encoding::Decode for $type {
            fn decode<R: $crate::encoding::Reader>(
                reader: &mut R,
            ) -> Result<Self, $crate::encoding::CodingError> {
                Ok(Self { $($field: $crate::encoding::Decode::decode(reader)?),+ })
            }
        }
    };
}

/// Encodes an enum without fields as a u32.
macro_rules! encode_variants {
    ($type:ident { $($number:literal => $variant:ident),+ $(,)? }) => {
        impl $crate::encoding::Encode for $type {
            fn encode<W: $crate::encoding::Writer>(
                &self,
                writer: &mut W,
            ) -> Result<(), $crate::encoding::CodingError> {
                let number: u32 = match self {
                    $(Self::$variant => $number),+
                };
                $crate::encoding::Encode::encode(&number, writer)
            }
        }

        impl $crate::encoding::Decode for $type {
            fn decode<R: $crate::encoding::Reader>(
                reader: &mut R,
            ) -> Result<Self, $crate::encoding::CodingError> {
                match <u32 as $crate::encoding::Decode>::decode(reader)? {
                    $($number => Ok(Self::$variant),)+
                    _ => Err($crate::encoding::CodingError::UnknownVariant(stringify!($type))),
                }
            }
        }
    };
}

pub(crate) use {encode_fields, encode_variants};
