//! An adaptive binary range coder.
//!
//! The interval arithmetic and carry handling are those of LZMA's range coder (Pavlov; after Martin,
//! "Range encoding", 1979). Probabilities are 16-bit and adapt fast at first, as 1/(n + 1.5), because
//! a chunk has only a few hundred symbols per context. Encoder and decoder implement one trait,
//! [`Coder`], so that a model is written once and cannot disagree with itself.

use crate::error::DecodeError;

/// Observations after which adaptation stops getting slower.
const MAX_COUNT: u8 = 60;
/// Probabilities stay this far (of 65536) from 0 and 1, so no symbol costs nothing or everything.
const MARGIN: i32 = 96;
/// Range below which bytes are shifted out.
const TOP: u32 = 1 << 24;

/// An adaptive estimate of the probability that a bit is set.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prob {
    p: u16,
    seen: u8,
}

impl Default for Prob {
    fn default() -> Self {
        Self { p: 1 << 15, seen: 0 }
    }
}

impl Prob {
    fn update(&mut self, bit: bool) {
        let target = if bit { 65535 } else { 0 };
        let step = (target - i32::from(self.p)) * 2 / (2 * i32::from(self.seen) + 3);
        self.p = (i32::from(self.p) + step).clamp(MARGIN, 65536 - MARGIN) as u16;
        self.seen = (self.seen + 1).min(MAX_COUNT);
    }
}

/// Writes or reads symbols: a model calls it with the value it would write, and goes on with the
/// value it gets back. An encoder returns what it was given; a decoder ignores it.
pub(crate) trait Coder {
    /// Codes one bit with an adaptive probability.
    fn bit(&mut self, prob: &mut Prob, value: bool) -> bool;
    /// Codes `bits` (0 to 32) equiprobable bits.
    fn raw(&mut self, bits: u32, value: u32) -> u32;
    /// An error once more bytes were consumed than there are.
    ///
    /// # Errors
    /// When the input is exhausted.
    fn check(&self) -> Result<(), DecodeError>;
}

/// Encodes symbols into bytes.
#[derive(Debug)]
pub(crate) struct Encoder {
    low: u64,
    range: u32,
    cache: u8,
    pending: u64,
    out: Vec<u8>,
}

impl Default for Encoder {
    fn default() -> Self {
        Self { low: 0, range: u32::MAX, cache: 0, pending: 1, out: Vec::new() }
    }
}

impl Encoder {
    /// Ends the stream and returns its bytes.
    #[must_use]
    pub(crate) fn finish(mut self) -> Vec<u8> {
        for _ in 0..5 {
            self.shift_low();
        }
        // The first byte is always 0 (the initial cache); trailing zeros are what a decoder reads past
        // the end anyway.
        let end = self.out.iter().rposition(|&b| b != 0).map_or(1, |p| p + 1).max(1);
        self.out.truncate(end);
        self.out.remove(0);
        self.out
    }

    fn shift_low(&mut self) {
        if self.low < 0xff00_0000 || self.low > 0xffff_ffff {
            let carry = (self.low >> 32) as u8;
            let mut byte = self.cache;
            while self.pending > 0 {
                self.out.push(byte.wrapping_add(carry));
                byte = 0xff;
                self.pending -= 1;
            }
            self.cache = (self.low >> 24) as u8;
        }
        self.pending += 1;
        self.low = (self.low & 0x00ff_ffff) << 8;
    }
}

impl Coder for Encoder {
    fn bit(&mut self, prob: &mut Prob, value: bool) -> bool {
        let bound = (self.range >> 16) * u32::from(prob.p);
        if value {
            self.range = bound;
        } else {
            self.low += u64::from(bound);
            self.range -= bound;
        }
        prob.update(value);
        while self.range < TOP {
            self.range <<= 8;
            self.shift_low();
        }
        value
    }

    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        for i in (0..bits).rev() {
            self.range >>= 1;
            if (value >> i) & 1 == 1 {
                self.low += u64::from(self.range);
            }
            while self.range < TOP {
                self.range <<= 8;
                self.shift_low();
            }
        }
        value
    }

    fn check(&self) -> Result<(), DecodeError> {
        Ok(())
    }
}

