//! Sampling of surfaces, for the commands that compare them.

use std::num::NonZeroU32;

use clap::Args;

// No doc comment: it would take the place of the command's own in --help.
#[derive(Debug, Args)]
pub(crate) struct Sampling {
    /// Points sampled on each surface.
    #[arg(long, default_value = "200000")]
    pub(crate) samples: NonZeroU32,
    /// Seed of all random numbers.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
}
