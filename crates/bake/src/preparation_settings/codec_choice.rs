//! The codec with which a model is prepared.

use std::fmt;
use std::str::FromStr;

use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::prepare::select_codec;
use lodestream_geometry::{Codec, Named, UnknownName};

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

impl Named for CodecChoice {
    const ALL: &'static [Self] =
        &[Self::Auto, Self::Codec(Codec::Range), Self::Codec(Codec::AxisAligned), Self::Codec(Codec::Zstd)];

    fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Codec(codec) => codec.name(),
        }
    }
}

impl fmt::Display for CodecChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for CodecChoice {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        Self::from_name(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_is_read_by_the_name_that_it_shows() {
        for &choice in CodecChoice::ALL {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        let codecs = Codec::ALL.iter().copied().map(CodecChoice::from);
        assert!(codecs.chain([CodecChoice::Auto]).all(|choice| CodecChoice::ALL.contains(&choice)));
        let refusal = "best".parse::<CodecChoice>().unwrap_err();
        assert_eq!(refusal.to_string(), "auto, range, axis-aligned or zstd is possible; \"best\" is not");
    }
}
