//! A 64-bit hash of heights, for comparing results between machines.

/// FNV-1a (Fowler, Noll, Vo) over the heights as little-endian 32-bit integers, in order.
#[must_use]
pub fn fingerprint(heights: &[i32]) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for height in heights {
        for byte in height.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_answers() {
        assert_eq!(fingerprint(&[]), 0xcbf2_9ce4_8422_2325);
        // FNV-1a of "foob", from the test vectors of its authors.
        assert_eq!(fingerprint(&[i32::from_le_bytes(*b"foob")]), 0xdd12_0e79_0c25_12af);
    }
}
