//! Where encoded bytes go.

use super::CodingError;

/// Takes the bytes of encoded values.
pub trait Writer {
    /// Appends bytes.
    ///
    /// # Errors
    /// If the writer cannot take them.
    fn write(&mut self, bytes: &[u8]) -> Result<(), CodingError>;
}

impl Writer for Vec<u8> {
    fn write(&mut self, bytes: &[u8]) -> Result<(), CodingError> {
        self.extend_from_slice(bytes);
        Ok(())
    }
}
