//! Comparison of a chain of levels with other techniques: bytes and time until each screen error of the chain.
//!
//! The error of a chain falls in few steps, which a list of thresholds in a plan would miss: exactly at a level's error
//! the chain compares best, slightly below it has to wait for the next level.

use lodestream_scenario::plan::{Case, Plan, Transport};
use lodestream_scenario::result::RunResult;
use lodestream_scenario::technique::Technique;
use lodestream_scenario::timeline::{Sample, milliseconds};

/// Bytes and time of a technique until the screen error of a level of the chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// The scene's name in the plan.
    pub scene: String,
    /// Transport between client and server.
    pub transport: Transport,
    /// The link's name or description.
    pub link: String,
    /// Rate of the link from server to client, at the start.
    pub rate_bits_per_s: u64,
    /// Seed of the runs.
    pub seed: u64,
    /// The level's screen error, in pixels.
    pub error_px: f64,
    /// The technique; the chain itself is included.
    pub technique: String,
    /// Transport payload received until no visible part had a larger screen error; `None` if that never happened.
    pub bytes: Option<u64>,
    /// Virtual time from the connect call until then, at the resolution of the run's series.
    pub ms: Option<f64>,
}

/// For each run of [`Technique::Chain`] with a fixed camera: its levels from coarse to fine, and for each the runs that
/// differ only in the technique, in the plan's order. `results` are the plan's, in its order.
#[must_use]
pub fn of_plan(plan: &Plan, results: &[RunResult]) -> Vec<Level> {
    let cases = plan.cases.iter().flat_map(|case| case.seeds.iter().map(move |_| case));
    let runs: Vec<(&Case, &RunResult)> = cases.zip(results).collect();
    let chains = runs.iter().filter(|(case, _)| case.technique == Technique::Chain && !case.path.moves());
    let of_chain = |(case, chain): &(&Case, &RunResult)| {
        let alike = runs.iter().filter(|(c, run)| run.seed == chain.seed && alike(case, c));
        let alike: Vec<&RunResult> = alike.map(|(_, run)| *run).collect();
        let at = |error_px| alike.iter().map(|run| level(run, error_px)).collect::<Vec<_>>();
        errors(&chain.series).flat_map(at).collect::<Vec<_>>()
    };
    chains.flat_map(of_chain).collect()
}

/// Whether cases differ only in the technique.
fn alike(a: &Case, b: &Case) -> bool {
    let Case { technique, peer, ref seeds, .. } = *a;
    *a == Case { technique, peer, seeds: seeds.clone(), ..b.clone() }
}

/// The successively smaller screen errors of a series.
fn errors(series: &[Sample]) -> impl Iterator<Item = f64> {
    let mut least = f64::INFINITY;
    series.iter().filter_map(move |sample| {
        let error_px = sample.error_px.filter(|px| *px < least)?;
        least = error_px;
        Some(error_px)
    })
}

fn level(run: &RunResult, error_px: f64) -> Level {
    let reached = run.series.iter().find(|sample| sample.error_px.is_some_and(|px| px <= error_px));
    Level {
        scene: run.scene.clone(),
        transport: run.transport,
        link: run.link.clone(),
        rate_bits_per_s: run.rate_bits_per_s,
        seed: run.seed,
        error_px,
        technique: run.technique.clone(),
        bytes: reached.map(|sample| sample.bytes),
        ms: reached.map(|sample| milliseconds(sample.at_ns)),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use lodestream_scenario::plan;

    /// Runs of a plan with one series each, of (ms, bytes, px).
    fn results(plan: &Plan, series: &[&[(u64, u64, Option<f64>)]]) -> Vec<RunResult> {
        let sample = |&(ms, bytes, error_px): &_| Sample {
            at_ns: ms * 1_000_000,
            bytes,
            error_px,
            unoccluded_error_px: None,
        };
        let cases = plan.cases.iter().zip(series);
        cases
            .map(|(case, series)| RunResult {
                series: series.iter().map(sample).collect(),
                ..RunResult::nothing(plan, case, 1, "settled")
            })
            .collect()
    }

    fn plan_of(sweep: &str) -> Plan {
        let text = format!("scene = \"demo\"\n[[sweep]]\nrtt_ms = 50\n{sweep}");
        plan::parse(&text, Path::new("plan.toml")).unwrap()
    }

    #[test]
    fn each_error_of_the_chain_is_a_row_of_every_technique_over_its_link() {
        let plan = plan_of(
            "transport = \"quic\"\nrate_bits_per_s = [5000, 9000]\ntechnique = [\"lodestream\", \"chain\", \"obj\"]",
        );
        let ours: &[_] = &[(1, 10, None), (2, 20, Some(9.0)), (3, 30, Some(2.0))];
        let chain: &[_] = &[(4, 40, Some(8.0)), (5, 45, Some(8.0)), (6, 50, Some(9.0)), (7, 60, Some(2.0))];
        let obj: &[_] = &[(8, 90, None)];
        let other: &[_] = &[(9, 99, Some(1.0))];
        let found = of_plan(&plan, &results(&plan, &[ours, chain, obj, ours, other, ours]));
        let rows: Vec<_> = found.iter().map(|l| (l.error_px, l.technique.as_str(), l.bytes, l.ms)).collect();
        let first = [
            (8.0, "lodestream", Some(30), Some(3.0)),
            (8.0, "chain", Some(40), Some(4.0)),
            (8.0, "obj", None, None),
            (2.0, "lodestream", Some(30), Some(3.0)),
            (2.0, "chain", Some(60), Some(7.0)),
            (2.0, "obj", None, None),
        ];
        assert_eq!(rows[..6], first);
        // At the other rate the chain has one level, which only it reaches.
        let second =
            [(1.0, "lodestream", None, None), (1.0, "chain", Some(99), Some(9.0)), (1.0, "obj", None, None)];
        assert_eq!(rows[6..], second);
        assert!(found[..6].iter().all(|l| l.rate_bits_per_s == 5000) && found[6].rate_bits_per_s == 9000);
    }

    #[test]
    fn no_levels_without_a_chain_or_with_a_moving_camera() {
        let link = "transport = \"quic\"\nrate_bits_per_s = 5000";
        for sweep in ["technique = \"obj\"", "technique = \"chain\"\ncamera = \"orbit\""] {
            let plan = plan_of(&format!("{link}\n{sweep}"));
            assert_eq!(of_plan(&plan, &results(&plan, &[&[(1, 1, Some(1.0))]])), []);
        }
    }
}
