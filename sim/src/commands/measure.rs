//! `lodestream-sim measure`: arguments; prints a line per distance.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use lodestream_assess::measure::{self, AttributeDifferences, Comparison, Differences};

use crate::arguments::Sampling;

#[derive(Debug, Args)]
pub(crate) struct Measure {
    /// The reference; distances are relative to the diagonal of its bounding box.
    a: PathBuf,
    /// The mesh that approximates it.
    b: PathBuf,
    #[command(flatten)]
    sampling: Sampling,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

impl Measure {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let samples = NonZeroUsize::try_from(self.sampling.samples)?;
        let settings = measure::Settings { samples, seed: self.sampling.seed, ..Default::default() };
        let meshes = measure::read_models(&self.a, &self.b)?;
        let [first, second] = meshes.each_ref().map(measure::Surface::from);
        let found = measure::compare(&first, &second, &settings)
            .with_context(|| format!("cannot compare {} with {}", self.a.display(), self.b.display()))?;
        let attributes = measure::compare_attributes(&meshes[0], &meshes[1], &settings);
        if self.json {
            let mut value = serde_json::to_value(found)?;
            value["attributes"] = serde_json::to_value(attributes)?;
            println!("{value}");
        } else {
            self.say(&found, &attributes);
        }
        Ok(())
    }

    fn say(&self, found: &Comparison, attributes: &AttributeDifferences) {
        let line = |name: &str, value: f64| println!("{name} {value:.6e} ({:.3}e-5)", value * 1e5);
        println!("diagonal of {}: {} (distances are fractions of it)", self.a.display(), found.diagonal);
        println!("samples {} on each surface, seed {}", found.samples, self.sampling.seed);
        line("first to second: rms", found.a_to_b.rms);
        line("first to second: max", found.a_to_b.max);
        line("second to first: rms", found.b_to_a.rms);
        line("second to first: max", found.b_to_a.max);
        line("rms", found.rms);
        line("max", found.max);
        let attribute = |name: &str, found: Option<Differences>| match found {
            Some(d) => println!("{name} rms {:.6} max {:.6} beyond 0.01 {:.4}", d.rms, d.max, d.beyond),
            None => println!("{name} -"),
        };
        attribute("texture coordinates:", attributes.uv);
        attribute("normals (chord):", attributes.normal);
        attribute("colours:", attributes.color);
        if let Some(share) = attributes.material {
            println!("other material: {share:.4}");
        }
    }
}
