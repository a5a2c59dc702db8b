//! An adaptive binary range coder.
//!
//! Interval arithmetic and carry handling are those of LZMA's range coder (Pavlov; after Martin, "Range encoding",
//! 1979). Probabilities adapt fast at first, because a chunk has only a few hundred symbols per context, and may
//! start from trained values. A decision may use several contexts: their estimates are mixed in the logistic domain
//! with adaptive weights (Mahoney, "Adaptive weighing of context models for lossless data compression", 2005).
//! Encoder and decoder implement one trait, [`Coder`], so a model is written once.

use crate::entropy::context::{Contexts, Mixed};
use crate::entropy::steps;
use crate::error::DecodeError;
use crate::numbers::id32;

/// Range below which bytes are shifted out.
const TOP: u32 = 1 << 24;

/// Bits per symbol of [`Coder::mix_tree`].
pub const MIX_TREE_BITS: u32 = 4;
/// Contexts of the tree of [`Coder::mix_tree`].
const TREE: usize = 1 << MIX_TREE_BITS;

/// Encodes or decodes symbols: a model passes the value to encode and continues with the value returned. An encoder
/// returns its argument; a decoder ignores it.
pub trait Coder: Sized {
    /// Whether contexts matter; if not, callers need not compute them.
    const MODELS: bool = true;
    /// Whether this is a decoder, which ignores the values passed; if so, callers need not compute them.
    const READS: bool = false;
    /// Codes one bit with the adaptive probability `context`.
    fn bit(&mut self, context: usize, value: bool) -> bool;
    /// Codes one bit with several contexts, mixed by the weights of `mixer`.
    fn mix<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, value: bool) -> bool;
    /// Codes `value < 2^bits`, most significant bit first, down a binary tree with one context per node, starting at
    /// `at`.
    #[inline]
    fn tree(&mut self, at: usize, bits: u32, value: u32) -> u32 {
        let mut node = 1_u32;
        for i in (0..bits).rev() {
            let bit = self.bit(at + node as usize, (value >> i) & 1 == 1);
            node = node * 2 + u32::from(bit);
        }
        node - (1 << bits)
    }
    /// [`Coder::tree`], optimised for values that are mostly 0.
    #[inline]
    fn zero_tree<const BITS: u32>(&mut self, at: usize, value: u32) -> u32 {
        self.tree(at, BITS, value)
    }
    /// Codes `value` < 2^[`MIX_TREE_BITS`], most significant bit first, down a binary tree with two contexts per
    /// node, starting at each of `at`, mixed with the weights of `mixer`.
    #[inline]
    fn mix_tree(&mut self, at: [usize; 2], mixer: usize, value: u32) -> u32 {
        mix_bits(self, at, mixer, value)
    }
    /// Codes `bits` (0 to 32) equiprobable bits.
    fn raw(&mut self, bits: u32, value: u32) -> u32;
    /// Codes `value < 2^bits` (0 to 32) as one unit, with the contexts from `at` on. `None` (the default) if the
    /// coder supports bits only.
    fn integer(&mut self, at: usize, bits: u32, value: u32) -> Option<u32> {
        let _ = (at, bits, value);
        None
    }
    /// Fails if more bytes were consumed than there are.
    ///
    /// # Errors
    /// If the input is exhausted.
    fn check(&self) -> Result<(), DecodeError>;
    /// Bytes that suffice to decode everything coded so far; 0 for a decoder.
    fn bytes(&self) -> usize {
        0
    }
}

/// [`Coder::mix_tree`] bit by bit.
fn mix_bits<C: Coder>(coder: &mut C, at: [usize; 2], mixer: usize, value: u32) -> u32 {
    let mut node = 1_u32;
    for i in (0..MIX_TREE_BITS).rev() {
        let bit = coder.mix(at.map(|at| at + node as usize), mixer, (value >> i) & 1 == 1);
        node = node * 2 + u32::from(bit);
    }
    node - (1 << MIX_TREE_BITS)
}

/// Encodes symbols into bytes.
#[derive(Debug)]
pub struct Encoder {
    contexts: Contexts,
    low: u64,
    range: u32,
    cache: u8,
    pending: usize,
    out: Vec<u8>,
}

/// Bytes that interval and cache still hold after a symbol.
const HELD_BYTES: usize = 5;

