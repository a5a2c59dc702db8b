//! Coding of prediction residuals whose expected size is known.
//!
//! A residual is coded by its class, two per octave, with two mixed contexts: its expected size with the recent
//! ratios of residuals to their expected sizes, and its expected size with the ratio of the vertex's previous
//! residual. The lowest bits of residuals that are expected to be large are raw, so that the same contexts serve all
//! scales.

use crate::codec::model::{CLASSES, OTHERS, RECENTS, SIZES};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::{integer, unzigzag, zigzag};
use crate::numbers::{class, id32};

/// Context ranges of one kind of residual.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Residual {
    pub(crate) recent: usize,
    pub(crate) other: usize,
    pub(crate) sign: usize,
    pub(crate) rest: usize,
    pub(crate) mixer: usize,
}

/// Recent ratios of residuals to their expected sizes, by step: mean logarithm, in quarter octaves × 16.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Recent([i32; 3]);

/// Class of the previous residual if there is none.
pub(crate) const UNKNOWN: usize = 3;
/// Bound on a ratio, in quarter octaves.
const MOST: i32 = 12;

impl Recent {
    pub(crate) fn class(&self, step: usize) -> usize {
        class(self.0[step] / 32 + 2, RECENTS)
    }

    /// Records a residual; returns its class for [`Residual::code`]'s `other`.
    pub(crate) fn follow(&mut self, step: usize, residual: i32, size: i32) -> usize {
        let ratio = quarter_octaves(f64::from(residual.unsigned_abs()) + 0.25) - size;
        let ratio = ratio.clamp(-MOST, MOST);
        self.0[step] += (ratio * 16 - self.0[step]) / 16;
        class((ratio + MOST + 2) / 4, OTHERS)
    }
}

/// Four times the binary logarithm of a positive number, rounded down: exact at powers of two, linear between. At
/// least -256.
pub(crate) fn quarter_octaves(x: f64) -> i32 {
    if x > 0.0 { ((x.to_bits() >> 50) as i32 - (1023 << 2)).max(-256) } else { -256 }
}

/// Residuals expected to exceed 2 to this, in cells, have raw low bits.
const COARSE: i32 = 3;

impl Residual {
    /// Codes a residual whose expected size is `size` quarter octaves; |value| < 2^30.
    pub(crate) fn code<C: Coder>(
        &self,
        coder: &mut C,
        size: i32,
        recent: usize,
        other: usize,
        value: i32,
    ) -> i32 {
        if let Some(got) = coder.integer(self.recent, 31, zigzag(value)) {
            return unzigzag(got);
        }
        let shift = (size.div_euclid(4) - COARSE + 1).clamp(0, 24).unsigned_abs();
        let bucket = class(size - 4 * shift.cast_signed() + 16, SIZES);
        let low = if shift > 0 {
            coder.raw(shift, (value & ((1 << shift) - 1)).cast_unsigned()).cast_signed()
        } else {
            0
        };
        let high = value >> shift;
        let magnitude = high.unsigned_abs();
        let class = class_of(magnitude);
        let a = self.recent + (bucket * RECENTS + recent) * CLASSES;
        let b = self.other + (bucket / 2 * OTHERS + other) * CLASSES;
        let class = coder.mix_tree([a, b], self.mixer, class) as usize;
        let (start, width) = CLASS_RANGE[class];
        let mut got = if class == LAST_CLASS {
            start.wrapping_add(integer(coder, self.rest, magnitude.wrapping_sub(start) & 0x3fff_ffff))
        } else {
            start + coder.raw(width, magnitude.wrapping_sub(start) & ((1 << width) - 1))
        }
        .cast_signed();
        if got != 0 && coder.bit(self.sign, high < 0) {
            got = got.wrapping_neg();
        }
        got.wrapping_shl(shift) | low
    }
}

/// First magnitude of each class, and the number of bits that distinguish its members.
const CLASS_RANGE: [(u32, u32); CLASSES] = [
    (0, 0),
    (1, 0),
    (2, 0),
    (3, 0),
    (4, 1),
    (6, 1),
    (8, 2),
    (12, 2),
    (16, 3),
    (24, 3),
    (32, 4),
    (48, 4),
    (64, 5),
    (96, 5),
    (128, 6),
    (192, 0),
];
const LAST_CLASS: usize = CLASSES - 1;

fn class_of(magnitude: u32) -> u32 {
    CLASS_RANGE.iter().rposition(|c| c.0 <= magnitude).map_or(0, id32)
}
