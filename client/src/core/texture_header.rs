//! Width and height in the header of a PNG, JPEG or WebP file.

/// `VP8X`: the file has several pictures.
const ANIMATED: u8 = 0x02;

/// Width and height that a file states; `None` if it is no single picture of these formats.
pub(super) fn header_size(file: &[u8]) -> Option<[u32; 2]> {
    png(file).or_else(|| jpeg(file)).or_else(|| webp(file))
}

/// Whether a file begins as a WebP file does.
pub(super) fn is_webp(file: &[u8]) -> bool {
    file.starts_with(b"RIFF")
}

/// ISO/IEC 15948, 11.2.2.
fn png(file: &[u8]) -> Option<[u32; 2]> {
    let header = file.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(4..16)?.strip_prefix(b"IHDR")?;
    let side = |at: usize| Some(u32::from_be_bytes(header.get(at..at + 4)?.try_into().ok()?));
    Some([side(0)?, side(4)?])
}

/// The frame's header (ITU-T T.81, B.2.2).
fn jpeg(file: &[u8]) -> Option<[u32; 2]> {
    let mut rest = file.strip_prefix(&[0xff, 0xd8])?;
    // Segments: 0xff, possibly repeated, a marker, a length that counts itself, data.
    while let [0xff, marker, after @ ..] = rest {
        if *marker == 0xff {
            rest = &rest[1..];
            continue;
        }
        let length = usize::from(u16::from_be_bytes(after.get(..2)?.try_into().ok()?));
        let segment = after.get(2..length)?;
        // Frames of all processes; 0xc4, 0xc8 and 0xcc are tables.
        if (0xc0..=0xcf).contains(marker) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
            let side =
                |at: usize| Some(u32::from(u16::from_be_bytes(segment.get(at..at + 2)?.try_into().ok()?)));
            return Some([side(3)?, side(1)?]);
        }
        rest = after.get(length..)?;
    }
    None
}

/// A chunk of a WebP file: its name, its contents as far as they are there, and what follows.
struct Chunk<'a> {
    name: [u8; 4],
    contents: &'a [u8],
    rest: &'a [u8],
}

impl<'a> Chunk<'a> {
    fn first(bytes: &'a [u8]) -> Option<Self> {
        let (name, bytes) = bytes.split_first_chunk::<4>()?;
        let (length, bytes) = bytes.split_first_chunk::<4>()?;
        let length = u32::from_le_bytes(*length) as usize;
        let contents = bytes.get(..length).unwrap_or(bytes);
        // Padded to an even length.
        let rest = bytes.get(length.saturating_add(length % 2)..).unwrap_or_default();
        Some(Self { name: *name, contents, rest })
    }

    /// Size of the picture, if the chunk is one: of a key frame (RFC 6386, 9.1), or lossless (RFC 9649, 3.4).
    fn picture(&self) -> Option<[u32; 2]> {
        if self.name == *b"VP8L" {
            let bits = self.contents.strip_prefix(&[0x2f])?.first_chunk::<4>()?;
            let bits = u32::from_le_bytes(*bits);
            return (bits >> 29 == 0).then_some([(bits & 0x3fff) + 1, (bits >> 14 & 0x3fff) + 1]);
        }
        let (tag, frame) = self.contents.split_first_chunk::<3>()?;
        if self.name != *b"VP8 " || tag[0] & 1 != 0 {
            return None;
        }
        let &[w0, w1, h0, h1] = frame.strip_prefix(&[0x9d, 0x01, 0x2a])?.first_chunk()?;
        // Above 14 bits is a scale, which decoders ignore.
        Some([[w0, w1], [h0, h1]].map(|side| u32::from(u16::from_le_bytes(side) & 0x3fff)))
    }
}

