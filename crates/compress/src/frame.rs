//! The header of a zstd frame (RFC 8878 §3.1.1.1), read before a decoder reserves memory for it.

/// First bytes of a frame.
const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// What a decoder reserves memory for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameHeader {
    /// Stated length of the decompressed content.
    pub(crate) content_bytes: Option<u64>,
    /// Length of content that may be referred to.
    pub(crate) window_bytes: u64,
}

impl FrameHeader {
    /// Whether bytes begin with a frame.
    pub(crate) fn is_frame(bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC)
    }

    /// Reads the header; an error says what is wrong.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, &'static str> {
        let rest = bytes.strip_prefix(&MAGIC).ok_or("it is not a zstd frame")?;
        let cut = "its header is cut";
        let (&[descriptor], mut rest) = rest.split_first_chunk().ok_or(cut)?;
        let single_segment = descriptor & 0x20 != 0;
        let mut window_bytes = 0;
        if !single_segment {
            let (&[window], after) = rest.split_first_chunk().ok_or(cut)?;
            rest = after;
            let base = 1_u64 << (10 + u32::from(window >> 3));
            window_bytes = base + base / 8 * u64::from(window & 7);
        }
        let dictionary_length = [0, 1, 2, 4][usize::from(descriptor & 3)];
        rest = rest.get(dictionary_length..).ok_or(cut)?;
        let length = match descriptor >> 6 {
            0 => usize::from(single_segment),
            code => 1 << code,
        };
        let field = rest.get(..length).ok_or(cut)?;
        let number = field.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte));
        // Two bytes count from 256.
        let number = if length == 2 { number + 256 } else { number };
        let content_bytes = (length > 0).then_some(number);
        if single_segment {
            window_bytes = number;
        }
        Ok(Self { content_bytes, window_bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_size_is_read_in_each_width() {
        for size in [0, 1, 255, 256, 300, 65_791, 65_792, 1 << 20] {
            let frame = zstd::bulk::compress(&vec![7; size], 19).unwrap();
            let header = FrameHeader::parse(&frame).unwrap();
            assert_eq!(header.content_bytes, Some(size as u64));
            assert!(header.window_bytes <= size.next_power_of_two().max(1024) as u64, "{size}: {header:?}");
        }
    }

    #[test]
    fn a_cut_header_is_an_error() {
        let frame = zstd::bulk::compress(&vec![7; 300], 19).unwrap();
        for end in 0..7 {
            assert!(FrameHeader::parse(&frame[..end]).is_err(), "{end} bytes");
        }
    }
}
