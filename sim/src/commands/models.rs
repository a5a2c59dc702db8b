//! `lodestream-sim models`: its arguments, and a line for each model.

use std::path::PathBuf;

use clap::Args;
use lodestream_scenario::models;

use crate::arguments::CacheFolder;

#[derive(Debug, Args)]
pub(crate) struct Models {
    /// The models, a mesh each.
    #[arg(required = true, value_name = "MODEL")]
    models: Vec<PathBuf>,
    #[command(flatten)]
    cache: CacheFolder,
    /// Prints JSON, a line each, instead of text.
    #[arg(long)]
    json: bool,
}

impl Models {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let cache = self.cache.path()?;
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
