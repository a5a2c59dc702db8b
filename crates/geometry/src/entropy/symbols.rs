//! Symbols larger than a bit, for any coder: trees, integers, indices.

use crate::entropy::range_coder::Coder;
use crate::error::DecodeError;
use crate::numbers::id32;

/// Number of contexts of [`tree`].
pub const fn tree_contexts(bits: u32) -> usize {
    1 << bits
}

/// Codes `value < 2^bits`, most significant bit first, down a binary tree of contexts from `at` on.
#[inline]
pub fn tree<C: Coder>(coder: &mut C, at: usize, bits: u32, value: u32) -> u32 {
    if let Some(got) = coder.integer(at, bits, value) {
        return got;
    }
    coder.tree(at, bits, value)
}

/// Bits of the class symbol of [`integer`]: magnitudes of up to 31 bits.
const CLASS_BITS: u32 = 5;
/// Number of contexts of [`integer`].
pub const INTEGER_CONTEXTS: usize = tree_contexts(CLASS_BITS) + 32;

/// Codes `value < 2^31` by Elias-gamma classes: the bit length is adaptive, the bit below the leading one is adaptive
/// per class, the rest is raw.
pub fn integer<C: Coder>(coder: &mut C, at: usize, value: u32) -> u32 {
    if let Some(got) = coder.integer(at, 31, value) {
        return got;
    }
    let class = coder.zero_tree::<CLASS_BITS>(at, 32 - value.leading_zeros());
    match class {
        0 | 1 => class,
        _ => {
            let below = class - 1;
            let second = at + tree_contexts(CLASS_BITS) + class as usize;
            let high = coder.bit(second, (value >> (below - 1)) & 1 == 1);
            let rest = coder.raw(below - 1, value & ((1 << (below - 1)) - 1));
            (1 << below) | (u32::from(high) << (below - 1)) | rest
        }
    }
}

/// Codes a signed integer of at most 30 bits: magnitude by [`integer`], then a raw sign.
pub fn signed<C: Coder>(coder: &mut C, at: usize, value: i32) -> i32 {
    if let Some(got) = coder.integer(at, 31, zigzag(value)) {
        return unzigzag(got);
    }
    let magnitude = integer(coder, at, value.unsigned_abs()).cast_signed();
    if magnitude == 0 {
        return 0;
    }
    if coder.raw(1, u32::from(value < 0)) == 1 { magnitude.wrapping_neg() } else { magnitude }
}

/// Zigzag code of a signed integer: 0, -1, 1, -2, …
pub fn zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)).cast_unsigned()
}

/// The inverse of [`zigzag`].
pub fn unzigzag(code: u32) -> i32 {
    (code >> 1).cast_signed() ^ -(code & 1).cast_signed()
}

/// Bits of an index below `count`: 0 for one.
pub fn bits_for(count: usize) -> u32 {
    usize::BITS - count.saturating_sub(1).leading_zeros()
}

/// Codes an index below `count` in the fewest raw bits.
pub fn index<C: Coder>(coder: &mut C, count: usize, value: usize, what: &str) -> Result<usize, DecodeError> {
    let got = coder.raw(bits_for(count), id32(value)) as usize;
    if got >= count {
        return Err(DecodeError::new(what, format!("index {got} of {count}")));
    }
    Ok(got)
}
