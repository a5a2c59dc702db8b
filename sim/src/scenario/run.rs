//! Runs the cases of a plan, one after the other, each on a runtime and network of its own.
//!
//! What runs is what is shipped: the server's connection handlers and the client's network code and
//! core, over quinn or over WebSocket and HTTP. Simulated are the link ([`crate::udp`],
//! [`crate::stream_pipe`]) and the clock. Selecting, decoding, applying and reading packs happen for
//! real, but take no virtual time; drawing does not happen, and textures count as soon as they arrive.
//! The server's limiter is off unless the plan sets it: the link is what limits.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::Context as _;
use lodestream_client::core::{Milestone, QUALITIES_PX};
use lodestream_client::net::{self, Pin};
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::source::SceneSource;
use lodestream_server::daemon::certificate::Certificate;
use lodestream_server::daemon::http::accept_http;
use lodestream_server::daemon::quic::{serve_quic, server_config};
use lodestream_server::daemon::{ServerState, SessionSettings};
use rand::{RngCore, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tokio::time::timeout;

use super::plan::{Case, Plan, Transport};
use super::report::{RunResult, error_name, milliseconds};
use super::viewer::Viewer;
use crate::clock::{VirtualClock, virtual_runtime};
use crate::link::{IP_UDP_BYTES, LinkCounters, LinkSettings, Loss};
use crate::stream_pipe::{self, Opening};
use crate::tcp::IP_TCP_BYTES;
use crate::udp::UdpNetwork;

const SERVER: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1)), 4433);
const CLIENT: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 2)), 50_000);

/// Virtual time that the server may take to close after the client has left.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(60);

/// What the network saw of a run.
struct Traffic {
    down: LinkCounters,
    trace: u64,
}

/// Runs all cases of a plan. `report` is told of each result as it comes.
///
/// # Errors
/// A session that ends for another reason than that the picture is settled or the time is up.
pub fn run(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    seed: u64,
    mut report: impl FnMut(&RunResult),
) -> anyhow::Result<Vec<RunResult>> {
    let certificate = certificate()?;
    let mut results = Vec::with_capacity(plan.cases.len());
    for (number, case) in plan.cases.iter().enumerate() {
        let result = run_case(plan, case, scene, &certificate, seed)
            .with_context(|| format!("run {} of {} ({case})", number + 1, plan.cases.len()))?;
        report(&result);
        results.push(result);
    }
    Ok(results)
}

/// A certificate whose length is always the same: its serial number is random, and one in 128 is a byte
/// shorter than the others. Time of day and key matter to no byte count.
pub(crate) fn certificate() -> anyhow::Result<Certificate> {
    let mut longest: Option<Certificate> = None;
    for _ in 0..8 {
        let next = Certificate::self_signed(SystemTime::now())?;
        let length = |c: &Certificate| c.chain().first().map_or(0, |der| der.len());
        if longest.as_ref().is_none_or(|c| length(c) < length(&next)) {
            longest = Some(next);
        }
    }
    longest.context("no certificate could be made")
}

fn run_case(
    plan: &Plan,
    case: &Case,
    scene: &Arc<dyn SceneSource>,
    certificate: &Certificate,
    seed: u64,
) -> anyhow::Result<RunResult> {
    virtual_runtime().context("no runtime for virtual time")?.block_on(async {
        let state = ServerState::new(
            Arc::clone(scene),
            SessionSettings { rate_bits_per_s: case.limiter_bits_per_s(), ..SessionSettings::default() },
        );
        let target_px = plan.ttq_px.iter().copied().fold(f64::INFINITY, f64::min);
        let limit = Duration::from_secs_f64(plan.time_limit_s);
        let mut viewer = Viewer::new(plan.viewport_px, target_px as f32, limit);
        let (close, traffic) = match case.transport {
            Transport::Quic => run_quic(case, state, certificate, seed, limit, &mut viewer).await?,
            Transport::Ws => run_websocket(case, state, &mut viewer).await?,
        };
        if viewer.settled().is_none() && !viewer.gave_up() && close.code != CloseCode::Lost {
            anyhow::bail!("the session ended early: {close}");
        }
        Ok(result(plan, case, seed, &mut viewer, &close, &traffic))
    })
}

/// One direction of the link of a case.
fn link(case: &Case, overhead_bytes: u32) -> LinkSettings {
    let (rate, delay_ns) = (case.rate_bits_per_s, case.delay_ns());
    LinkSettings {
        loss: Loss::Random(case.loss),
        ..LinkSettings::constant(rate, delay_ns, case.queue_bytes, overhead_bytes)
    }
}

