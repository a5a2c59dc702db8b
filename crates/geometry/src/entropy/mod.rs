//! Entropy coding: from symbols to bytes and back. Knows nothing of what the symbols mean.
//!
//! A model is written once, against [`range_coder::Coder`]: it says what it would write and goes on with what it gets
//! back, so an encoder and its decoder cannot drift apart. Whole numbers and choices are in [`symbols`]; what a range
//! coder believes is in [`context`]; how much may be believed of so many bytes, before anything is reserved, is in
//! [`allocation_limit`].
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

use crate::name::UnknownName;

/// How the symbols of chunks and of the base mesh become bytes; `range`, `axis-aligned` or `zstd` in words, after the compressor
/// that goes with the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Codec {
    /// An adaptive range coder with trained priors: the fewest bytes, and stopping points inside chunks.
    #[default]
    Range,
    /// The same for what is built of parts along the axes, as machines and houses are: a chunk's position says of each
    /// coordinate whether it is a neighbour's, normal groups follow from how faces lean, textures are projected along the
    /// axes, and all levels lie on one grid, on which coordinates stay equal. Two to seven tenths fewer bytes there;
    /// coarse levels of what is round take more. A mesh is brought into its form by [`crate::prepare::suit`].
    AxisAligned,
    /// Symbols as they are, sorted into streams, for a general-purpose compressor that the caller
    /// applies to whole blobs: more bytes, less to do. Without stopping points, since a compressed blob
    /// has no beginning that could be used.
    Zstd,
}

impl fmt::Display for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Range => "range",
            Self::AxisAligned => "axis-aligned",
            Self::Zstd => "zstd",
        })
    }
}

impl FromStr for Codec {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        match name {
            "range" => Ok(Self::Range),
            "axis-aligned" => Ok(Self::AxisAligned),
            "zstd" => Ok(Self::Zstd),
            _ => Err(UnknownName::new("range, axis-aligned or zstd", name)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_codec_is_read_by_the_name_that_it_shows() {
        for codec in [Codec::Range, Codec::AxisAligned, Codec::Zstd] {
            assert_eq!(codec.to_string().parse(), Ok(codec));
        }
        let refusal = "plain".parse::<Codec>().unwrap_err();
        assert_eq!(refusal.to_string(), "range, axis-aligned or zstd is possible; \"plain\" is not");
    }
}
