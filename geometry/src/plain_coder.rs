//! A coder without a model, for payloads that a general-purpose compressor takes over.
//!
//! Symbols are written as they are: integers as LEB128 bytes (signed ones zigzagged), decisions and raw
//! bits packed eight to a byte. Those of a kind lie together, because a compressor that knows nothing of
//! meshes finds in runs of like bytes what an adaptive model would have learnt.
//!
//! ```text
//! length of each stream but the last (LEB128) | streams
//! ```

use crate::codec::model::{BIT_STREAMS, BYTE_STREAMS, bit_stream, byte_stream};
use crate::error::DecodeError;
use crate::range_coder::{Coder, nothing_left};
use crate::steps;
use crate::symbols::{Reader, put_varint};

/// Streams of bytes, of bits by kind, and of the bits that no context is known of.
const STREAMS: usize = BYTE_STREAMS + BIT_STREAMS + 1;
const RAW: usize = STREAMS - 1;

/// Writes symbols.
#[derive(Debug, Default)]
pub(crate) struct PlainEncoder {
    streams: [Writer; STREAMS],
}

#[derive(Debug, Default)]
struct Writer {
    bytes: Vec<u8>,
    /// Bits of the last byte that are taken.
    used: u32,
}

impl Writer {
    fn bit(&mut self, value: bool) {
        if self.used.is_multiple_of(8) {
            self.bytes.push(0);
            self.used = 0;
        }
        if let Some(last) = self.bytes.last_mut() {
            *last |= u8::from(value) << self.used;
        }
        self.used += 1;
    }
}

impl PlainEncoder {
    /// Ends the payload and returns its bytes, padded with zeros if they are fewer than `fewest`.
    #[must_use]
    pub(crate) fn finish(self, fewest: usize) -> Vec<u8> {
        let mut out = Vec::new();
        for stream in &self.streams[..RAW] {
            put_varint(&mut out, stream.bytes.len() as u64);
        }
        for stream in self.streams {
            out.extend(stream.bytes);
        }
        if out.len() < fewest {
            out.resize(fewest, 0);
        }
        out
    }
}

impl Coder for PlainEncoder {
    const MODELS: bool = false;

    fn bit(&mut self, context: usize, value: bool) -> bool {
        self.streams[BYTE_STREAMS + bit_stream(context)].bit(value);
        value
    }

    fn mix<const N: usize>(&mut self, contexts: [usize; N], _mixer: usize, value: bool) -> bool {
        self.bit(contexts[0], value)
    }

    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        for i in (0..bits).rev() {
            self.streams[RAW].bit((value >> i) & 1 == 1);
        }
        value
    }

    fn whole(&mut self, at: usize, _bits: u32, value: u32) -> Option<u32> {
        put_varint(&mut self.streams[byte_stream(at)].bytes, u64::from(value));
        Some(value)
    }

    fn check(&self) -> Result<(), DecodeError> {
        Ok(())
    }
}

/// Reads symbols. Never panics; past the end of a stream it reads zeros and [`Coder::check`] fails.
#[derive(Debug)]
pub(crate) struct PlainDecoder<'a> {
    streams: [&'a [u8]; STREAMS],
    /// Bits of each stream's first byte that were read.
    used: [u32; STREAMS],
    failed: bool,
    bytes: usize,
}

impl<'a> PlainDecoder<'a> {
    /// Starts decoding.
    ///
    /// # Errors
    /// If the streams are longer than the payload.
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let mut reader = Reader::new(bytes, "coded data");
        let mut lengths = [0; STREAMS];
        for length in &mut lengths[..RAW] {
            *length = reader.varint(bytes.len() as u64)? as usize;
        }
        let mut streams = [&bytes[..0]; STREAMS];
        for (stream, length) in streams.iter_mut().zip(lengths) {
            *stream = reader.take(length)?;
        }
        streams[RAW] = reader.take(reader.remaining())?;
        Ok(Self { streams, used: [0; STREAMS], failed: false, bytes: bytes.len() })
    }

    /// Ends decoding.
    ///
    /// # Errors
    /// If a stream was too short, or has bytes that nothing needed, other than padding to `fewest`.
    pub(crate) fn end(&self, fewest: usize) -> Result<(), DecodeError> {
        self.check()?;
        for (i, (stream, used)) in self.streams.iter().zip(self.used).enumerate() {
            let rest = &stream[usize::from(used > 0)..];
            nothing_left(rest, i == RAW && self.bytes <= fewest)?;
        }
        Ok(())
    }

    fn next_bit(&mut self, stream: usize) -> bool {
        steps::take(1);
        let Some(&byte) = self.streams[stream].first() else {
            self.failed = true;
            return false;
        };
        let bit = (byte >> self.used[stream]) & 1 == 1;
        self.used[stream] += 1;
        if self.used[stream] == 8 {
            self.used[stream] = 0;
            self.streams[stream] = &self.streams[stream][1..];
        }
        bit
    }
}