async fn run_quic(
    case: &Case,
    state: Arc<ServerState>,
    certificate: &Certificate,
    seed: u64,
    limit: Duration,
    viewer: &mut Viewer,
) -> anyhow::Result<(Close, Traffic)> {
    let mut seeds = Pcg64Mcg::seed_from_u64(seed);
    let network = UdpNetwork::new(VirtualClock::start());
    network.connect(SERVER, CLIENT, link(case, IP_UDP_BYTES), seeds.next_u64());
    network.connect(CLIENT, SERVER, link(case, IP_UDP_BYTES), seeds.next_u64());
    let mut next_seed = || {
        let mut seed = [0; 32];
        seeds.fill_bytes(&mut seed);
        seed
    };
    let server = network.endpoint(SERVER, Some(server_config(certificate)?), next_seed())?;
    let client = network.endpoint(CLIENT, None, next_seed())?;
    let serving = tokio::spawn(serve_quic(server, Arc::clone(&state)));

    let config = net::client_config(Pin(certificate.fingerprint()))?;
    // The name is not looked at: the certificate is pinned.
    let connecting = client.connect_with(config, SERVER, "localhost")?;
    let close = match timeout(limit, connecting).await {
        Ok(Ok(connection)) => {
            let clock = viewer.clock();
            net::run_quic(connection, viewer, clock).await
        }
        Ok(Err(why)) => Close::new(CloseCode::Lost, why.to_string()),
        Err(_) => Close::new(CloseCode::Lost, "the server cannot be reached"),
    };
    let traffic = Traffic { down: network.counters(SERVER, CLIENT), trace: network.trace() };
    state.stop();
    let _ = timeout(CLOSE_TIMEOUT, serving).await;
    Ok((close, traffic))
}

async fn run_websocket(
    case: &Case,
    state: Arc<ServerState>,
    viewer: &mut Viewer,
) -> anyhow::Result<(Close, Traffic)> {
    let clock = VirtualClock::start();
    let Opening { client, server, client_ready_ns, server_ready_ns, counters } =
        stream_pipe::open(clock, link(case, IP_TCP_BYTES), link(case, IP_TCP_BYTES))?;
    let served = Arc::clone(&state);
    let serving = tokio::spawn(async move {
        clock.sleep_until(server_ready_ns).await;
        accept_http(server, served, CLIENT).await;
    });
    clock.sleep_until(client_ready_ns).await;
    let client_clock = viewer.clock();
    let close = net::run_websocket(client, &SERVER.to_string(), viewer, client_clock).await;
    let traffic = Traffic { down: counters.links()[0], trace: counters.trace() };
    state.stop();
    let _ = timeout(CLOSE_TIMEOUT, serving).await;
    Ok((close, traffic))
}

fn result(
    plan: &Plan,
    case: &Case,
    seed: u64,
    viewer: &mut Viewer,
    close: &Close,
    traffic: &Traffic,
) -> RunResult {
    let settled = viewer.settled();
    let gave_up = viewer.gave_up();
    let stats = net::Host::core(viewer).stats();
    let quality = |px: f64| {
        let index = QUALITIES_PX.iter().position(|q| *q == px);
        index.and_then(|i| stats.milestones.quality[i])
    };
    let ms = |after: Duration| milliseconds(u64::try_from(after.as_nanos()).unwrap_or(u64::MAX));
    let time = |m: Option<Milestone>| m.map(|m| ms(m.after));
    let bytes = |m: Option<Milestone>| m.map(|m| m.bytes);
    let first = stats.milestones.first_frame;
    RunResult {
        scene: plan.scene_name.clone(),
        transport: case.transport,
        rate_bits_per_s: case.rate_bits_per_s.get(),
        rtt_ms: case.rtt_ms,
        loss: case.loss,
        queue_bytes: case.queue_bytes,
        limiter_bits_per_s: case.limiter_bits_per_s(),
        seed,
        ttff_ms: time(first),
        first_frame_bytes: bytes(first),
        ttq_ms: plan.ttq_px.iter().map(|&px| (error_name(px), time(quality(px)))).collect(),
        ttq_bytes: plan.ttq_px.iter().map(|&px| (error_name(px), bytes(quality(px)))).collect(),
        total_bytes: settled.map_or(stats.transport_bytes, |s| s.bytes),
        settled_ms: settled.map(|s| ms(s.after)),
        ended: match (settled, gave_up) {
            (Some(_), _) => "settled".to_owned(),
            (None, true) => "time limit".to_owned(),
            (None, false) => close.reason.clone(),
        },
        packets_lost: traffic.down.lost,
        packets_dropped: traffic.down.queue_full,
        trace: format!("{:016x}", traffic.trace),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{plan, tests::small_scene};
    use super::*;

    #[test]
    fn the_client_counts_the_bytes_that_the_network_delivers() {
        let text = "scene = \"demo-small\"\n[[sweep]]\ntransport = \"quic\"\n\
                    rate_bits_per_s = [2_000_000]\nrtt_ms = [50]\nloss = [0.02]\n[[sweep]]\n\
                    transport = \"ws\"\nrate_bits_per_s = [2_000_000]\nrtt_ms = [50]\n";
        let plan = plan::parse(text, std::path::Path::new("test.toml")).unwrap();
        let certificate = certificate().unwrap();
        for case in &plan.cases {
            let (counted, delivered) = virtual_runtime().unwrap().block_on(async {
                let state = ServerState::new(small_scene(), SessionSettings::default());
                let limit = Duration::from_secs(60);
                let mut viewer = Viewer::new([640, 360], 1.0, limit);
                let (_, traffic) = match case.transport {
                    Transport::Quic => run_quic(case, state, &certificate, 1, limit, &mut viewer).await,
                    Transport::Ws => run_websocket(case, state, &mut viewer).await,
                }
                .unwrap();
                let delivered = traffic.down.arrived_payload_bytes;
                (net::Host::core(&mut viewer).stats().transport_bytes, delivered)
            });
            // A packet or two may still be on its way when the client has left.
            assert!(counted <= delivered && delivered - counted < 5000, "{case}: {counted} of {delivered}");
            assert!(counted > 50_000, "{case}: {counted}");
        }
    }
}
