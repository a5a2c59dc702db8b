//! Symbols larger than a bit, on top of the range coder: trees, unsigned and signed integers; and
//! plain bytes.

use crate::error::DecodeError;
use crate::range_coder::Coder;

/// Contexts that [`tree`] uses.
pub(crate) const fn tree_contexts(bits: u32) -> usize {
    1 << bits
}

/// Codes `value < 2^bits`, most significant bit first down a binary tree of contexts from `at` on.
#[inline]
pub(crate) fn tree<C: Coder>(coder: &mut C, at: usize, bits: u32, value: u32) -> u32 {
    if let Some(got) = coder.whole(at, bits, value) {
        return got;
    }
    let mut node = 1_usize;
    for i in (0..bits).rev() {
        let bit = coder.bit(at + node, (value >> i) & 1 == 1);
        node = node * 2 + usize::from(bit);
    }
    node as u32 - (1 << bits)
}

/// Bits of the class symbol of [`integer`]: magnitudes of up to 31 bits.
const CLASS_BITS: u32 = 5;
/// Contexts that [`integer`] uses.
pub(crate) const INTEGER_CONTEXTS: usize = tree_contexts(CLASS_BITS) + 32;

/// Codes `value < 2^31` by Elias-gamma classes: the bit length adapts, the top bit below the leading
/// one adapts per class, the rest is raw.
pub(crate) fn integer<C: Coder>(coder: &mut C, at: usize, value: u32) -> u32 {
    if let Some(got) = coder.whole(at, 31, value) {
        return got;
    }
    let class = tree(coder, at, CLASS_BITS, 32 - value.leading_zeros());
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

/// Codes a signed integer of at most 30 bits: magnitude as [`integer`], then a raw sign.
pub(crate) fn signed<C: Coder>(coder: &mut C, at: usize, value: i32) -> i32 {
    if let Some(got) = coder.whole(at, 31, zigzag(value)) {
        return unzigzag(got);
    }
    let magnitude = integer(coder, at, value.unsigned_abs()) as i32;
    if magnitude == 0 {
        return 0;
    }
    if coder.raw(1, u32::from(value < 0)) == 1 { magnitude.wrapping_neg() } else { magnitude }
}

/// Signed integers as unsigned ones, small ones first: 0, -1, 1, -2, …
pub(crate) fn zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

/// The inverse of [`zigzag`].
pub(crate) fn unzigzag(code: u32) -> i32 {
    (code >> 1) as i32 ^ -((code & 1) as i32)
}

/// Bits needed to name one of `count` things: 0 for one.
pub(crate) fn bits_for(count: usize) -> u32 {
    usize::BITS - count.saturating_sub(1).leading_zeros()
}

/// Codes an index below `count` in as few raw bits as a power of two allows.
pub(crate) fn index<C: Coder>(
    coder: &mut C,
    count: usize,
    value: usize,
    what: &str,
) -> Result<usize, DecodeError> {
    let got = coder.raw(bits_for(count), value as u32) as usize;
    if got >= count {
        return Err(DecodeError::new(what, format!("index {got} of {count}")));
    }
    Ok(got)
}

/// Bytes of a number in LEB128.
pub(crate) fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Reads bytes with bounds checks.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
    what: &'static str,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8], what: &'static str) -> Self {
        Self { bytes, what }
    }

    pub(crate) fn error(&self, why: impl Into<String>) -> DecodeError {
        DecodeError::new(self.what, why)
    }

    pub(crate) fn remaining(&self) -> usize {
        self.bytes.len()
    }

    pub(crate) fn take(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        if count > self.bytes.len() {
            return Err(self.error(format!("ends {} bytes early", count - self.bytes.len())));
        }
        let (head, tail) = self.bytes.split_at(count);
        self.bytes = tail;
        Ok(head)
    }

    pub(crate) fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    pub(crate) fn u8(&mut self) -> Result<u8, DecodeError> {
        Ok(self.array::<1>()?[0])
    }

    pub(crate) fn f32(&mut self) -> Result<f32, DecodeError> {
        let value = f32::from_le_bytes(self.array()?);
        if value.is_finite() { Ok(value) } else { Err(self.error("a number is not finite")) }
    }

    pub(crate) fn f64(&mut self) -> Result<f64, DecodeError> {
        let value = f64::from_le_bytes(self.array()?);
        if value.is_finite() { Ok(value) } else { Err(self.error("a number is not finite")) }
    }

    /// A LEB128 number of at most `limit`.
    pub(crate) fn varint(&mut self, limit: u64) -> Result<u64, DecodeError> {
        let mut value = 0_u64;
        for shift in (0..63).step_by(7) {
            let byte = self.u8()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                if value > limit {
                    return Err(self.error(format!("{value} exceeds {limit}")));
                }
                return Ok(value);
            }
        }
        Err(self.error("a number is too long"))
    }
}
