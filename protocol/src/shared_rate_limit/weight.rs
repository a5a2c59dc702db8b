//! The weight of a session.

use std::num::NonZeroU8;

/// Weight of a session in the allocation: 1 to 100, by default 1. A session of weight 5 has five times the rate of
/// one of weight 1 if both could use more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Weight(NonZeroU8);

impl Weight {
    /// The least weight, and the default.
    pub const ONE: Self = Self(NonZeroU8::MIN);
    /// The greatest weight.
    pub const MAX: u8 = 100;

    /// A weight; `None` for 0 and above 100.
    #[must_use]
    pub fn new(weight: u64) -> Option<Self> {
        let weight = u8::try_from(weight).ok().filter(|weight| *weight <= Self::MAX)?;
        NonZeroU8::new(weight).map(Self)
    }

    /// The number.
    #[must_use]
    pub fn get(self) -> u32 {
        u32::from(self.0.get())
    }
}

impl Default for Weight {
    fn default() -> Self {
        Self::ONE
    }
}