/// Decodes symbols from bytes. Never panics; past the end it reads zeros and [`Coder::check`] fails.
#[derive(Debug)]
pub(crate) struct Decoder<'a> {
    bytes: &'a [u8],
    next: usize,
    range: u32,
    code: u32,
}

/// Zero bytes that a decoder may read past the end: those that [`Encoder::finish`] cut off.
const TAIL: usize = 5;

impl<'a> Decoder<'a> {
    /// Starts decoding.
    #[must_use]
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { bytes, next: 0, range: u32::MAX, code: 0 };
        for _ in 0..4 {
            decoder.code = (decoder.code << 8) | u32::from(decoder.byte());
        }
        decoder
    }

    fn byte(&mut self) -> u8 {
        let byte = self.bytes.get(self.next).copied().unwrap_or(0);
        self.next += 1;
        byte
    }

    fn normalise(&mut self) {
        while self.range < TOP {
            self.range <<= 8;
            self.code = (self.code << 8) | u32::from(self.byte());
        }
    }
}

impl Coder for Decoder<'_> {
    fn bit(&mut self, prob: &mut Prob, _value: bool) -> bool {
        let bound = (self.range >> 16) * u32::from(prob.p);
        let value = self.code < bound;
        if value {
            self.range = bound;
        } else {
            self.code -= bound;
            self.range -= bound;
        }
        prob.update(value);
        self.normalise();
        value
    }

    fn raw(&mut self, bits: u32, _value: u32) -> u32 {
        let mut value = 0;
        for _ in 0..bits {
            self.range >>= 1;
            let set = self.code >= self.range;
            if set {
                self.code -= self.range;
            }
            value = (value << 1) | u32::from(set);
            self.normalise();
        }
        value
    }

    fn check(&self) -> Result<(), DecodeError> {
        if self.next > self.bytes.len() + TAIL {
            return Err(DecodeError::new("coded data", "ends too early"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decodes_what_was_encoded(symbols in prop::collection::vec((any::<bool>(), 0u32..4, 0u32..33, any::<u32>()), 0..400)) {
            let mut probs = [Prob::default(); 4];
            let mut encoder = Encoder::default();
            for &(bit, ctx, bits, raw) in &symbols {
                encoder.bit(&mut probs[ctx as usize], bit);
                encoder.raw(bits, if bits == 32 { raw } else { raw & ((1 << bits) - 1) });
            }
            let bytes = encoder.finish();
            let mut probs = [Prob::default(); 4];
            let mut decoder = Decoder::new(&bytes);
            for &(bit, ctx, bits, raw) in &symbols {
                prop_assert_eq!(decoder.bit(&mut probs[ctx as usize], false), bit);
                prop_assert_eq!(decoder.raw(bits, 0), if bits == 32 { raw } else { raw & ((1 << bits) - 1) });
            }
            prop_assert!(decoder.check().is_ok());
        }
    }

    #[test]
    fn skewed_bits_cost_little() {
        let mut prob = Prob::default();
        let mut encoder = Encoder::default();
        for i in 0..10_000 {
            encoder.bit(&mut prob, i % 100 == 0);
        }
        // Entropy of 1 % is 0.081 bits: 101 bytes; adaptation costs some.
        let bytes = encoder.finish().len();
        assert!(bytes < 125, "{bytes} bytes");
    }

    #[test]
    fn exhausted_input_is_an_error() {
        let mut decoder = Decoder::new(&[1, 2, 3]);
        for _ in 0..20 {
            decoder.raw(8, 0);
        }
        assert!(decoder.check().is_err());
    }
}
