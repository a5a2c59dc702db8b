//! How many elements bytes can justify.
//!
//! A decision that a model foresees costs a thousandth of a bit, so a few kilobytes could stand for a
//! million faces. No decoder believes that: vertices, wedges and faces together may be at most
//! [`max_elements`] of the bytes. Real chunks have 1 to 2 elements a byte, a flat grid at eight bits 7
//! (docs/design/coding.md, "Ceilings"); what codes better than the ceiling is padded with zeros by its encoder
//! ([`min_bytes`]), so no decoder refuses what an encoder made.

/// Elements that no byte need justify.
const FREE: u64 = 64;
/// Elements for each byte.
const PER_BYTE: u64 = 16;

/// Most elements of so many bytes.
pub fn max_elements(bytes: usize) -> u64 {
    (bytes as u64).saturating_mul(PER_BYTE).saturating_add(FREE)
}

/// Fewest bytes for so many elements.
pub fn min_bytes(elements: u64) -> usize {
    usize::try_from(elements.saturating_sub(FREE).div_ceil(PER_BYTE)).unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewest_bytes_justify_and_one_less_does_not() {
        assert_eq!(min_bytes(FREE), 0);
        for elements in [FREE + 1, 100, 1000, 1 << 20, u64::from(u32::MAX) * 3] {
            let least = min_bytes(elements);
            assert!(max_elements(least) >= elements && max_elements(least - 1) < elements);
        }
    }
}
