//! One run of a baseline: a case and a seed, on a runtime and network of its own.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use lodestream_client::core::Milestone;
use lodestream_client::net::{self, Pin};
use lodestream_server::daemon::certificate::Certificate;
use lodestream_server::daemon::quic::{INITIAL_WINDOW_BYTES, server_config};
use quinn::VarInt;
use quinn::congestion::CubicConfig;
use rand::{RngCore, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tokio::time::timeout;

use super::library::{Content, Entry};
use super::loader::Loader;
use super::wire::{answer_quic, answer_tcp, over_quic, over_tcp};
use crate::clock::{VirtualClock, virtual_runtime};
use crate::link::{IP_UDP_BYTES, LinkCounters};
use crate::scenario::ledger::Use;
use crate::scenario::outcome::quality;
use crate::scenario::plan::{Case, Plan, Transport};
use crate::scenario::report::{RunResult, error_name, milliseconds};
use crate::scenario::run::{CLIENT, SERVER, Traffic, under};
use crate::stream_pipe::{self, Opening};
use crate::tcp::IP_TCP_BYTES;
use crate::udp::UdpNetwork;

/// Requests that the server takes at once: more than any technique has under way.
const MAX_STREAMS: u32 = 64;

/// Why a run ended, and what was received by then.
struct End {
    why: String,
    received_bytes: u64,
}

/// Runs a case with a seed.
///
/// # Errors
/// What keeps a run from being set up.
pub(crate) fn run_case(
    plan: &Plan,
    case: &Case,
    entry: &Entry,
    certificate: &Certificate,
    seed: u64,
) -> anyhow::Result<RunResult> {
    let content = match entry {
        Entry::Ready(content) => content,
        Entry::NotRun(why) => return Ok(blank(plan, case, seed, why)),
    };
    virtual_runtime().context("no runtime for virtual time")?.block_on(run(
        plan,
        case,
        content,
        certificate,
        seed,
    ))
}

async fn run(
    plan: &Plan,
    case: &Case,
    content: &Content,
    certificate: &Certificate,
    seed: u64,
) -> anyhow::Result<RunResult> {
    let target_px = plan.client.target_px;
    let limit = Duration::from_secs_f64(case.time_limit_s);
    let most = case.technique.most_in_flight();
    let mut loader = Loader::new(content, most, plan.viewport_px, target_px, case.path, limit);
    let (end, traffic) = match case.transport {
        Transport::Quic => run_quic(case, certificate, seed, limit, &mut loader).await?,
        Transport::Ws => run_tcp(case, seed, limit, &mut loader).await?,
    };
    Ok(result(plan, case, seed, &mut loader, &end, &traffic))
}

fn ended(loaded: Result<bool, String>) -> String {
    match loaded {
        Ok(true) => "settled".to_owned(),
        Ok(false) => "time limit".to_owned(),
        Err(why) => why,
    }
}

async fn run_quic(
    case: &Case,
    certificate: &Certificate,
    seed: u64,
    limit: Duration,
    loader: &mut Loader<'_>,
) -> anyhow::Result<(End, Traffic)> {
    // The same seeds in the same order as a run of the project's own, so the same packets are lost.
    let mut seeds = Pcg64Mcg::seed_from_u64(seed);
    let network = UdpNetwork::new(VirtualClock::start());
    network.connect(SERVER, CLIENT, under(&case.link.down, IP_UDP_BYTES), seeds.next_u64());
    network.connect(CLIENT, SERVER, under(&case.link.up, IP_UDP_BYTES), seeds.next_u64());
    let mut next_seed = || {
        let mut seed = [0; 32];
        seeds.fill_bytes(&mut seed);
        seed
    };
    let server = network.endpoint(SERVER, Some(file_server_config(certificate)?), next_seed())?;
    let client = network.endpoint(CLIENT, None, next_seed())?;
    let serving = tokio::spawn(answer_quic(server));
    let config = net::client_config(Pin(certificate.fingerprint()))?;
    let connecting = client.connect_with(config, SERVER, "localhost")?;
    let end = match timeout(limit, connecting).await {
        Ok(Ok(connection)) => {
            let counted = connection.clone();
            let received = move || counted.stats().udp_rx.bytes;
            let loaded = loader.load(over_quic(connection.clone()), &received).await;
            connection.close(VarInt::from_u32(0), b"");
            End { why: ended(loaded), received_bytes: received() }
        }
        Ok(Err(why)) => End { why: format!("no connection: {why}"), received_bytes: 0 },
        Err(_) => End { why: "no connection within the time limit".to_owned(), received_bytes: 0 },
    };
    let (down, up) = (network.counters(SERVER, CLIENT), network.counters(CLIENT, SERVER));
    serving.abort();
    Ok((end, Traffic { down, up, trace: network.trace() }))
}

/// The project's certificate and congestion control, quinn's defaults otherwise, and streams for requests.
fn file_server_config(certificate: &Certificate) -> anyhow::Result<quinn::ServerConfig> {
    let mut congestion = CubicConfig::default();
    congestion.initial_window(INITIAL_WINDOW_BYTES);
    let mut transport = quinn::TransportConfig::default();
    transport
        .congestion_controller_factory(Arc::new(congestion))
        .max_concurrent_bidi_streams(VarInt::from_u32(MAX_STREAMS))
        .max_concurrent_uni_streams(VarInt::from_u32(0))
        .datagram_receive_buffer_size(None);
    let mut config = server_config(certificate)?;
    config.transport_config(Arc::new(transport));
    Ok(config)
}

async fn run_tcp(
    case: &Case,
    seed: u64,
    limit: Duration,
    loader: &mut Loader<'_>,
) -> anyhow::Result<(End, Traffic)> {
    let clock = VirtualClock::start();
    let [down, up] = [&case.link.down, &case.link.up].map(|direction| under(direction, IP_TCP_BYTES));
    let Opening { client, server, client_ready_ns, server_ready_ns, counters } =
        stream_pipe::open(clock, down, up, seed)?;
    let serving = tokio::spawn(async move {
        clock.sleep_until(server_ready_ns).await;
        answer_tcp(server).await;
    });
    let received = || counters.client_received_bytes();
    let why = if u128::from(client_ready_ns) > limit.as_nanos() {
        "no connection within the time limit".to_owned()
    } else {
        clock.sleep_until(client_ready_ns).await;
        ended(loader.load(over_tcp(client), received).await)
    };
    serving.abort();
    let [down, up] = counters.links();
    let end = End { why, received_bytes: received() };
    Ok((end, Traffic { down, up, trace: counters.trace() }))
}

fn result(
    plan: &Plan,
    case: &Case,
    seed: u64,
    loader: &mut Loader<'_>,
    end: &End,
    traffic: &Traffic,
) -> RunResult {
    let now = loader.now();
    loader.stalls.end(now);
    let ms = |after: Duration| milliseconds(u64::try_from(after.as_nanos()).unwrap_or(u64::MAX));
    let time = |m: Option<Milestone>| m.map(|m| ms(m.after));
    let bytes = |m: Option<Milestone>| m.map(|m| m.bytes);
    let noted = |px: f64| quality(&loader.quality, px);
    let (stalls, stalled_ns) = loader.stalls.found();
    let rest = loader.rest();
    let rest_quality = |px: f64| (error_name(px), quality(&loader.rest_quality, px).map(ms));
    RunResult {
        ttff_ms: time(loader.first_frame),
        first_frame_bytes: bytes(loader.first_frame),
        ttq_ms: plan.ttq_px.iter().map(|&px| (error_name(px), time(noted(px)))).collect(),
        ttq_bytes: plan.ttq_px.iter().map(|&px| (error_name(px), bytes(noted(px)))).collect(),
        total_bytes: bytes(loader.settled).unwrap_or(end.received_bytes),
        settled_ms: time(loader.settled),
        ended_ms: Some(milliseconds(now.as_ns())),
        rest_ms: rest.map(|at| milliseconds(at.as_ns())),
        rest_ttq_ms: rest
            .map_or_else(BTreeMap::new, |_| plan.ttq_px.iter().copied().map(rest_quality).collect()),
        stalls,
        stalled_ms: milliseconds(stalled_ns),
        usage: Use { chunk_bytes: loader.body_bytes, ..Use::default() },
        packets_lost: traffic.down.lost,
        packets_dropped: traffic.down.queue_full,
        packets_lost_up: traffic.up.lost,
        packets_dropped_up: traffic.up.queue_full,
        trace: format!("{:016x}", traffic.trace),
        series: loader.series.samples().to_vec(),
        ..blank(plan, case, seed, &end.why)
    }
}

/// The line of a run in which nothing happened.
fn blank(plan: &Plan, case: &Case, seed: u64, why: &str) -> RunResult {
    let LinkCounters { lost, queue_full, .. } = LinkCounters::default();
    let never = || plan.ttq_px.iter().map(|&px| (error_name(px), None)).collect::<BTreeMap<_, _>>();
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
        ttff_ms: None,
        first_frame_bytes: None,
        ttq_ms: never(),
        ttq_bytes: plan.ttq_px.iter().map(|&px| (error_name(px), None)).collect(),
        total_bytes: 0,
        settled_ms: None,
        ended: why.to_owned(),
        ended_ms: None,
        rest_ms: None,
        rest_ttq_ms: BTreeMap::new(),
        assets: None,
        instances: None,
        applied_faces: None,
        stalls: 0,
        stalled_ms: 0.0,
        usage: Use::default(),
        packets_lost: lost,
        packets_dropped: queue_full,
        packets_lost_up: lost,
        packets_dropped_up: queue_full,
        trace: format!("{:016x}", 0),
        series: Vec::new(),
        pictures: Vec::new(),
    }
}
