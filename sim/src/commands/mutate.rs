//! `lodestream-sim mutate`: arguments; prints a line per subject.

use clap::Args;
use lodestream_scenario::mutate::{Settings, Subject, measure};

use crate::arguments::CacheFolder;
use crate::print::Results;

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
    /// Only subjects with this in their name.
    #[arg(long, default_value = "")]
    only: String,
    #[command(flatten)]
    cache: CacheFolder,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl Mutate {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let settings = Settings { seed: self.seed, first: self.first, count: self.count };
        let cache = self.cache.path()?;
        let mut results = Results::new(self.json);
        for subject in Subject::ALL.into_iter().filter(|one| one.name().contains(&self.only)) {
            results.push(measure(subject, settings, &cache, self.cache.named())?);
        }
        let all = results.finish()?;
        anyhow::ensure!(!all.is_empty(), "no subject has {:?} in its name", self.only);
        let findings: u32 = all.iter().map(|found| found.panics + found.stuck).sum();
        anyhow::ensure!(
            findings == 0,
            "{findings} cases panicked or came to no end; each was named as it came"
        );
        Ok(())
    }
}
