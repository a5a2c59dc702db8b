//! Seeds of a plan: their number, or a list.

use std::collections::BTreeSet;
use std::sync::Arc;

use serde::Deserialize;

use super::Fault;

/// Most seeds of one sweep.
const MAX_SEEDS: usize = 10_000;

/// `seeds = 30` (1 to 30), or `seeds = [3, 14]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged, expecting = "expected a number of seeds, or a list of seeds, all from 0 on")]
pub(super) enum Seeds {
    Count(u64),
    List(Vec<u64>),
}

impl Default for Seeds {
    fn default() -> Self {
        Self::Count(1)
    }
}

impl Seeds {
    pub(super) fn list(&self) -> Result<Arc<[u64]>, Fault> {
        let fault = |message: String| Err(Fault::new("seeds", message));
        let most = MAX_SEEDS as u64;
        match self {
            Self::Count(count) if (1..=most).contains(count) => Ok((1..=*count).collect()),
            Self::Count(count) => fault(format!("{count} is not a number of seeds from 1 to {MAX_SEEDS}")),
            Self::List(list) if list.is_empty() => fault("is empty; give at least one seed".into()),
            Self::List(list) if list.len() > MAX_SEEDS => fault(format!("lists more than {MAX_SEEDS} seeds")),
            Self::List(list) => {
                let mut seen = BTreeSet::new();
                match list.iter().find(|seed| !seen.insert(**seed)) {
                    Some(twice) => fault(format!("lists seed {twice} twice; a run is the same both times")),
                    None => Ok(list.as_slice().into()),
                }
            }
        }
    }
}
