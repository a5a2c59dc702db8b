//! Arrays of numbers as bytes that DEFLATE compresses well.

/// Arrays one after another, each as a plane of low bytes, then a plane of high bytes.
#[derive(Debug, Default)]
pub(crate) struct Streams {
    bytes: Vec<u8>,
}

impl Streams {
    /// Adds an array as [`zigzag`] of the difference of each number to the one before, modulo 2^16.
    pub(crate) fn differences(&mut self, numbers: impl Iterator<Item = u16>) {
        let mut before = 0_u16;
        let coded: Vec<u16> = numbers
            .map(|number| {
                let difference = number.wrapping_sub(before).cast_signed();
                before = number;
                zigzag(difference)
            })
            .collect();
        self.planes(&coded);
    }

    /// Adds corners of faces, each as its distance below the next vertex that no corner has named yet, which is `next`
    /// before and after: vertices are numbered in the order of their first corners (Chun, "WebGL models: end-to-end",
    /// 2012).
    pub(crate) fn corners(&mut self, corners: &[u16], next: &mut u16) {
        let code = |corner: &u16| {
            let distance = next.wrapping_sub(*corner);
            *next = next.wrapping_add(u16::from(distance == 0));
            distance
        };
        let coded: Vec<u16> = corners.iter().map(code).collect();
        self.planes(&coded);
    }

    fn planes(&mut self, coded: &[u16]) {
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
