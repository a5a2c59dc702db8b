//! Bytes from front to back.

use super::damage::Damage;

/// What is left of some bytes.
pub(super) struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(super) fn new(rest: &'a [u8]) -> Self {
        Self { rest }
    }

    pub(super) fn left(&self) -> usize {
        self.rest.len()
    }

    /// The next bytes, which stay.
    pub(super) fn ahead<const N: usize>(&self) -> Result<&'a [u8; N], Damage> {
        self.rest.first_chunk().ok_or(Damage::Short)
    }

    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], Damage> {
        let (taken, rest) = self.rest.split_at_checked(length).ok_or(Damage::Short)?;
        self.rest = rest;
        Ok(taken)
    }

    pub(super) fn byte(&mut self) -> Result<u8, Damage> {
        Ok(self.take(1)?[0])
    }

    /// A number in groups of seven bits, lowest first; at most five, of which bits above the 32nd are lost.
    pub(super) fn number(&mut self) -> Result<u32, Damage> {
        let mut number = 0;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.byte()?;
            number |= u32::from(byte & 127) << shift;
            if byte < 128 {
                break;
            }
        }
        Ok(number)
    }
}
