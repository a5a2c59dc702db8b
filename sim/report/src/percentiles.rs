//! Percentiles over the seeds of a case.

use std::collections::BTreeMap;

use lodestream_scenario::plan::{Plan, Transport};
use lodestream_scenario::result::RunResult;
use serde::Serialize;

/// Fewest seeds for which percentiles are given.
pub const MIN_SEEDS: usize = 30;

/// Percentiles over seeds; `None` if the value is infinite.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Median.
    pub p50: Option<f64>,
    /// 90th percentile.
    pub p90: Option<f64>,
    /// 99th percentile; the maximum for fewer than 100 seeds.
    pub p99: Option<f64>,
}

impl Spread {
    /// Percentiles by nearest rank; `None` values count as infinite. `None` without any values.
    pub(super) fn of(values: impl Iterator<Item = Option<f64>>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.map(|value| value.unwrap_or(f64::INFINITY)).collect();
        sorted.sort_by(f64::total_cmp);
        let rank = |percent: usize| {
            let rank = (sorted.len() * percent).div_ceil(100).max(1);
            sorted.get(rank - 1).copied().filter(|value| value.is_finite())
        };
        (!sorted.is_empty()).then(|| Self { p50: rank(50), p90: rank(90), p99: rank(99) })
    }
}

/// Percentiles of a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Percentiles {
    /// The scene's name in the plan.
    pub scene: String,
    /// The technique.
    pub technique: String,
    /// Transport between client and server.
    pub transport: Transport,
    /// Whether the connection was resumed.
    pub resumed: bool,
    /// The link's name or description.
    pub link: String,
    /// The camera path's name.
    pub camera: String,
    /// Rate limit of the session; `None` for none.
    pub limiter_bits_per_s: Option<u64>,
    /// Number of seeds.
    pub seeds: usize,
    /// Number of runs that settled.
    pub settled: usize,
    /// Percentiles by the name of the figure in the CSV of runs.
    pub figures: BTreeMap<String, Spread>,
}

/// The figures of a run for which percentiles are given.
pub(super) fn figures(run: &RunResult) -> BTreeMap<String, Option<f64>> {
    let mut figures = BTreeMap::new();
    let mut add = |name: &str, value: Option<f64>| figures.insert(name.to_owned(), value);
    add("ttff_ms", run.ttff_ms);
    add("first_frame_bytes", run.first_frame_bytes.map(|bytes| bytes as f64));
    add("settled_ms", run.settled_ms);
    add("total_bytes", Some(run.total_bytes as f64));
    add("stalled_ms", Some(run.stalled_ms));
    add("wasted_bytes", Some(run.usage.wasted_bytes as f64));
    add("undrawn_bytes", Some(run.usage.undrawn_bytes as f64));
    for (px, ms) in &run.ttq_ms {
        add(&format!("ttq_{px}_ms"), *ms);
    }
    for (px, ms) in &run.rest_ttq_ms {
        add(&format!("rest_ttq_{px}_ms"), *ms);
    }
    for (px, ms) in &run.unoccluded_ttq_ms {
        add(&format!("unoccluded_ttq_{px}_ms"), *ms);
    }
    for (px, ms) in &run.rest_unoccluded_ttq_ms {
        add(&format!("rest_unoccluded_ttq_{px}_ms"), *ms);
    }
    figures
}

/// The percentiles of each case with at least [`MIN_SEEDS`] seeds; `results` are the plan's, in its order.
#[must_use]
pub fn of_plan(plan: &Plan, results: &[RunResult]) -> Vec<Percentiles> {
    let mut rest = results;
    let mut found = Vec::new();
    for case in &plan.cases {
        let (runs, others) = rest.split_at(case.seeds.len().min(rest.len()));
        rest = others;
        if runs.len() >= MIN_SEEDS {
            found.extend(of_case(runs));
        }
    }
    found
}

fn of_case(runs: &[RunResult]) -> Option<Percentiles> {
    let first = runs.first()?;
    let all: Vec<_> = runs.iter().map(figures).collect();
    // A run that never came to rest lacks the figures from there on, and counts as infinite in them.
    let names: std::collections::BTreeSet<&String> = all.iter().flat_map(BTreeMap::keys).collect();
    let spread = |name: &&String| {
        Spread::of(all.iter().map(|run| run.get(*name).copied().flatten())).map(|s| ((*name).clone(), s))
    };
    Some(Percentiles {
        scene: first.scene.clone(),
        technique: first.technique.clone(),
        transport: first.transport,
        resumed: first.resumed,
        link: first.link.clone(),
        camera: first.camera.clone(),
        limiter_bits_per_s: first.limiter_bits_per_s,
        seeds: runs.len(),
        settled: runs.iter().filter(|run| run.settled_ms.is_some()).count(),
        figures: names.iter().filter_map(spread).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_are_the_nearest() {
        let of = |values: &mut dyn Iterator<Item = Option<f64>>| Spread::of(values).unwrap();
        let hundred = of(&mut (1..=100).rev().map(|i| Some(f64::from(i))));
        assert_eq!(hundred, Spread { p50: Some(50.0), p90: Some(90.0), p99: Some(99.0) });
        let thirty = of(&mut (1..=30).map(|i| Some(f64::from(i))));
        assert_eq!(thirty, Spread { p50: Some(15.0), p90: Some(27.0), p99: Some(30.0) });
        let one = of(&mut [Some(7.0)].into_iter());
        assert_eq!(one, Spread { p50: Some(7.0), p90: Some(7.0), p99: Some(7.0) });
        assert_eq!(Spread::of(std::iter::empty()), None);
    }

    #[test]
    fn missing_values_count_as_infinite() {
        let values = (1..=30).map(|i| (i <= 26).then(|| f64::from(i)));
        assert_eq!(Spread::of(values), Some(Spread { p50: Some(15.0), p90: None, p99: None }));
    }
}
