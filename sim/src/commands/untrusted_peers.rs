//! `lodestream-sim untrusted-peers`: arguments; prints a line per attack.

use clap::Args;
use lodestream_scenario::plan;
use lodestream_scenario::scene;
use lodestream_scenario::untrusted_peers::{Attack, measure};

use crate::arguments::Selection;

#[derive(Debug, Args)]
pub(crate) struct UntrustedPeers {
    /// The scene, as in plans: "demo", "field:assets=100,faces=10000,instances=1000" …
    scene: String,
    #[command(flatten)]
    selection: Selection,
}

impl UntrustedPeers {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let choice = plan::scene_choice(&self.scene)?;
        let source = scene::open(&choice, None, &self.selection.cache.path()?, true)?;
        let named = self.selection.cache.named();
        let measured = self.selection.measure(
            Attack::ALL,
            |(attack, _)| attack.name(),
            |case| measure(&self.scene, &source, named, case),
        );
        measured.map(drop)
    }
}
