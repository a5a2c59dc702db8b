//! How many elements bytes can justify.
//!
//! A decision that a model foresees costs a thousandth of a bit, so a few kilobytes could stand for a
//! million faces. No decoder believes that: vertices, wedges and faces together may be at most
//! [`most_elements`] of the bytes. Real chunks have 1 to 2 elements a byte, a flat grid at eight bits 7
//! (docs/design/coding.md, "Ceilings"); what codes better than the ceiling is padded with zeros by its encoder
//! ([`least_bytes`]), so no decoder refuses what an encoder made.

/// Elements that no byte need justify.
const FREE: u64 = 64;
/// Elements for each byte.
const PER_BYTE: u64 = 16;

/// Most elements of so many bytes.
pub fn most_elements(bytes: usize) -> u64 {
    (bytes as u64).saturating_mul(PER_BYTE).saturating_add(FREE)
}

/// Fewest bytes for so many elements.
pub fn least_bytes(elements: u64) -> usize {
    usize::try_from(elements.saturating_sub(FREE).div_ceil(PER_BYTE)).unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewest_bytes_justify_and_one_less_does_not() {
        assert_eq!(least_bytes(FREE), 0);
        for elements in [FREE + 1, 100, 1000, 1 << 20, u64::from(u32::MAX) * 3] {
            let least = least_bytes(elements);
            assert!(most_elements(least) >= elements && most_elements(least - 1) < elements);
        }
    }
}
