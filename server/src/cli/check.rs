//! `check`: random sets of chunks must give one mesh, whatever their order.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_geometry::check::{CheckReport, check};

use super::Outcome;
use crate::prepare::Threads;
use crate::store::PackFile;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The pack.
    #[arg(value_name = "FILE.lsp")]
    pack: PathBuf,
    /// How many sets.
    #[arg(long, value_name = "N", default_value_t = 200)]
    random_sets: u32,
    /// The same seed gives the same sets and orders.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let asset = PackFile::open(&arguments.pack)?.load()?;
    let threads = Threads::new(None);
    let sets = arguments.random_sets as usize;
    let report = check(&asset.base, &asset.infos, &asset.chunks, sets, arguments.seed, &threads)
        .with_context(|| arguments.pack.display().to_string())?;
    let CheckReport { sets, cracks, order_dependent, undo_errors } = report;
    Ok(Outcome {
        text: format!(
            "sets {sets} cracks {cracks} order-dependent {order_dependent} undo-errors {undo_errors}\n"
        ),
        good: cracks == 0 && order_dependent == 0 && undo_errors == 0,
    })
}
