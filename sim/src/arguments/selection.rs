//! Selection by name, for the commands that measure one case after the other.

use std::fmt::Display;

use clap::Args;
use serde::Serialize;

use super::CacheFolder;
use crate::print::Results;

// No doc comment: it would take the place of the command's own in --help.
#[derive(Debug, Args)]
pub(crate) struct Selection {
    /// Only those with this in their name.
    #[arg(long, default_value = "")]
    only: String,
    #[command(flatten)]
    pub(crate) cache: CacheFolder,
    /// Print JSON instead of text.
    #[arg(long)]
    json: bool,
}

impl Selection {
    /// Measures the selected ones, prints the results and returns them.
    ///
    /// # Errors
    /// Errors of `measure`; no name that contains the given part.
    pub(crate) fn measure<C, T: Display + Serialize>(
        &self,
        all: impl IntoIterator<Item = C>,
        name: impl Fn(&C) -> &'static str,
        mut measure: impl FnMut(C) -> anyhow::Result<T>,
    ) -> anyhow::Result<Vec<T>> {
        let selected: Vec<C> = all.into_iter().filter(|one| name(one).contains(&self.only)).collect();
        anyhow::ensure!(!selected.is_empty(), "none has {:?} in its name", self.only);
        let mut results = Results::new(self.json);
        for one in selected {
            results.push(measure(one)?);
        }
        results.finish()
    }
}
