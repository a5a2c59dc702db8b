//! Converts a finished run into its result.

use std::collections::BTreeMap;
use std::time::Duration;

use lodestream_client::core::{Milestone, QUALITIES_PX};
use lodestream_client::net::Host as _;
use lodestream_protocol::Time;
use lodestream_protocol::message::Close;

use super::ledger::Use;
use super::network::Traffic;
use super::plan::{Case, Plan};
use super::quality::quality;
use super::result::{RunResult, error_name};
use super::technique::Technique;
use super::timeline::{Stalls, milliseconds};
use super::viewer::Viewer;

/// A duration in milliseconds, as reports print it.
pub(crate) fn after_ms(after: Duration) -> f64 {
    milliseconds(u64::try_from(after.as_nanos()).unwrap_or(u64::MAX))
}

/// Milestones of a client, of this project or of a baseline.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ClientMilestones {
    pub(crate) first_frame: Option<Milestone>,
    pub(crate) quality: [Option<Milestone>; QUALITIES_PX.len()],
    pub(crate) unoccluded_quality: [Option<Milestone>; QUALITIES_PX.len()],
    /// When a moving camera came to rest.
    pub(crate) rest: Option<Time>,
    pub(crate) rest_quality: [Option<Duration>; QUALITIES_PX.len()],
    pub(crate) rest_unoccluded_quality: [Option<Duration>; QUALITIES_PX.len()],
    pub(crate) stalls: Stalls,
}

impl RunResult {
    /// The result of a run that could not take place, with the reason.
    #[must_use]
    pub fn nothing(plan: &Plan, case: &Case, seed: u64, why: &str) -> Self {
        line(plan, case, seed, why, &ClientMilestones::default(), &Traffic::default())
    }
}

/// The result with the case, the client's milestones and the network's counters; all else is empty.
pub(crate) fn line(
    plan: &Plan,
    case: &Case,
    seed: u64,
    ended: &str,
    noted: &ClientMilestones,
    traffic: &Traffic,
) -> RunResult {
    let bytes = |m: Option<Milestone>| m.map(|m| m.bytes);
    let time = |m: Option<Milestone>| m.map(|m| after_ms(m.after));
    let by_error = |noted: &[Option<Milestone>; QUALITIES_PX.len()]| {
        let reached = |px| (error_name(px), quality(noted, px));
        plan.ttq_px.iter().copied().map(reached).collect::<Vec<_>>()
    };
    let times = |noted: &[(String, Option<Milestone>)]| {
        noted.iter().map(|(px, reached)| (px.clone(), time(*reached))).collect()
    };
    let sizes = |noted: &[(String, Option<Milestone>)]| {
        noted.iter().map(|(px, reached)| (px.clone(), bytes(*reached))).collect()
    };
    let (all, seen) = (by_error(&noted.quality), by_error(&noted.unoccluded_quality));
    let at_rest = |reached: &[Option<Duration>; QUALITIES_PX.len()]| {
        let reached = |px| (error_name(px), quality(reached, px).map(after_ms));
        let px = plan.ttq_px.iter().copied().filter(|_| noted.rest.is_some());
        px.map(reached).collect::<BTreeMap<_, _>>()
    };
    let (stalls, stalled_ns) = noted.stalls.totals();
    RunResult {
        scene: plan.scenes[case.scene].name.clone(),
        technique: plan.technique_name(case),
        transport: case.transport,
        resumed: case.resumed,
        link: case.link.name.clone(),
        camera: case.camera.clone(),
        rate_bits_per_s: case.link.down.rate.first(),
        rtt_ms: case.rtt_ms(),
        loss: case.link.down.loss.long_run(),
        queue_bytes: case.link.down.queue_bytes,
        limiter_bits_per_s: case.limiter_bits_per_s,
        seed,
        ttff_ms: time(noted.first_frame),
        first_frame_bytes: bytes(noted.first_frame),
        ttq_ms: times(&all),
        ttq_bytes: sizes(&all),
        unoccluded_ttq_ms: times(&seen),
        unoccluded_ttq_bytes: sizes(&seen),
        total_bytes: 0,
        requests: None,
        settled_ms: None,
        ended: ended.to_owned(),
        ended_ms: None,
        rest_ms: noted.rest.map(|at| milliseconds(at.as_ns())),
        rest_ttq_ms: at_rest(&noted.rest_quality),
        rest_unoccluded_ttq_ms: at_rest(&noted.rest_unoccluded_quality),
        assets: None,
        instances: None,
        applied_faces: None,
        needed_bytes: None,
        shadow_bytes: None,
        stalls,
        stalled_ms: milliseconds(stalled_ns),
        usage: Use::default(),
        packets_lost: traffic.down.lost,
        packets_dropped: traffic.down.queue_full,
        packets_lost_up: traffic.up.lost,
        packets_dropped_up: traffic.up.queue_full,
        trace: format!("{:016x}", traffic.trace),
        series: Vec::new(),
        pictures: Vec::new(),
        first_seconds: None,
    }
}

pub(crate) fn result(
    plan: &Plan,
    case: &Case,
    seed: u64,
    viewer: &mut Viewer<'_>,
    close: &Close,
    traffic: &Traffic,
) -> RunResult {
    let (settled, timed_out) = (viewer.settled(), viewer.timed_out());
    let stats = viewer.core().stats();
    let counts = viewer.core().scene().map(|header| (header.asset_count, header.instance_count));
    let (assets, instances) = counts.unzip();
    let noted = ClientMilestones {
        first_frame: stats.milestones.first_frame,
        quality: stats.milestones.quality,
        unoccluded_quality: stats.milestones.unoccluded_quality,
        rest: viewer.rest(),
        rest_quality: viewer.rest_quality(),
        rest_unoccluded_quality: viewer.rest_unoccluded_quality(),
        stalls: viewer.stalls,
    };
    let ended = match (settled, timed_out) {
        (Some(_), _) => "settled",
        (None, true) => "time limit",
        (None, false) => &close.reason,
    };
    RunResult {
        requests: (case.technique == Technique::Published).then_some(stats.requests),
        total_bytes: settled.map_or(stats.transport_bytes, |s| s.bytes),
        settled_ms: settled.map(|s| after_ms(s.after)),
        ended_ms: viewer.ended().map(|at| milliseconds(at.as_ns())),
        assets,
        instances,
        applied_faces: Some(stats.counters.applied_faces),
        needed_bytes: Some(stats.counters.needed_bytes),
        shadow_bytes: Some(stats.counters.shadow_bytes),
        usage: viewer.usage(),
        series: viewer.series.samples().to_vec(),
        ..line(plan, case, seed, ended, &noted, traffic)
    }
}
