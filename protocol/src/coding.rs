//! Encoding of control messages: the only place that knows bincode.
//!
//! bincode encodes what only messages hold. Values of the scene crate ([`SceneValue`]) have an encoding of their own,
//! because they are stored, too. Both have one layout (docs/formats.md). Trailing bytes are an error, and decoding a
//! message claims at most [`MAX_DECODED_BYTES`] of memory.

use bincode::config::{Configuration, Limit, LittleEndian, Varint};
use bincode::de::Decoder;
use bincode::de::read::Reader as _;
use bincode::enc::Encoder;
use bincode::enc::write::Writer as _;
use bincode::error::{DecodeError, EncodeError};
use lodestream_scene::encoding::{self, CodingError};
use lodestream_scene::limits::MAX_DECODED_BYTES;

pub(crate) use bincode::{Decode, Encode};

const MESSAGE: Configuration<LittleEndian, Varint, Limit<MAX_DECODED_BYTES>> =
    bincode::config::standard().with_limit::<MAX_DECODED_BYTES>();

/// Appends the encoding of a control message's body.
pub(crate) fn encode_message<T: Encode>(value: &T, out: &mut Vec<u8>) -> Result<(), CodingError> {
    bincode::encode_into_std_write(value, out, MESSAGE).map_err(|why| match why {
        EncodeError::OtherString(why) => CodingError::Value { why },
        other => CodingError::Value { why: other.to_string() },
    })?;
    Ok(())
}

/// Decodes a control message's body, all of it.
pub(crate) fn decode_message<T: Decode<()>>(bytes: &[u8]) -> Result<T, CodingError> {
    // bincode's messages print whole types; operators need the cause only.
    let (value, used) = bincode::decode_from_slice(bytes, MESSAGE).map_err(|why| match why {
        DecodeError::UnexpectedEnd { .. } => CodingError::EndsEarly,
        DecodeError::LimitExceeded => CodingError::LimitExceeded,
        DecodeError::InvalidIntegerType { .. } => CodingError::IntegerRange,
        DecodeError::Utf8 { .. } => CodingError::Utf8,
        DecodeError::UnexpectedVariant { type_name, .. } => CodingError::UnknownVariant(type_name),
        DecodeError::OtherString(why) => CodingError::Value { why },
        other => CodingError::Value { why: other.to_string() },
    })?;
    // bincode accepts trailing bytes silently.
    if used == bytes.len() { Ok(value) } else { Err(CodingError::TrailingBytes { left: bytes.len() - used }) }
}

/// A value of the scene crate within a message, in that crate's encoding.
pub(crate) struct SceneValue<T>(pub(crate) T);

impl<T: encoding::Encode> Encode for SceneValue<T> {
    fn encode<E: Encoder>(&self, encoder: &mut E) -> Result<(), EncodeError> {
        self.0.encode(&mut MessageWriter(encoder)).map_err(|why| EncodeError::OtherString(why.to_string()))
    }
}

impl<Context, T: encoding::Decode> Decode<Context> for SceneValue<T> {
    fn decode<D: Decoder<Context = Context>>(decoder: &mut D) -> Result<Self, DecodeError> {
        T::decode(&mut MessageReader(decoder)).map(Self).map_err(|why| match why {
            CodingError::EndsEarly => DecodeError::UnexpectedEnd { additional: 1 },
            CodingError::LimitExceeded => DecodeError::LimitExceeded,
            other => DecodeError::OtherString(other.to_string()),
        })
    }
}

/// Writes to the message that an encoder writes.
struct MessageWriter<'a, E>(&'a mut E);

impl<E: Encoder> encoding::Writer for MessageWriter<'_, E> {
    fn write(&mut self, bytes: &[u8]) -> Result<(), CodingError> {
        self.0.writer().write(bytes).map_err(|why| CodingError::Value { why: why.to_string() })
    }
}

/// Reads from the message that a decoder reads, within the decoder's limit.
struct MessageReader<'a, D>(&'a mut D);

impl<D: Decoder> encoding::Reader for MessageReader<'_, D> {
    fn read(&mut self, out: &mut [u8]) -> Result<(), CodingError> {
        self.claim(out.len())?;
        self.0.reader().read(out).map_err(|_| CodingError::EndsEarly)
    }

    fn has(&mut self, count: usize) -> bool {
        self.0.reader().peek_read(count).is_some()
    }

    fn claim(&mut self, bytes: usize) -> Result<(), CodingError> {
        self.0.claim_bytes_read(bytes).map_err(|_| CodingError::LimitExceeded)
    }
}

