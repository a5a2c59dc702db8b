//! Allocation limit: how many elements a decoder accepts for a number of bytes.
//!
//! A well-predicted decision costs a thousandth of a bit, so a few kilobytes could encode a million faces. To bound
//! memory, vertices, wedges and faces together may be at most [`max_elements`] of the bytes. Real chunks have 1 to 2
//! elements per byte, a flat grid at eight bits 7 (docs/design/coding.md). An encoder pads better compressed data
//! with zeros ([`min_bytes`]), so a decoder accepts everything an encoder writes.

/// Elements allowed for no bytes at all.
const FREE_ELEMENTS: u64 = 64;
/// Elements allowed per byte.
const ELEMENTS_PER_BYTE: u64 = 16;

/// Most elements that `bytes` bytes may encode.
pub fn max_elements(bytes: usize) -> u64 {
    (bytes as u64).saturating_mul(ELEMENTS_PER_BYTE).saturating_add(FREE_ELEMENTS)
}

/// Fewest bytes that may encode `elements` elements.
pub fn min_bytes(elements: u64) -> usize {
    usize::try_from(elements.saturating_sub(FREE_ELEMENTS).div_ceil(ELEMENTS_PER_BYTE)).unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewest_bytes_justify_and_one_less_does_not() {
        assert_eq!(min_bytes(FREE_ELEMENTS), 0);
        for elements in [FREE_ELEMENTS + 1, 100, 1000, 1 << 20, u64::from(u32::MAX) * 3] {
            let least = min_bytes(elements);
            assert!(max_elements(least) >= elements && max_elements(least - 1) < elements);
        }
    }
}
