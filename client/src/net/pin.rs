//! Certificate pinning: the fingerprint in an address, trusted instead of certificate authorities.

use std::fmt;
use std::str::FromStr;

/// SHA-256 fingerprint that a server's certificate must have. The certificate's names and dates are not checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pin {
    /// Of the certificate's DER (`sha256=`). A renewed certificate does not match.
    Certificate([u8; 32]),
    /// Of the SubjectPublicKeyInfo's DER (`spki-sha256=`; RFC 7469, section 2.4, in base64). A renewed certificate for
    /// the same key matches.
    Key([u8; 32]),
}

/// Names of the kinds in an address.
const CERTIFICATE: &str = "sha256";
const KEY: &str = "spki-sha256";

/// Why a text is not a fingerprint.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PinError {
    /// Neither `sha256=` nor `spki-sha256=`.
    #[error("{0:?} is not a fingerprint: write sha256=… or spki-sha256=… as the server prints it")]
    Kind(String),
    /// Not 64 digits.
    #[error(
        "the fingerprint after #{0}= has {1} characters instead of 64: copy it whole from the server's output"
    )]
    Length(&'static str, usize),
    /// A character that is not a hexadecimal digit.
    #[error("the fingerprint after #{0}= has a character that is not a hexadecimal digit: {1:?}")]
    Digit(&'static str, char),
}

impl FromStr for Pin {
    type Err = PinError;

    /// Parses the part after `#` in an address: `sha256=HEX` or `spki-sha256=HEX`.
    fn from_str(text: &str) -> Result<Self, PinError> {
        match text.split_once('=') {
            Some((CERTIFICATE, hex)) => digest(CERTIFICATE, hex).map(Self::Certificate),
            Some((KEY, hex)) => digest(KEY, hex).map(Self::Key),
            _ => Err(PinError::Kind(text.into())),
        }
    }
}

impl fmt::Display for Pin {
    /// In the form that [`Pin::from_str`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, digest) = match self {
            Self::Certificate(digest) => (CERTIFICATE, digest),
            Self::Key(digest) => (KEY, digest),
        };
        write!(f, "{kind}=")?;
        digest.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

fn digest(kind: &'static str, hex: &str) -> Result<[u8; 32], PinError> {
    if let Some(other) = hex.chars().find(|c| !c.is_ascii_hexdigit()) {
        return Err(PinError::Digit(kind, other));
    }
    if hex.len() != 64 {
        return Err(PinError::Length(kind, hex.len()));
    }
    let mut bytes = [0; 32];
    for (byte, pair) in bytes.iter_mut().zip(hex.as_bytes().chunks_exact(2)) {
        let digit = |c: u8| char::from(c).to_digit(16).unwrap_or(0);
        *byte = u8::try_from(digit(pair[0]) << 4 | digit(pair[1])).unwrap_or(0);
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pins_are_read_as_they_are_written() {
        for pin in [Pin::Certificate([0xab; 32]), Pin::Key([7; 32])] {
            assert_eq!(pin.to_string().parse(), Ok(pin));
        }
        assert_eq!(Pin::Key([1; 32]).to_string(), format!("spki-sha256={}", "01".repeat(32)));
    }

    #[test]
    fn invalid_fingerprints_are_errors() {
        assert_eq!("sha256=12".parse::<Pin>(), Err(PinError::Length("sha256", 2)));
        let letters = format!("spki-sha256={}", "zz".repeat(32));
        assert_eq!(letters.parse::<Pin>(), Err(PinError::Digit("spki-sha256", 'z')));
        assert_eq!("sha256=ä".parse::<Pin>(), Err(PinError::Digit("sha256", 'ä')));
        for other in ["", "12", "md5=12", "SHA256=12"] {
            assert_eq!(other.parse::<Pin>(), Err(PinError::Kind(other.into())));
        }
    }
}
