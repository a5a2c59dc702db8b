//! `lodestream-sim models`: its arguments, and a line for each model.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_scenario::models;

#[derive(Debug, Args)]
pub(crate) struct ModelsCommand {
    /// The models, a mesh each.
    #[arg(required = true, value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// Folder of prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream].
    #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Prints JSON, a line each, instead of text.
    #[arg(long)]
    json: bool,
}

impl ModelsCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let cache = self.cache.clone().or_else(lodestream_server::prepare::cache::default_folder);
        let cache = cache.context("no cache folder is known; name one with --cache DIR")?;
        for file in &self.models {
            let model = models::measure(file, &cache)?;
            if self.json {
                println!("{}", serde_json::to_string(&model)?);
            } else {
                println!("{model}");
            }
        }
        Ok(())
    }
}