/// RFC 9649, 2.5 to 2.7. A picture in an extended file must have the size of its canvas: decoders reserve memory by the
/// one and may check the other afterwards.
fn webp(file: &[u8]) -> Option<[u32; 2]> {
    let chunks = file.strip_prefix(b"RIFF")?.get(4..)?.strip_prefix(b"WEBP")?;
    let mut chunk = Chunk::first(chunks)?;
    if chunk.name != *b"VP8X" {
        return chunk.picture();
    }
    let &[flags, _, _, _, w0, w1, w2, h0, h1, h2] = chunk.contents.first_chunk()?;
    if flags & ANIMATED != 0 {
        return None;
    }
    let canvas = [[w0, w1, w2, 0], [h0, h1, h2, 0]].map(|side| u32::from_le_bytes(side) + 1);
    while !matches!(&chunk.name, b"VP8 " | b"VP8L") {
        chunk = Chunk::first(chunk.rest)?;
    }
    (chunk.picture()? == canvas).then_some(canvas)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(name: &[u8; 4], contents: &[u8]) -> Vec<u8> {
        let length = (contents.len() as u32).to_le_bytes();
        [&name[..], &length, contents, &[0][..contents.len() % 2]].concat()
    }

    fn riff(chunks: &[Vec<u8>]) -> Vec<u8> {
        let chunks = chunks.concat();
        [b"RIFF", &(chunks.len() as u32 + 4).to_le_bytes()[..], b"WEBP", &chunks].concat()
    }

    fn lossy(width: u16, height: u16) -> Vec<u8> {
        let size = [width.to_le_bytes(), height.to_le_bytes()].concat();
        chunk(b"VP8 ", &[&[0, 0, 0, 0x9d, 0x01, 0x2a], &size[..], &[7; 9]].concat())
    }

    fn lossless(width: u32, height: u32, version: u32) -> Vec<u8> {
        let bits = (width - 1) | (height - 1) << 14 | version << 29;
        chunk(b"VP8L", &[&[0x2f], &bits.to_le_bytes()[..], &[7; 9]].concat())
    }

    fn canvas(flags: u8, width: u8, height: u8) -> Vec<u8> {
        chunk(b"VP8X", &[flags, 0, 0, 0, width - 1, 0, 0, height - 1, 0, 0])
    }

    #[test]
    fn webp_headers_of_every_kind_state_the_size() {
        let alpha = chunk(b"ALPH", &[1, 2, 3]);
        for file in [
            riff(&[lossy(200, 100)]),
            riff(&[lossy(200 | 1 << 14, 100 | 3 << 14)]),
            riff(&[lossless(200, 100, 0)]),
            riff(&[canvas(0x10, 200, 100), alpha.clone(), lossy(200, 100)]),
            riff(&[canvas(0x10, 200, 100), lossless(200, 100, 0)]),
        ] {
            assert_eq!(header_size(&file), Some([200, 100]));
            // Every cut gives nothing until the header is there.
            let shortest = (0..file.len()).find(|&length| header_size(&file[..length]).is_some()).unwrap();
            assert!((25..=file.len() - 9).contains(&shortest), "{shortest}");
            assert!((shortest..file.len()).all(|length| header_size(&file[..length]) == Some([200, 100])));
        }
    }

    #[test]
    fn forged_webp_headers_are_refused() {
        let mut between = lossy(200, 100);
        between[8] = 1;
        for (file, what) in [
            (riff(&[canvas(0, 20, 10), lossy(200, 100)]), "a picture larger than its canvas"),
            (riff(&[canvas(0, 200, 100), lossless(20, 10, 0)]), "a picture smaller than its canvas"),
            (riff(&[canvas(ANIMATED, 200, 100), lossy(200, 100)]), "several pictures"),
            (riff(&[canvas(0, 200, 100)]), "no picture"),
            (riff(&[lossless(200, 100, 1)]), "an unknown version"),
            (riff(&[between]), "no key frame"),
            (riff(&[chunk(b"VP9 ", &[0; 20])]), "an unknown code"),
            (riff(&[]), "nothing"),
        ] {
            assert_eq!(header_size(&file), None, "{what}");
        }
        let mut long = riff(&[canvas(0, 200, 100), lossy(200, 100)]);
        long[16..20].copy_from_slice(&[0xff; 4]);
        assert_eq!(header_size(&long), None, "a chunk beyond the end");
    }
}
