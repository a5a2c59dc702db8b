//! LEB128 numbers, and a bounds-checked byte reader.

use crate::error::DecodeError;

/// Appends a number in LEB128.
pub fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value.to_le_bytes()[0] | 0x80);
        value >>= 7;
    }
    out.push(value.to_le_bytes()[0]);
}

/// A bounds-checked byte reader. Every method fails without consuming anything if bytes are missing.
pub struct Reader<'a> {
    bytes: &'a [u8],
    what: &'static str,
}

impl<'a> Reader<'a> {
    /// Reads `bytes`; errors name `what`.
    #[must_use]
    pub fn new(bytes: &'a [u8], what: &'static str) -> Self {
        Self { bytes, what }
    }

    /// An error about the data being read.
    pub fn error(&self, why: impl Into<String>) -> DecodeError {
        DecodeError::new(self.what, why)
    }

    /// Number of bytes not yet read.
    #[must_use]
    pub fn remaining(&self) -> usize {
        self.bytes.len()
    }

    /// The next `count` bytes.
    ///
    /// # Errors
    /// If there are fewer.
    pub fn take(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        if count > self.bytes.len() {
            return Err(self.error(format!("ends {} bytes early", count - self.bytes.len())));
        }
        let (head, tail) = self.bytes.split_at(count);
        self.bytes = tail;
        Ok(head)
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// If there are fewer.
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    /// The next byte.
    ///
    /// # Errors
    /// If there is none.
    pub fn u8(&mut self) -> Result<u8, DecodeError> {
        Ok(self.array::<1>()?[0])
    }

    /// A finite f32, little-endian.
    ///
    /// # Errors
    /// If there are fewer, or the number is not finite.
    pub fn f32(&mut self) -> Result<f32, DecodeError> {
        let value = f32::from_le_bytes(self.array()?);
        if value.is_finite() { Ok(value) } else { Err(self.error("a number is not finite")) }
    }

    /// A finite f64, little-endian.
    ///
    /// # Errors
    /// If there are fewer, or the number is not finite.
    pub fn f64(&mut self) -> Result<f64, DecodeError> {
        let value = f64::from_le_bytes(self.array()?);
        if value.is_finite() { Ok(value) } else { Err(self.error("a number is not finite")) }
    }

    /// A LEB128 number of at most `limit`.
    ///
    /// # Errors
    /// If it is larger, or does not end.
    pub fn varint(&mut self, limit: u64) -> Result<u64, DecodeError> {
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

    /// A LEB128 number of 32 bits, at most `limit`.
    ///
    /// # Errors
    /// As [`Self::varint`].
    pub fn varint32(&mut self, limit: u32) -> Result<u32, DecodeError> {
        let value = self.varint(limit.into())?;
        u32::try_from(value).map_err(|_| self.error(format!("{value} exceeds {limit}")))
    }
}
