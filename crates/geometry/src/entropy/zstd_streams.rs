//! A coder without a model, whose output a general-purpose compressor takes.
//!
//! Integers are written as LEB128 bytes (signed ones zigzagged), decisions and raw bits packed eight per byte.
//! Symbols of a kind form one stream, because a compressor without a model of meshes compresses runs of similar bytes
//! best.
//!
//! ```text
//! length of each stream but the last (LEB128) | streams
//! ```

use crate::entropy::bytes::{Reader, put_varint};
use crate::entropy::range_coder::{Coder, check_rest};
use crate::entropy::steps;
use crate::error::DecodeError;
use crate::numbers::id32;

/// Assigns contexts to streams: each stream holds the contexts from its start to the next stream's. One further
/// stream holds the bits without context.
#[derive(Debug)]
pub struct StreamTable<const BYTES: usize, const BITS: usize> {
    /// First context of each byte stream (integers); ascending from 0.
    pub byte_starts: [usize; BYTES],
    /// First context of each bit stream; ascending from 0.
    pub bit_starts: [usize; BITS],
}

impl<const BYTES: usize, const BITS: usize> StreamTable<BYTES, BITS> {
    fn byte_stream(&self, context: usize) -> usize {
        self.byte_starts.partition_point(|&start| start <= context) - 1
    }

    fn bit_stream(&self, context: usize) -> usize {
        BYTES + self.bit_starts.partition_point(|&start| start <= context) - 1
    }
}

/// Encodes symbols into streams.
#[derive(Debug)]
pub struct ZstdStreamEncoder<const BYTES: usize, const BITS: usize> {
    table: &'static StreamTable<BYTES, BITS>,
    streams: Vec<Writer>,
}

#[derive(Debug, Default)]
struct Writer {
    bytes: Vec<u8>,
    /// Used bits of the last byte.
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

impl<const BYTES: usize, const BITS: usize> ZstdStreamEncoder<BYTES, BITS> {
    /// An empty encoder.
    #[must_use]
    pub fn new(table: &'static StreamTable<BYTES, BITS>) -> Self {
        Self { table, streams: std::iter::repeat_with(Writer::default).take(BYTES + BITS + 1).collect() }
    }

    /// Ends the payload and returns its bytes, padded with zeros to at least `fewest`.
    #[must_use]
    pub fn finish(self, fewest: usize) -> Vec<u8> {
        let mut out = Vec::new();
        for stream in &self.streams[..BYTES + BITS] {
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

impl<const BYTES: usize, const BITS: usize> Coder for ZstdStreamEncoder<BYTES, BITS> {
    const MODELS: bool = false;

    fn bit(&mut self, context: usize, value: bool) -> bool {
        self.streams[self.table.bit_stream(context)].bit(value);
        value
    }

    fn mix<const N: usize>(&mut self, contexts: [usize; N], _mixer: usize, value: bool) -> bool {
        self.bit(contexts[0], value)
    }

    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        for i in (0..bits).rev() {
            self.streams[BYTES + BITS].bit((value >> i) & 1 == 1);
        }
        value
    }

    fn integer(&mut self, at: usize, _bits: u32, value: u32) -> Option<u32> {
        put_varint(&mut self.streams[self.table.byte_stream(at)].bytes, u64::from(value));
        Some(value)
    }

    fn check(&self) -> Result<(), DecodeError> {
        Ok(())
    }
}

/// Decodes symbols. Never panics: past the end of a stream it reads zeros and [`Coder::check`] fails.
#[derive(Debug)]
pub struct ZstdStreamDecoder<'a, const BYTES: usize, const BITS: usize> {
    table: &'static StreamTable<BYTES, BITS>,
    streams: Vec<Unread<'a>>,
    failed: bool,
    bytes: usize,
}

/// The unread rest of a stream.
#[derive(Debug)]
struct Unread<'a> {
    bytes: &'a [u8],
    /// Bits of the first byte already read.
    used: u32,
}

impl<'a, const BYTES: usize, const BITS: usize> ZstdStreamDecoder<'a, BYTES, BITS> {
    /// Starts decoding.
    ///
    /// # Errors
    /// If the streams are longer than the payload.
    pub fn new(table: &'static StreamTable<BYTES, BITS>, bytes: &'a [u8]) -> Result<Self, DecodeError> {
        let mut reader = Reader::new(bytes, "coded data");
        let mut lengths = Vec::with_capacity(BYTES + BITS);
        for _ in 0..BYTES + BITS {
            lengths.push(reader.varint32(id32(bytes.len()))? as usize);
        }
        let mut streams = Vec::with_capacity(BYTES + BITS + 1);
        for length in lengths {
            streams.push(Unread { bytes: reader.take(length)?, used: 0 });
        }
        streams.push(Unread { bytes: reader.take(reader.remaining())?, used: 0 });
        Ok(Self { table, streams, failed: false, bytes: bytes.len() })
    }

