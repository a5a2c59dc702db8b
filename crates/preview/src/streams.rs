//! Arrays of numbers as bytes that DEFLATE compresses well.

/// Arrays one after another. Each is a plane of low bytes, then a plane of high bytes, of what [`zigzag`] makes of the
/// difference of each number to the one before.
#[derive(Debug, Default)]
pub(crate) struct Streams {
    bytes: Vec<u8>,
}

impl Streams {
    /// Adds an array; differences are modulo 2^16.
    pub(crate) fn differences(&mut self, numbers: impl Iterator<Item = u16>) {
        let mut before = 0_u16;
        let coded: Vec<u16> = numbers
            .map(|number| {
                let difference = number.wrapping_sub(before).cast_signed();
                before = number;
                zigzag(difference)
            })
            .collect();
        self.bytes.extend(coded.iter().map(|number| number.to_le_bytes()[0]));
        self.bytes.extend(coded.iter().map(|number| number.to_le_bytes()[1]));
    }

    /// All arrays.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// Small magnitudes to small numbers: 0, −1, 1, −2 … to 0, 1, 2, 3 ….
fn zigzag(number: i16) -> u16 {
    ((number << 1) ^ (number >> 15)).cast_unsigned()
}
