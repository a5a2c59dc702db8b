//! `lodestream-sim models`: arguments; prints a line per model.

use std::path::PathBuf;

use clap::Args;
use lodestream_scenario::models;

use crate::arguments::CacheFolder;

#[derive(Debug, Args)]
pub(crate) struct Models {
    /// The models, one mesh each.
    #[arg(required = true, value_name = "MODEL")]
    models: Vec<PathBuf>,
    #[command(flatten)]
    cache: CacheFolder,
    /// Print a JSON object per line instead of text.
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