/// Encodes a message as its fields in the order given; `field: SceneValue` is a value of the scene crate.
macro_rules! message_fields {
    ($type:ident { $($field:ident $(: $wrapper:ident)?),+ $(,)? }) => {
        impl ::bincode::Encode for $type {
            fn encode<E: ::bincode::enc::Encoder>(
                &self,
                encoder: &mut E,
            ) -> Result<(), ::bincode::error::EncodeError> {
                $(::bincode::Encode::encode(&$($wrapper)?(&self.$field), encoder)?;)+
                Ok(())
            }
        }

        impl<Context> ::bincode::Decode<Context> for $type {
            #[expect(unused_parens, reason = "around a field without wrapper")]
            fn decode<D: ::bincode::de::Decoder<Context = Context>>(
                decoder: &mut D,
            ) -> Result<Self, ::bincode::error::DecodeError> {
                $(let $($wrapper)?($field) = ::bincode::Decode::decode(decoder)?;)+
                Ok(Self { $($field),+ })
            }
        }
    };
}

pub(crate) use message_fields;

#[cfg(test)]
mod tests {
    use lodestream_scene::BlobId;
    use proptest::prelude::*;

    use super::*;

    /// The bytes of a value in a message, once by each of the two encodings.
    fn both<T: Encode + encoding::Encode>(value: &T) -> [Vec<u8>; 2] {
        let [mut own, mut scene] = [Vec::new(), Vec::new()];
        encode_message(value, &mut own).unwrap();
        encode_message(&SceneValue(value), &mut scene).unwrap();
        [own, scene]
    }

    proptest! {
        #[test]
        fn both_encodings_have_one_layout(
            numbers in any::<(u8, u16, u32, u64)>(),
            shift in 0..32_u32,
            signed in any::<i32>(),
            floats in any::<[f32; 3]>(),
            long in any::<f64>(),
            bytes in any::<[u8; 16]>(),
            list in prop::collection::vec(any::<u16>(), 0..300),
            text in any::<Option<String>>(),
        ) {
            let (a, b, c, d) = numbers;
            for [own, scene] in [
                both(&(a, b >> (shift / 2), c >> shift, d >> shift)),
                both(&(signed >> shift, floats, long, bytes)),
                both(&(list, text)),
            ] {
                prop_assert_eq!(own, scene);
            }
        }
    }

    #[test]
    fn scene_values_in_messages_are_read_to_their_end_and_no_further() {
        let message = (7_u32, SceneValue(vec![BlobId::base(300), BlobId::texture(1, 2, 3)]), 9_u16);
        let mut bytes = Vec::new();
        encode_message(&message, &mut bytes).unwrap();
        assert_eq!(bytes, [7, 2, 251, 44, 1, 0, 1, 3, 2, 3, 9]);
        let read = decode_message::<(u32, SceneValue<Vec<BlobId>>, u16)>;
        let (first, SceneValue(ids), last) = read(&bytes).unwrap();
        assert_eq!((first, ids, last), (7, message.1.0, 9));
        for end in 0..bytes.len() {
            assert_eq!(read(&bytes[..end]).err(), Some(CodingError::EndsEarly), "{end}");
        }
        bytes.push(0);
        assert_eq!(read(&bytes).err(), Some(CodingError::TrailingBytes { left: 1 }));
    }

    #[test]
    fn errors_of_scene_values_keep_their_cause() {
        let read = |bytes: &[u8]| decode_message::<SceneValue<Vec<BlobId>>>(bytes).err();
        assert_eq!(read(&[252, 255, 255, 255, 255, 0]), Some(CodingError::EndsEarly), "a forged count");
        let unknown = CodingError::UnknownVariant("BlobId").to_string();
        assert_eq!(read(&[1, 0, 13]), Some(CodingError::Value { why: unknown }));
        let long = CodingError::IntegerNotShortest.to_string();
        assert_eq!(read(&[1, 251, 5, 0, 0]), Some(CodingError::Value { why: long }));
        // Each id takes 16 bytes in memory and 2 in the message.
        let many = MAX_DECODED_BYTES / size_of::<BlobId>() + 1;
        let mut bytes = Vec::new();
        encode_message(&SceneValue(vec![BlobId::base(0); many]), &mut bytes).unwrap();
        assert!(bytes.len() < lodestream_scene::limits::MAX_MESSAGE_BYTES);
        assert_eq!(read(&bytes), Some(CodingError::LimitExceeded));
    }
}
