//! Fingerprints of certificates, as addresses name them.

use std::str::FromStr;

/// SHA-256 of a certificate's DER.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin(pub [u8; 32]);

/// Text that is no fingerprint.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PinError {
    /// Another length than 64.
    #[error(
        "the fingerprint after #sha256= has {0} characters instead of 64: copy it whole from the server's output"
    )]
    Length(usize),
    /// Something that is no hexadecimal digit.
    #[error("the fingerprint after #sha256= has a character that is no hexadecimal digit: {0:?}")]
    Digit(char),
}

impl FromStr for Pin {
    type Err = PinError;

    fn from_str(hex: &str) -> Result<Self, PinError> {
        if let Some(other) = hex.chars().find(|c| !c.is_ascii_hexdigit()) {
            return Err(PinError::Digit(other));
        }
        if hex.len() != 64 {
            return Err(PinError::Length(hex.len()));
        }
        let mut bytes = [0; 32];
        for (byte, pair) in bytes.iter_mut().zip(hex.as_bytes().chunks_exact(2)) {
            let digit = |c: u8| char::from(c).to_digit(16).unwrap_or(0);
            *byte = u8::try_from(digit(pair[0]) << 4 | digit(pair[1])).unwrap_or(0);
        }
        Ok(Self(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_pins_are_named() {
        assert_eq!("12".parse::<Pin>(), Err(PinError::Length(2)));
        assert_eq!("zz".repeat(32).parse::<Pin>(), Err(PinError::Digit('z')));
        assert_eq!("ä".parse::<Pin>(), Err(PinError::Digit('ä')));
    }
}
