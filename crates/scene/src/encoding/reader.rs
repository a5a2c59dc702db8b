//! Where encoded bytes come from.

use super::CodingError;

/// Gives the bytes of encoded values, and limits the memory that they take.
pub trait Reader {
    /// Fills `out` with the next bytes.
    ///
    /// # Errors
    /// If fewer are left.
    fn read(&mut self, out: &mut [u8]) -> Result<(), CodingError>;

    /// Whether at least `count` bytes are left.
    fn has(&mut self, count: usize) -> bool;

    /// Counts memory that a value is about to take on the heap.
    ///
    /// # Errors
    /// If all values together take more than the reader allows.
    fn claim(&mut self, bytes: usize) -> Result<(), CodingError>;

    /// The next `N` bytes.
    ///
    /// # Errors
    /// If fewer are left.
    fn array<const N: usize>(&mut self) -> Result<[u8; N], CodingError> {
        let mut bytes = [0; N];
        self.read(&mut bytes)?;
        Ok(bytes)
    }
}

/// A reader of bytes in memory.
#[derive(Debug)]
pub struct SliceReader<'a> {
    rest: &'a [u8],
    free_bytes: usize,
}

impl<'a> SliceReader<'a> {
    /// A reader whose values may take `limit_bytes` of memory.
    #[must_use]
    pub const fn new(bytes: &'a [u8], limit_bytes: usize) -> Self {
        Self { rest: bytes, free_bytes: limit_bytes }
    }

    /// Checks that all bytes were read.
    ///
    /// # Errors
    /// If bytes are left over.
    pub const fn finish(&self) -> Result<(), CodingError> {
        match self.rest.len() {
            0 => Ok(()),
            left => Err(CodingError::TrailingBytes { left }),
        }
    }
}

impl Reader for SliceReader<'_> {
    fn read(&mut self, out: &mut [u8]) -> Result<(), CodingError> {
        let (bytes, rest) = self.rest.split_at_checked(out.len()).ok_or(CodingError::EndsEarly)?;
        out.copy_from_slice(bytes);
        self.rest = rest;
        Ok(())
    }

    fn has(&mut self, count: usize) -> bool {
        count <= self.rest.len()
    }

    fn claim(&mut self, bytes: usize) -> Result<(), CodingError> {
        self.free_bytes = self.free_bytes.checked_sub(bytes).ok_or(CodingError::LimitExceeded)?;
        Ok(())
    }
}
