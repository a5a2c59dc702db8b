//! Entropy coding: symbols to bytes and back, independent of what the symbols mean.
//!
//! A model is written once, against [`range_coder::Coder`]: it passes the value to encode and continues with the
//! value returned, so encoder and decoder cannot diverge. [`symbols`] codes integers and indices, [`context`] holds
//! the adaptive probabilities, and [`allocation_limit`] bounds how many elements a decoder accepts per byte.
//!
//! ```
//! use lodestream_geometry::entropy::context::{Contexts, Prob};
//! use lodestream_geometry::entropy::range_coder::{Coder, Decoder, Encoder};
//! use lodestream_geometry::entropy::symbols::{INTEGER_CONTEXTS, integer};
//!
//! let contexts = || Contexts { probs: vec![Prob::default(); INTEGER_CONTEXTS], weights: Vec::new() };
//! let mut encoder = Encoder::new(contexts());
//! integer(&mut encoder, 0, 1234);
//! let bytes = encoder.finish(0);
//!
//! let mut decoder = Decoder::new(contexts(), &bytes);
//! assert_eq!(integer(&mut decoder, 0, 0), 1234);
//! decoder.end(0)?;
//! # Ok::<(), lodestream_geometry::DecodeError>(())
//! ```

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

pub mod allocation_limit;
pub mod bytes;
pub mod context;
pub mod null_coder;
pub mod range_coder;
pub mod steps;
pub mod symbols;
pub mod zstd_streams;

use std::fmt;
use std::str::FromStr;

use crate::name::{Named, UnknownName};

/// Codec of chunks and base mesh, named `range`, `axis-aligned` and `zstd`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Codec {
    /// Adaptive range coder with trained priors: fewest bytes, and truncation points inside chunks.
    #[default]
    Range,
    /// Range coder with contexts for geometry built along the axes, such as buildings and machines. Positions: a flag
    /// per coordinate tells whether it equals a neighbour's. Normal groups follow from face orientations, textures
    /// are projected along the axes, and all levels share one grid so coordinates stay equal. Saves 20 to 70 % there;
    /// coarse levels of round shapes take more. [`crate::prepare::suit`] converts a mesh to this form.
    AxisAligned,
    /// Symbols uncompressed, sorted into streams, for a general-purpose compressor that the caller applies to whole
    /// blobs: more bytes, less work. No truncation points, since a compressed blob has no decodable prefix.
    Zstd,
}

impl Named for Codec {
    const ALL: &'static [Self] = &[Self::Range, Self::AxisAligned, Self::Zstd];

    fn name(self) -> &'static str {
        match self {
            Self::Range => "range",
            Self::AxisAligned => "axis-aligned",
            Self::Zstd => "zstd",
        }
    }
}

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Codec {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        Self::from_name(name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codec_names_round_trip() {
        for &codec in Codec::ALL {
            assert_eq!(codec.to_string().parse(), Ok(codec));
        }
        let refusal = "plain".parse::<Codec>().unwrap_err();
        assert_eq!(refusal.to_string(), "range, axis-aligned or zstd is possible; \"plain\" is not");
    }
}