impl Encoder {
    /// An empty encoder that starts from `contexts`.
    #[must_use]
    pub fn new(contexts: Contexts) -> Self {
        Self { contexts, low: 0, range: u32::MAX, cache: 0, pending: 1, out: Vec::new() }
    }

    /// Ends the stream and returns its bytes, padded with zeros to at least `fewest`.
    #[must_use]
    pub fn finish(mut self, fewest: usize) -> Vec<u8> {
        let least = self.out.len().max(1);
        for _ in 0..HELD_BYTES {
            self.shift_low();
        }
        // The first byte is always 0 (the initial cache). A decoder reads zeros past the end, so trailing zeros are
        // dropped, up to the number it accepts.
        let end = self.out.iter().rposition(|&b| b != 0).map_or(1, |p| p + 1).max(least);
        self.out.truncate(end);
        self.out.remove(0);
        if self.out.len() < fewest {
            self.out.resize(fewest, 0);
        }
        self.out
    }

    fn shift_low(&mut self) {
        if self.low < 0xff00_0000 || self.low > 0xffff_ffff {
            let carry = u8::from(self.low > 0xffff_ffff);
            let mut byte = self.cache;
            while self.pending > 0 {
                self.out.push(byte.wrapping_add(carry));
                byte = 0xff;
                self.pending -= 1;
            }
            self.cache = self.low.to_le_bytes()[3];
        }
        self.pending += 1;
        self.low = (self.low & 0x00ff_ffff) << 8;
    }

    fn put(&mut self, p: u16, value: bool) {
        let bound = (self.range >> 16) * u32::from(p);
        if value {
            self.range = bound;
        } else {
            self.low += u64::from(bound);
            self.range -= bound;
        }
        while self.range < TOP {
            self.range <<= 8;
            self.shift_low();
        }
    }
}

impl Coder for Encoder {
    fn bit(&mut self, context: usize, value: bool) -> bool {
        self.put(self.contexts.probs[context].p, value);
        self.contexts.probs[context].update(value);
        value
    }

    fn mix<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, value: bool) -> bool {
        let mixed = self.contexts.mixed(contexts, mixer);
        self.put(mixed.p, value);
        self.contexts.learn(contexts, mixer, &mixed, value);
        value
    }

    fn raw(&mut self, bits: u32, value: u32) -> u32 {
        let mut left = bits;
        while left > 0 {
            let count = left.min(16);
            left -= count;
            self.range >>= count;
            self.low += u64::from((value >> left) & ((1 << count) - 1)) * u64::from(self.range);
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

    fn bytes(&self) -> usize {
        self.out.len() + self.pending + HELD_BYTES - 2
    }
}

/// Decodes symbols from bytes. Never panics: past the end it reads zeros and [`Coder::check`] fails.
#[derive(Debug)]
pub struct Decoder<'a> {
    contexts: Contexts,
    stream: Stream<'a>,
}

/// Interval and input. Functions that decode several bits work on a copy, which stays in registers.
#[derive(Clone, Copy, Debug)]
struct Stream<'a> {
    bytes: &'a [u8],
    next: usize,
    range: u32,
    code: u32,
}

impl<'a> Decoder<'a> {
    /// Starts decoding.
    #[must_use]
    pub fn new(contexts: Contexts, bytes: &'a [u8]) -> Self {
        let mut stream = Stream { bytes, next: 0, range: u32::MAX, code: 0 };
        for _ in 0..4 {
            stream.code = (stream.code << 8) | u32::from(stream.byte());
        }
        Self { contexts, stream }
    }

    /// Ends decoding.
    ///
    /// # Errors
    /// If the stream is too short, or has unused bytes other than padding to `fewest`.
    pub fn end(&self, fewest: usize) -> Result<(), DecodeError> {
        self.check()?;
        let Stream { bytes, next, .. } = self.stream;
        check_rest(bytes.get(next..).unwrap_or_default(), bytes.len() <= fewest)
    }

    /// The adapted contexts.
    #[must_use]
    pub fn into_contexts(self) -> Contexts {
        self.contexts
    }
}