    /// Ends decoding.
    ///
    /// # Errors
    /// If a stream is too short, or has unused bytes other than padding to `fewest`.
    pub fn end(&self, fewest: usize) -> Result<(), DecodeError> {
        self.check()?;
        for (i, Unread { bytes, used }) in self.streams.iter().enumerate() {
            let rest = &bytes[usize::from(*used > 0)..];
            check_rest(rest, i == BYTES + BITS && self.bytes <= fewest)?;
        }
        Ok(())
    }

    fn next_bit(&mut self, stream: usize) -> bool {
        steps::take(1);
        let Unread { bytes, used } = &mut self.streams[stream];
        let Some(&byte) = bytes.first() else {
            self.failed = true;
            return false;
        };
        let bit = (byte >> *used) & 1 == 1;
        *used += 1;
        if *used == 8 {
            *used = 0;
            *bytes = &bytes[1..];
        }
        bit
    }
}

impl<const BYTES: usize, const BITS: usize> Coder for ZstdStreamDecoder<'_, BYTES, BITS> {
    const MODELS: bool = false;
    const READS: bool = true;

    fn bit(&mut self, context: usize, _value: bool) -> bool {
        self.next_bit(self.table.bit_stream(context))
    }

    fn mix<const N: usize>(&mut self, contexts: [usize; N], _mixer: usize, value: bool) -> bool {
        self.bit(contexts[0], value)
    }

    fn raw(&mut self, bits: u32, _value: u32) -> u32 {
        (0..bits).fold(0, |value, _| value << 1 | u32::from(self.next_bit(BYTES + BITS)))
    }

    fn integer(&mut self, at: usize, bits: u32, _value: u32) -> Option<u32> {
        steps::take(1);
        let stream = &mut self.streams[self.table.byte_stream(at)].bytes;
        let mut value = 0_u64;
        for shift in (0..35).step_by(7) {
            let Some((&byte, rest)) = stream.split_first() else { break };
            *stream = rest;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80
                && value >> bits == 0
                && let Ok(value) = u32::try_from(value)
            {
                return Some(value);
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
    use proptest::prelude::*;

    const CONTEXTS: usize = 40;
    static TABLE: StreamTable<3, 2> = StreamTable { byte_starts: [0, 7, 20], bit_starts: [0, 11] };

    proptest! {
        #[test]
        fn decodes_what_was_encoded(symbols in prop::collection::vec((any::<bool>(), 0usize..CONTEXTS, 0u32..33, any::<u32>()), 0..400)) {
            let cut = |bits: u32, value: u32| if bits == 32 { value } else { value & ((1 << bits) - 1) };
            let mut encoder = ZstdStreamEncoder::new(&TABLE);
            for &(bit, context, bits, value) in &symbols {
                encoder.bit(context, bit);
                encoder.mix([context, 0], 0, !bit);
                encoder.raw(bits, cut(bits, value));
                encoder.integer(context, bits, cut(bits, value));
            }
            let bytes = encoder.finish(0);
            let mut decoder = ZstdStreamDecoder::new(&TABLE, &bytes).unwrap();
            for &(bit, context, bits, value) in &symbols {
                prop_assert_eq!(decoder.bit(context, false), bit);
                prop_assert_eq!(decoder.mix([context, 0], 0, false), !bit);
                prop_assert_eq!(decoder.raw(bits, 0), cut(bits, value));
                prop_assert_eq!(decoder.integer(context, bits, 0), Some(cut(bits, value)));
            }
            prop_assert!(decoder.end(0).is_ok());
        }

        #[test]
        fn any_bytes_are_decoded_without_panic_and_past_the_end_is_an_error(bytes in prop::collection::vec(any::<u8>(), 0..80), at in 0usize..CONTEXTS) {
            let Ok(mut decoder) = ZstdStreamDecoder::new(&TABLE, &bytes) else { return Ok(()) };
            for _ in 0..=bytes.len() {
                decoder.integer(at, 31, 0);
            }
            prop_assert!(decoder.check().is_err() && decoder.end(0).is_err());
        }
    }

    #[test]
    fn numbers_that_are_too_large_are_refused() {
        let mut encoder = ZstdStreamEncoder::new(&TABLE);
        encoder.integer(0, 31, 1 << 20);
        let bytes = encoder.finish(0);
        let mut decoder = ZstdStreamDecoder::new(&TABLE, &bytes).unwrap();
        assert_eq!(decoder.integer(0, 20, 0), Some(0));
        assert!(decoder.check().is_err());
    }

    #[test]
    fn bytes_that_nothing_needs_are_refused() {
        let mut encoder = ZstdStreamEncoder::new(&TABLE);
        encoder.bit(0, true);
        let mut bytes = encoder.finish(0);
        bytes.push(0);
        let mut decoder = ZstdStreamDecoder::new(&TABLE, &bytes).unwrap();
        assert!(decoder.bit(0, false));
        assert!(decoder.end(0).unwrap_err().to_string().contains("1 bytes too many"));
    }
}
