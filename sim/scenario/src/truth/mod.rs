//! Validation of virtual time: runs the cases of a plan in virtual time and again in real time.
//!
//! Real time uses the shipped daemon on its own threads, real sockets on loopback, a user-space relay ([`relay_udp`],
//! [`relay_tcp`]) with the simulator's link code ([`lodestream_netsim::link`], [`lodestream_netsim::tcp`]), and the
//! simulator's client. The difference is what virtual time omits: computing time, wake-ups of a real system, and the
//! buffers of real sockets.
//!
//! Other load on the machine affects the figures, so each case is repeated and the median is compared; least and
//! greatest are reported too.

mod real;
pub mod relay_tcp;
pub mod relay_udp;
mod report;

use std::sync::Arc;

use lodestream_protocol::source::SceneSource;

use crate::plan::Plan;
use crate::result::RunResult;
use crate::technique::Technique;
pub use real::RealLink;
pub use report::{Comparison, Difference, Figure, compare, figures};

/// Most repeats of a case in real time.
pub const MAX_REPEATS: u32 = 100;

/// Runs the cases of a plan, each with its first seed, in virtual time and `repeats` times in real time, one after the
/// other. `report` receives each case. `scenes` are the plan's, in its order.
///
/// # Errors
/// A plan whose cases cannot be repeated in real time, sockets that the system refuses, and runs that end early.
pub fn run(
    plan: &Plan,
    scenes: &[Arc<dyn SceneSource>],
    repeats: u32,
    mut report: impl FnMut(&Comparison),
) -> anyhow::Result<Vec<Comparison>> {
    if let Some(other) = plan.cases.iter().find(|case| case.technique != Technique::Lodestream) {
        anyhow::bail!(
            "{} cannot be fetched in real time: there is no server for it; leave it out of the plan",
            other.technique
        );
    }
    if plan.cases.iter().any(|case| case.resumed) {
        anyhow::bail!("resumed connections are not compared with real time; leave `resumed` out of the plan");
    }
    let mut all = Vec::with_capacity(plan.cases.len());
    for case in &plan.cases {
        let mut alone = plan.clone();
        alone.cases = vec![case.clone()];
        let first = case.seeds.first().copied().unwrap_or(1);
        alone.cases[0].seeds = [first].into();
        let one = std::num::NonZeroUsize::MIN;
        let Some(simulated) = crate::run(&alone, scenes, one, |_| {})?.pop() else { continue };
        let scene = &scenes[case.scene];
        let measured = (0..repeats)
            .map(|_| real::run_case(plan, case, scene, first))
            .collect::<anyhow::Result<Vec<RunResult>>>()?;
        let comparison = compare(&simulated, &measured);
        report(&comparison);
        all.push(comparison);
    }
    Ok(all)
}