impl Stream<'_> {
    #[inline]
    fn byte(&mut self) -> u8 {
        let byte = self.bytes.get(self.next).copied().unwrap_or(0);
        self.next += 1;
        byte
    }

    #[inline(always)]
    fn normalise(&mut self) {
        while self.range < TOP {
            self.range <<= 8;
            self.code = (self.code << 8) | u32::from(self.byte());
        }
    }

    /// Reads a bit that is set with probability `p`, without a branch, for unpredictable bits. [`Self::normalise`]
    /// must follow.
    #[inline(always)]
    fn get(&mut self, p: u16) -> bool {
        steps::take(1);
        let bound = (self.range >> 16) * u32::from(p);
        let bit = self.code < bound;
        self.code -= if bit { 0 } else { bound };
        self.range = if bit { bound } else { self.range - bound };
        bit
    }

    /// Reads a bit that is set with probability `p` and passes it to `learns`. Branches on the bit, so the processor
    /// may predict it, and `learns` is compiled for a constant bit.
    #[inline(always)]
    fn bit(&mut self, p: u16, learns: impl FnOnce(bool)) -> bool {
        steps::take(1);
        let bound = (self.range >> 16) * u32::from(p);
        let bit = self.code < bound;
        if bit {
            self.range = bound;
            learns(true);
        } else {
            self.code -= bound;
            self.range -= bound;
            learns(false);
        }
        self.normalise();
        bit
    }
}

/// Fails if bytes are left, other than zeros if those are allowed.
pub fn check_rest(rest: &[u8], zeros: bool) -> Result<(), DecodeError> {
    if rest.is_empty() || (zeros && rest.iter().all(|&b| b == 0)) {
        return Ok(());
    }
    Err(DecodeError::new("coded data", format!("{} bytes too many", rest.len())))
}

