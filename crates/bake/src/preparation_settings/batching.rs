//! Whether small meshes of a file are gathered into batches.

use std::fmt;
use std::str::FromStr;

use lodestream_import::setting::InvalidValue;

use super::setting::BatchFaces;

/// How the meshes of a glTF file become assets. As text `auto`, `off` or a number of faces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Batching {
    /// Many small meshes become batches of the default size.
    #[default]
    Auto,
    /// Each mesh is an asset.
    Off,
    /// As [`Self::Auto`], with at most this many faces in a batch.
    Faces(BatchFaces),
}

impl Batching {
    /// Most faces of a batch; `None` without batches.
    #[must_use]
    pub fn faces(self) -> Option<usize> {
        match self {
            Self::Auto => Some(BatchFaces::default().get()),
            Self::Off => None,
            Self::Faces(faces) => Some(faces.get()),
        }
    }

    fn refusal(given: impl Into<String>) -> InvalidValue {
        let (low, high) = (BatchFaces::RANGE.start(), BatchFaces::RANGE.end());
        InvalidValue::new(format!("auto, off or {low} to {high} faces of a batch are possible"), given)
    }
}

impl TryFrom<usize> for Batching {
    type Error = InvalidValue;

    fn try_from(faces: usize) -> Result<Self, InvalidValue> {
        BatchFaces::try_from(faces).map(Self::Faces).map_err(|_| Self::refusal(faces.to_string()))
    }
}

impl FromStr for Batching {
    type Err = InvalidValue;

    fn from_str(text: &str) -> Result<Self, InvalidValue> {
        match text {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            _ => text.parse().map(Self::Faces).map_err(|_: InvalidValue| Self::refusal(format!("{text:?}"))),
        }
    }
}

impl fmt::Display for Batching {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Off => f.write_str("off"),
            Self::Faces(faces) => faces.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batching_is_a_word_or_a_number_of_faces() {
        assert_eq!("auto".parse::<Batching>().unwrap().faces(), Some(393_216));
        assert_eq!("off".parse::<Batching>().unwrap().faces(), None);
        assert_eq!("20000".parse(), Batching::try_from(20_000));
        for text in ["auto", "off", "1000", "10000000"] {
            assert_eq!(text.parse::<Batching>().unwrap().to_string(), text);
        }
        for bad in ["", "on", "999", "-1", "1e5", "Off"] {
            let refusal = bad.parse::<Batching>().unwrap_err().to_string();
            assert_eq!(
                refusal,
                format!("auto, off or 1000 to 10000000 faces of a batch are possible; {bad:?} is not")
            );
        }
        assert!(Batching::try_from(0).is_err());
    }
}
