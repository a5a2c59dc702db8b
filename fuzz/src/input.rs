//! Reads numbers from the front of a fuzzer's input; past its end they are 0.

/// The remaining bytes of an input.
#[derive(Clone, Debug)]
pub struct Input<'a> {
    bytes: &'a [u8],
}

impl<'a> Input<'a> {
    /// Starts at the first byte.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    /// Whether no byte remains.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// The next byte.
    pub fn u8(&mut self) -> u8 {
        let Some((&first, rest)) = self.bytes.split_first() else { return 0 };
        self.bytes = rest;
        first
    }

    /// The next two bytes, little-endian.
    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes([self.u8(), self.u8()])
    }

    /// One of `count` choices (0 for none), by the next two bytes.
    pub fn choice(&mut self, count: usize) -> usize {
        usize::from(self.u16()) % count.max(1)
    }

    /// All remaining bytes.
    #[must_use]
    pub fn rest(self) -> &'a [u8] {
        self.bytes
    }
}