impl Coder for PlainDecoder<'_> {
    const MODELS: bool = false;

    fn bit(&mut self, context: usize, _value: bool) -> bool {
        self.next_bit(BYTE_STREAMS + bit_stream(context))
    }

    fn mix<const N: usize>(&mut self, contexts: [usize; N], _mixer: usize, value: bool) -> bool {
        self.bit(contexts[0], value)
    }

    fn raw(&mut self, bits: u32, _value: u32) -> u32 {
        (0..bits).fold(0, |value, _| value << 1 | u32::from(self.next_bit(RAW)))
    }

    fn whole(&mut self, at: usize, bits: u32, _value: u32) -> Option<u32> {
        steps::take(1);
        let stream = &mut self.streams[byte_stream(at)];
        let mut value = 0_u64;
        for shift in (0..35).step_by(7) {
            let Some((&byte, rest)) = stream.split_first() else { break };
            *stream = rest;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 && value >> bits == 0 {
                return Some(value as u32);
            }
            if byte < 0x80 {
                break;
            }
        }
        self.failed = true;
        Some(0)
    }

    fn check(&self) -> Result<(), DecodeError> {
        if self.failed {
            return Err(DecodeError::new("coded data", "ends too early, or a number is out of range"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::model::CONTEXTS;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decodes_what_was_encoded(symbols in prop::collection::vec((any::<bool>(), 0usize..CONTEXTS, 0u32..33, any::<u32>()), 0..400)) {
            let cut = |bits: u32, value: u32| if bits == 32 { value } else { value & ((1 << bits) - 1) };
            let mut encoder = PlainEncoder::default();
            for &(bit, context, bits, value) in &symbols {
                encoder.bit(context, bit);
                encoder.mix([context, 0], 0, !bit);
                encoder.raw(bits, cut(bits, value));
                encoder.whole(context, bits, cut(bits, value));
            }
            let bytes = encoder.finish(0);
            let mut decoder = PlainDecoder::new(&bytes).unwrap();
            for &(bit, context, bits, value) in &symbols {
                prop_assert_eq!(decoder.bit(context, false), bit);
                prop_assert_eq!(decoder.mix([context, 0], 0, false), !bit);
                prop_assert_eq!(decoder.raw(bits, 0), cut(bits, value));
                prop_assert_eq!(decoder.whole(context, bits, 0), Some(cut(bits, value)));
            }
            prop_assert!(decoder.end(0).is_ok());
        }

        #[test]
        fn any_bytes_are_decoded_without_panic_and_past_the_end_is_an_error(bytes in prop::collection::vec(any::<u8>(), 0..80), at in 0usize..CONTEXTS) {
            let Ok(mut decoder) = PlainDecoder::new(&bytes) else { return Ok(()) };
            for _ in 0..=bytes.len() {
                decoder.whole(at, 31, 0);
            }
            prop_assert!(decoder.check().is_err() && decoder.end(0).is_err());
        }
    }

    #[test]
    fn numbers_that_are_too_large_are_refused() {
        let mut encoder = PlainEncoder::default();
        encoder.whole(0, 31, 1 << 20);
        let bytes = encoder.finish(0);
        let mut decoder = PlainDecoder::new(&bytes).unwrap();
        assert_eq!(decoder.whole(0, 20, 0), Some(0));
        assert!(decoder.check().is_err());
    }

    #[test]
    fn bytes_that_nothing_needs_are_refused() {
        let mut encoder = PlainEncoder::default();
        encoder.bit(0, true);
        let mut bytes = encoder.finish(0);
        bytes.push(0);
        let mut decoder = PlainDecoder::new(&bytes).unwrap();
        assert!(decoder.bit(0, false));
        assert!(decoder.end(0).unwrap_err().to_string().contains("1 bytes too many"));
    }
}
