//! The codec with which a model is prepared.

use std::fmt;
use std::str::FromStr;

use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::prepare::select_codec;
use lodestream_geometry::{Codec, UnknownName};

/// A codec, or automatic selection by the mesh. As text `auto` or the codec's name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CodecChoice {
    /// The codec that [`select_codec`] chooses: axis-aligned for meshes built along the axes with repeated coordinates,
    /// else the range coder.
    #[default]
    Auto,
    /// The given codec for every mesh.
    Codec(Codec),
}

impl CodecChoice {
    /// The codec for a mesh.
    #[must_use]
    pub fn of(self, mesh: &QuantisedMesh) -> Codec {
        match self {
            Self::Auto => select_codec(mesh),
            Self::Codec(codec) => codec,
        }
    }
}

impl From<Codec> for CodecChoice {
    fn from(codec: Codec) -> Self {
        Self::Codec(codec)
    }
}

impl fmt::Display for CodecChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Codec(codec) => codec.fmt(f),
        }
    }
}

impl FromStr for CodecChoice {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        if name == "auto" {
            return Ok(Self::Auto);
        }
        let unknown = |_| UnknownName::new("auto, range, axis-aligned or zstd", name);
        name.parse().map(Self::Codec).map_err(unknown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_is_read_by_the_name_that_it_shows() {
        let codecs = [Codec::Range, Codec::AxisAligned, Codec::Zstd].map(CodecChoice::from);
        for choice in codecs.into_iter().chain([CodecChoice::Auto]) {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        let refusal = "best".parse::<CodecChoice>().unwrap_err();
        assert_eq!(refusal.to_string(), "auto, range, axis-aligned or zstd is possible; \"best\" is not");
    }
}
