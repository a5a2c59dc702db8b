//! `lodestream-sim mutate`: arguments; prints a line per subject.

use clap::Args;
use lodestream_scenario::mutate::{Settings, Subject, measure};

use crate::arguments::Selection;

#[derive(Debug, Args)]
pub(crate) struct Mutate {
    /// Number of cases of each subject.
    #[arg(long, default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    count: u32,
    /// Seed of all damage.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Number of the first case; with --count 1, a reported case is repeated alone.
    #[arg(long, default_value_t = 0)]
    first: u32,
    #[command(flatten)]
    selection: Selection,
}

impl Mutate {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let settings = Settings { seed: self.seed, first: self.first, count: self.count };
        let cache = &self.selection.cache;
        let folder = cache.path()?;
        let all = self.selection.measure(
            Subject::ALL,
            |subject| subject.name(),
            |subject| measure(subject, settings, &folder, cache.named()),
        )?;
        let findings: u32 = all.iter().map(|found| found.panics + found.stuck).sum();
        anyhow::ensure!(
            findings == 0,
            "{findings} cases panicked or came to no end; each was named as it came"
        );
        Ok(())
    }
}
