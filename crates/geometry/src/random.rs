//! A small seeded random number generator (SplitMix64: Steele, Lea and Flood, "Fast splittable pseudorandom number
//! generators", 2014).

/// A generator of 64-bit numbers, identical on every machine.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// A generator with a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `limit` (0 if the limit is 0); the bias is below limit / 2^64.
    ///
    /// # Panics
    /// In debug builds, for a limit of 2^32 or more: the result would differ on 32-bit machines. Use
    /// [`Self::below_u64`] then.
    pub fn below(&mut self, limit: usize) -> usize {
        debug_assert!(u32::try_from(limit).is_ok(), "a limit of {limit}, which 32-bit machines cannot have");
        self.below_u64(limit as u64) as usize
    }

    /// As [`Self::below`], for limits up to 2^64.
    pub fn below_u64(&mut self, limit: u64) -> u64 {
        ((u128::from(self.next_u64()) * u128::from(limit)) >> 64) as u64
    }

    /// A number in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }
}
