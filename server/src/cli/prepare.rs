//! `prepare`: one model to one pack.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;

use super::Outcome;
use crate::prepare::{Options, prepare_to};
use crate::scene::Precision;

/// How finely positions are kept; one of the two, or neither for the default.
#[derive(Clone, Copy, Debug, Args)]
#[group(required = false, multiple = false)]
pub(super) struct PrecisionArguments {
    /// Bits per axis of positions. More bits cost about 3 bits a vertex each [default: 14].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(4..=24))]
    position_bits: Option<u8>,
    /// Largest error of a position, in the model's units; decides the bits.
    #[arg(long, value_name = "LENGTH", value_parser = positive)]
    tolerance: Option<f64>,
}

impl PrecisionArguments {
    pub(super) fn resolve(self) -> Option<Precision> {
        self.position_bits.map(Precision::Bits).or(self.tolerance.map(Precision::Tolerance))
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("a positive number is needed".to_owned()),
    }
}

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The model.
    #[arg(value_name = "FILE.obj")]
    model: PathBuf,
    /// The pack to write.
    #[arg(short, long, value_name = "FILE.lsp")]
    output: PathBuf,
    #[command(flatten)]
    precision: PrecisionArguments,
    /// Depth of relief, in units of texture coordinates, instead of what the materials say.
    #[arg(long, value_name = "DEPTH", value_parser = positive)]
    relief_depth: Option<f64>,
    /// Threads; the pack does not depend on it [default: as many as there are cores].
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// No progress.
    #[arg(short, long)]
    quiet: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let options = Options {
        precision: arguments.precision.resolve(),
        relief_depth: arguments.relief_depth.map(|depth| depth as f32),
        threads: arguments.threads,
        quiet: arguments.quiet,
    };
    let name = arguments.model.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
    let report = prepare_to(&arguments.model, &name, &options, &arguments.output)?;
    for warning in &report.warnings {
        eprintln!("warning: {warning}");
    }
    Ok(Outcome::good(format!("{}: {report}\n", arguments.output.display())))
}
