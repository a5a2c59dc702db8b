//! From a run that is over to its figures.

use std::time::Duration;

use lodestream_client::core::{Milestone, QUALITIES_PX};
use lodestream_client::net::Host as _;
use lodestream_protocol::message::Close;

use super::plan::{Case, Plan};
use super::report::{RunResult, error_name, milliseconds};
use super::run::Traffic;
use super::viewer::Viewer;

/// The place of a screen error among those that clients note. Plans are checked to name no others.
pub(crate) fn quality<T: Copy>(noted: &[Option<T>; QUALITIES_PX.len()], px: f64) -> Option<T> {
    QUALITIES_PX.iter().position(|q| *q == px).and_then(|i| noted[i])
}

pub(crate) fn result(
    plan: &Plan,
    case: &Case,
    seed: u64,
    viewer: &mut Viewer<'_>,
    close: &Close,
    traffic: &Traffic,
) -> RunResult {
    let (settled, gave_up) = (viewer.settled(), viewer.gave_up());
    let stats = viewer.core().stats();
    let counts = viewer.core().scene().map(|header| (header.asset_count, header.instance_count));
    let (assets, instances) = counts.unzip();
    let ms = |after: Duration| milliseconds(u64::try_from(after.as_nanos()).unwrap_or(u64::MAX));
    let time = |m: Option<Milestone>| m.map(|m| ms(m.after));
    let bytes = |m: Option<Milestone>| m.map(|m| m.bytes);
    let first = stats.milestones.first_frame;
    let noted = |px| quality(&stats.milestones.quality, px);
    let (stalls, stalled_ns) = viewer.stalls.found();
    let rest = viewer.rest();
    let rest_quality = |px: f64| (error_name(px), quality(&viewer.rest_quality(), px).map(ms));
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
        ttff_ms: time(first),
        first_frame_bytes: bytes(first),
        ttq_ms: plan.ttq_px.iter().map(|&px| (error_name(px), time(noted(px)))).collect(),
        ttq_bytes: plan.ttq_px.iter().map(|&px| (error_name(px), bytes(noted(px)))).collect(),
        total_bytes: settled.map_or(stats.transport_bytes, |s| s.bytes),
        settled_ms: settled.map(|s| ms(s.after)),
        ended: match (settled, gave_up) {
            (Some(_), _) => "settled".to_owned(),
            (None, true) => "time limit".to_owned(),
            (None, false) => close.reason.clone(),
        },
        ended_ms: viewer.ended().map(|at| milliseconds(at.as_ns())),
        rest_ms: rest.map(|at| milliseconds(at.as_ns())),
        rest_ttq_ms: if rest.is_some() {
            plan.ttq_px.iter().copied().map(rest_quality).collect()
        } else {
            std::collections::BTreeMap::new()
        },
        assets,
        instances,
        applied_faces: Some(stats.counters.applied_faces),
        stalls,
        stalled_ms: milliseconds(stalled_ns),
        usage: viewer.usage(),
        packets_lost: traffic.down.lost,
        packets_dropped: traffic.down.queue_full,
        packets_lost_up: traffic.up.lost,
        packets_dropped_up: traffic.up.queue_full,
        trace: format!("{:016x}", traffic.trace),
        series: viewer.series.samples().to_vec(),
        pictures: Vec::new(),
    }
}