impl Coder for Decoder<'_> {
    const READS: bool = true;

    #[inline]
    fn bit(&mut self, context: usize, _value: bool) -> bool {
        let prob = &mut self.contexts.probs[context];
        self.stream.bit(prob.p, |bit| prob.update(bit))
    }

    #[inline(always)]
    fn mix<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, _value: bool) -> bool {
        let mixed = self.contexts.mixed(contexts, mixer);
        let bit = self.stream.get(mixed.p);
        self.contexts.learn(contexts, mixer, &mixed, bit);
        self.stream.normalise();
        bit
    }

    fn tree(&mut self, at: usize, bits: u32, _value: u32) -> u32 {
        let mut stream = self.stream;
        let probs = &mut self.contexts.probs[at..][..1 << bits];
        let mut node = 1;
        for _ in 0..bits {
            let prob = &mut probs[node];
            node = node * 2 + usize::from(stream.bit(prob.p, |bit| prob.update(bit)));
        }
        self.stream = stream;
        id32(node - (1 << bits))
    }

    #[inline]
    fn zero_tree<const BITS: u32>(&mut self, at: usize, value: u32) -> u32 {
        let probs = &mut self.contexts.probs[at..][..1 << BITS];
        let Stream { mut range, code, .. } = self.stream;
        // Each 0 bit removes the interval of a 1 from the bottom. As long as no byte is shifted in, all bits are 0 if
        // the code lies above the sum of those.
        let mut taken = 0;
        for i in 0..BITS {
            let bound = (range >> 16) * u32::from(probs[1 << i].p);
            taken += bound;
            range -= bound;
        }
        if code < taken || range < TOP {
            return self.tree(at, BITS, value);
        }
        steps::take(BITS.into());
        (0..BITS).for_each(|i| probs[1 << i].update(false));
        (self.stream.range, self.stream.code) = (range, code - taken);
        0
    }

    fn mix_tree(&mut self, at: [usize; 2], mixer: usize, value: u32) -> u32 {
        let Some(([low, high], kept)) = self.contexts.trees::<TREE>(at, mixer) else {
            return mix_bits(self, at, mixer, value);
        };
        let (mut stream, mut weights) = (self.stream, *kept);
        let mut node = 1;
        for _ in 0..MIX_TREE_BITS {
            let (a, b) = (&mut low[node % TREE], &mut high[node % TREE]);
            let mixed = Mixed::of([*a, *b], &weights);
            let bit = stream.bit(mixed.p, |bit| {
                a.update(bit);
                b.update(bit);
                mixed.update_weights(&mut weights, bit);
            });
            node = node * 2 + usize::from(bit);
        }
        *kept = weights;
        self.stream = stream;
        id32(node % TREE)
    }

    fn raw(&mut self, bits: u32, _value: u32) -> u32 {
        steps::take(1);
        if bits == 0 {
            return 0;
        }
        let mut stream = self.stream;
        let mut value = 0_u32;
        let mut left = bits;
        while left > 0 {
            let count = left.min(16);
            left -= count;
            stream.range >>= count;
            let part = (stream.code / stream.range).min((1 << count) - 1);
            stream.code -= part * stream.range;
            value = (value << count) | part;
            stream.normalise();
        }
        self.stream = stream;
        value
    }

    fn check(&self) -> Result<(), DecodeError> {
        if self.stream.next > self.stream.bytes.len() + HELD_BYTES {
            return Err(DecodeError::new("coded data", "ends too early"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entropy::context::{MAX_INPUTS, Prob};
    use proptest::prelude::*;

    fn contexts() -> Contexts {
        Contexts { probs: vec![Prob::default(); 4], weights: vec![[30_000; MAX_INPUTS]] }
    }

    proptest! {
        #[test]
        fn decodes_what_was_encoded(symbols in prop::collection::vec((any::<bool>(), 0usize..4, 0u32..33, any::<u32>()), 0..400)) {
            let mut encoder = Encoder::new(contexts());
            for &(bit, ctx, bits, raw) in &symbols {
                encoder.bit(ctx, bit);
                encoder.mix([ctx, (ctx + 1) % 4, 0], 0, bit);
                encoder.raw(bits, if bits == 32 { raw } else { raw & ((1 << bits) - 1) });
                encoder.tree(0, 2, raw & 3);
                // Mostly 0, so that whole trees of zeros are read at once.
                encoder.tree(0, 2, if bit { 0 } else { raw >> 30 });
            }
            let bytes = encoder.finish(0);
            let mut decoder = Decoder::new(contexts(), &bytes);
            for &(bit, ctx, bits, raw) in &symbols {
                prop_assert_eq!(decoder.bit(ctx, false), bit);
                prop_assert_eq!(decoder.mix([ctx, (ctx + 1) % 4, 0], 0, false), bit);
                prop_assert_eq!(decoder.raw(bits, 0), if bits == 32 { raw } else { raw & ((1 << bits) - 1) });
                prop_assert_eq!(decoder.tree(0, 2, 0), raw & 3);
                prop_assert_eq!(decoder.zero_tree::<2>(0, 0), if bit { 0 } else { raw >> 30 });
            }
            prop_assert!(decoder.check().is_ok());
        }

        #[test]
        fn a_prefix_decodes_up_to_its_mark(bits in prop::collection::vec((any::<bool>(), 0usize..4), 1..600), at in 0usize..600) {
            let at = at.min(bits.len());
            let mut encoder = Encoder::new(contexts());
            let mut mark = 0;
            for (i, &(bit, ctx)) in bits.iter().enumerate() {
                if i == at {
                    mark = encoder.bytes();
                }
                encoder.bit(ctx, bit);
            }
            if at == bits.len() {
                mark = encoder.bytes();
            }
            let bytes = encoder.finish(0);
            let mut decoder = Decoder::new(contexts(), &bytes[..mark.min(bytes.len())]);
            for &(bit, ctx) in &bits[..at] {
                prop_assert_eq!(decoder.bit(ctx, false), bit);
            }
        }
    }

    #[test]
    fn skewed_bits_cost_little() {
        let mut encoder = Encoder::new(contexts());
        for i in 0..10_000 {
            encoder.bit(0, i % 100 == 0);
        }
        // Entropy of 1 % is 0.081 bits: 101 bytes; adaptation costs some.
        let bytes = encoder.finish(0).len();
        assert!(bytes < 125, "{bytes} bytes");
    }

    #[test]
    fn exhausted_input_is_an_error() {
        let mut decoder = Decoder::new(contexts(), &[1, 2, 3]);
        for _ in 0..20 {
            decoder.raw(8, 0);
        }
        assert!(decoder.check().is_err());
    }

    #[test]
    fn padding_is_accepted_where_it_is_due_and_nowhere_else() {
        let mut encoder = Encoder::new(contexts());
        encoder.raw(32, 0x1234_5678);
        let bytes = encoder.finish(20);
        assert_eq!(bytes.len(), 20);
        let end = |bytes: &[u8], fewest: usize| {
            let mut decoder = Decoder::new(contexts(), bytes);
            assert_eq!(decoder.raw(32, 0), 0x1234_5678);
            decoder.end(fewest)
        };
        assert!(end(&bytes, 20).is_ok());
        assert!(end(&bytes, 19).is_err(), "more padding than is due");
        let dirty = [&bytes[..19], &[1]].concat();
        assert!(end(&dirty, 20).is_err(), "padding is zeros");
    }
}
