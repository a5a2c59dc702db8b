//! Coding of part numbers. Pieces of surface begin in the order of their parts, so a number is close to the last.

use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::signed;

/// Codes a part as the difference to the last; `None` if it is not below `parts`.
pub(crate) fn code_part<C: Coder>(coder: &mut C, at: usize, last: u32, part: u32, parts: u32) -> Option<u32> {
    let step = signed(coder, at, part.wrapping_sub(last).cast_signed());
    Some(last.wrapping_add(step.cast_unsigned())).filter(|&part| part < parts)
}
