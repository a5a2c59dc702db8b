//! `inspect`: contents and statistics of a pack.

use std::path::PathBuf;

use clap::Args;

use super::outcome::Outcome;
use lodestream_bake::inspect::inspect;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The pack.
    #[arg(value_name = "FILE.lsp")]
    pack: PathBuf,
    /// Print JSON, for programs.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let summary = inspect(&arguments.pack)?;
    let json = serde_json::to_value(&summary)?;
    if arguments.json {
        return Ok(Outcome::good(format!("{}\n", serde_json::to_string_pretty(&summary)?)));
    }
    // One line per field, aligned; numbers as JSON writes them.
    let mut text = String::new();
    if let serde_json::Value::Object(fields) = json {
        for (name, value) in fields {
            text.push_str(&format!("{name:<18} {value}\n"));
        }
    }
    Ok(Outcome::good(text))
}
