//! One run of a baseline: a case and a seed, on its own runtime and network.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use lodestream_client::net::{self, Pin};
use lodestream_daemon::{Certificate, bounded_queue, server_config};
use lodestream_netsim::clock::virtual_runtime;
use quinn::VarInt;
use tokio::time::timeout;

use super::library::{Content, Entry};
use super::loader::Loader;
use super::wire::{answer_quic, answer_tcp, over_quic, over_tcp};
use crate::ledger::Use;
use crate::network::{QuicNetwork, SERVER, TcpNetwork, Traffic};
use crate::outcome::{self, ClientMilestones, after_ms};
use crate::plan::{Case, Plan, Transport};
use crate::result::RunResult;
use crate::timeline::milliseconds;

/// Concurrent requests that the server accepts: more than any technique has in flight.
const MAX_STREAMS: u32 = 64;

/// Why a run ended, and the bytes received until then.
struct End {
    why: String,
    received_bytes: u64,
}

/// Runs a case with a seed.
///
/// # Errors
/// A network, endpoint or runtime that cannot be set up.
pub(crate) fn run_case(
    plan: &Plan,
    case: &Case,
    entry: &Entry,
    certificate: &Certificate,
    seed: u64,
) -> anyhow::Result<RunResult> {
    let content = match entry {
        Entry::Ready(content) => content,
        Entry::NotRun(why) => {
            return Ok(RunResult::nothing(plan, case, seed, why));
        }
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
    let config = file_server_config(certificate)?;
    let QuicNetwork { network, server, client } = QuicNetwork::open(&case.link, config, seed)?;
    let serving = tokio::spawn(answer_quic(server));
    let config = net::client_config(Pin::Certificate(certificate.fingerprint()))?;
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
    let traffic = Traffic::over_udp(&network);
    serving.abort();
    Ok((end, traffic))
}

/// The project's certificate and congestion control, streams for requests, otherwise quinn's defaults.
fn file_server_config(certificate: &Certificate) -> anyhow::Result<quinn::ServerConfig> {
    let mut transport = quinn::TransportConfig::default();
    transport
        .congestion_controller_factory(bounded_queue())
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
    let TcpNetwork { client, in_time, serving, counters } =
        TcpNetwork::open(&case.link, seed, limit, answer_tcp).await?;
    let received = || counters.client_received_bytes();
    let why = if in_time {
        ended(loader.load(over_tcp(client), received).await)
    } else {
        "no connection within the time limit".to_owned()
    };
    serving.abort();
    let end = End { why, received_bytes: received() };
    Ok((end, Traffic::over_tcp(&counters)))
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
    let noted = ClientMilestones {
        first_frame: loader.first_frame,
        quality: loader.quality,
        unoccluded_quality: Default::default(),
        rest: loader.rest(),
        rest_quality: loader.rest_quality,
        rest_unoccluded_quality: Default::default(),
        stalls: loader.stalls,
    };
    RunResult {
        total_bytes: loader.settled.map_or(end.received_bytes, |settled| settled.bytes),
        settled_ms: loader.settled.map(|settled| after_ms(settled.after)),
        ended_ms: Some(milliseconds(now.as_ns())),
        usage: Use { chunk_bytes: loader.body_bytes, ..Use::default() },
        series: loader.series.samples().to_vec(),
        ..outcome::line(plan, case, seed, &end.why, &noted, traffic)
    }
}
