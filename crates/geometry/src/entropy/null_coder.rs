//! A coder without output, for traversals of which only the order matters.

use crate::entropy::range_coder::Coder;
use crate::error::DecodeError;

/// Discards all symbols and returns the values it is given.
#[derive(Clone, Copy, Debug, Default)]
pub struct NullCoder;

impl Coder for NullCoder {
    const MODELS: bool = false;

    fn bit(&mut self, _context: usize, value: bool) -> bool {
        value
    }

    fn mix<const N: usize>(&mut self, _contexts: [usize; N], _mixer: usize, value: bool) -> bool {
        value
    }

    fn raw(&mut self, _bits: u32, value: u32) -> u32 {
        value
    }

    fn integer(&mut self, _at: usize, _bits: u32, value: u32) -> Option<u32> {
        Some(value)
    }

    fn check(&self) -> Result<(), DecodeError> {
        Ok(())
    }
}
