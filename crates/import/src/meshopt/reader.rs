//! Sequential reader of bytes.

use super::error::MeshoptError;

/// The bytes that are not read yet.
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

    /// The next bytes, without consuming them.
    pub(super) fn ahead<const N: usize>(&self) -> Result<&'a [u8; N], MeshoptError> {
        self.rest.first_chunk().ok_or(MeshoptError::Truncated)
    }

    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], MeshoptError> {
        let (taken, rest) = self.rest.split_at_checked(length).ok_or(MeshoptError::Truncated)?;
        self.rest = rest;
        Ok(taken)
    }

    pub(super) fn byte(&mut self) -> Result<u8, MeshoptError> {
        Ok(self.take(1)?[0])
    }

    /// A LEB128 number of at most five bytes; drops bits above the 32nd.
    pub(super) fn number(&mut self) -> Result<u32, MeshoptError> {
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
