//! `lodestream-sim untrusted-peers`: arguments; prints a line per attack.

use clap::Args;
use lodestream_scenario::plan;
use lodestream_scenario::scene;
use lodestream_scenario::untrusted_peers::{Attack, measure};

use crate::arguments::CacheFolder;
use crate::print::Results;

#[derive(Debug, Args)]
pub(crate) struct UntrustedPeers {
    /// The scene, as in plans: "demo", "field:assets=100,faces=10000,instances=1000" …
    scene: String,
    /// Only attacks with this in their name.
    #[arg(long, default_value = "")]
    only: String,
    #[command(flatten)]
    cache: CacheFolder,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl UntrustedPeers {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let choice = plan::scene_choice(&self.scene)?;
        let source = scene::open(&choice, None, &self.cache.path()?, true)?;
        let mut results = Results::new(self.json);
        for case in Attack::ALL.into_iter().filter(|(attack, _)| attack.name().contains(&self.only)) {
            results.push(measure(&self.scene, &source, self.cache.named(), case)?);
        }
        let all = results.finish()?;
        anyhow::ensure!(!all.is_empty(), "no attack has {:?} in its name", self.only);
        Ok(())
    }
}
