//! Encodings of text files.

use std::borrow::Cow;

/// A text as UTF-8 without its byte-order mark. Text in UTF-16 must have one.
pub(crate) fn utf8(bytes: &[u8]) -> Cow<'_, [u8]> {
    let units = |of: fn([u8; 2]) -> u16| {
        let units = bytes[2..].as_chunks().0.iter().map(|&pair| of(pair));
        let chars = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER));
        Cow::Owned(chars.collect::<String>().into_bytes())
    };
    match bytes {
        [0xff, 0xfe, ..] => units(u16::from_le_bytes),
        [0xfe, 0xff, ..] => units(u16::from_be_bytes),
        [0xef, 0xbb, 0xbf, rest @ ..] => Cow::Borrowed(rest),
        _ => Cow::Borrowed(bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_the_same_in_every_encoding() {
        let text = "v 1 2 3 # Grün 𝄞\n";
        let units: Vec<u16> = "\u{feff}".encode_utf16().chain(text.encode_utf16()).collect();
        let little: Vec<u8> = units.iter().flat_map(|unit| unit.to_le_bytes()).collect();
        let big: Vec<u8> = units.iter().flat_map(|unit| unit.to_be_bytes()).collect();
        for bytes in [&little, &big, &[b"\xef\xbb\xbf", text.as_bytes()].concat(), &text.into()] {
            assert_eq!(utf8(bytes), text.as_bytes());
        }
        assert_eq!(utf8(&[&little[..], b"x"].concat()), text.as_bytes(), "half a unit at the end");
        assert_eq!(utf8(b"\xff\xfe"), &b""[..]);
    }
}
