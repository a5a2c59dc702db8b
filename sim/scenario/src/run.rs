//! One run: a case of a plan with a seed, on its own runtime and network.
//!
//! The code is the shipped one: the server's connection handlers and the client's network code and core, over quinn or
//! over WebSocket and HTTP. The link ([`lodestream_netsim::udp`], [`lodestream_netsim::stream_pipe`]) and the clock are
//! simulated. Selecting, decoding, applying and reading packs are real but take no virtual time; drawing takes none
//! either, and textures count as soon as they arrive. The server's rate limit is off unless the plan sets it: the link
//! limits the rate.

use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::Context as _;
use lodestream_client::net::{self, QuicConnection, QuicOpenError, WebSocketConnection};
use lodestream_daemon::{Certificate, ServerState, SessionSettings, accept_http, serve_quic};
use lodestream_netsim::clock::virtual_runtime;
use lodestream_netsim::link::LinkSettings;
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::source::SceneSource;
use lodestream_scene::view::View;
use tokio::time::timeout;

use super::network::{CLIENT, CLOSE_TIMEOUT, QuicNetwork, SERVER, TcpNetwork, Traffic, end_of};
use super::observer::Observer;
use super::outcome;
use super::plan::{Case, CaseLink, Plan, Transport};
use super::result::RunResult;
use super::resume::QuicSettings;
use super::static_host;
use super::technique::Technique;
use super::viewer::Viewer;
use super::without_occluders::WithoutOccluders;

/// Rate and queue of the link over which a reference picture is fetched, and its time limit in virtual time.
const REFERENCE_BITS_PER_S: NonZeroU64 = NonZeroU64::new(10_000_000_000).expect("not zero");
const REFERENCE_QUEUE_BYTES: u64 = 64 << 20;
const REFERENCE_LIMIT: Duration = Duration::from_secs(60);

/// A self-signed certificate of constant length: random serial numbers make one certificate in 128 a byte shorter. Time
/// of day and key do not affect byte counts.
///
/// # Errors
/// Errors of the library that generates it.
pub fn certificate() -> anyhow::Result<Certificate> {
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

/// A case of a plan with a seed, and everything that its run needs.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// The plan.
    pub plan: &'a Plan,
    /// One of its cases.
    pub case: &'a Case,
    /// The case's scene.
    pub scene: &'a Arc<dyn SceneSource>,
    /// The server's certificate.
    pub certificate: &'a Certificate,
    /// Seed of packet loss, jitter and the endpoints' random numbers.
    pub seed: u64,
}

impl Run<'_> {
    /// Runs it, with an optional observer. Must not be called within a runtime.
    ///
    /// # Errors
    /// A session that ends otherwise than settled, at the time limit, or with a lost or silent connection.
    pub fn result(&self, observer: Option<&mut dyn Observer>) -> anyhow::Result<RunResult> {
        let Self { plan, case, scene, certificate, seed } = *self;
        let quic = if case.resumed {
            QuicSettings::after_first_session(scene, certificate)
        } else {
            QuicSettings::new(certificate)
        };
        let quic = quic?;
        virtual_runtime().context("no runtime for virtual time")?.block_on(async {
            let settings =
                SessionSettings { rate_bits_per_s: case.limiter_bits_per_s, ..SessionSettings::default() };
            // If the client does not test occlusion, neither does the server.
            let scene = Arc::clone(scene);
            let scene = if plan.client.hidden_last { scene } else { Arc::new(WithoutOccluders(scene)) };
            let state = ServerState::new(scene, settings);
            let limit = Duration::from_secs_f64(case.time_limit_s);
            let mut viewer = Viewer::new(plan.viewport_px, plan.client, case.path, limit, observer);
            let (close, traffic) = match case.transport {
                _ if case.technique == Technique::Published => {
                    static_host::run(case, self.scene.as_ref(), seed, limit, &mut viewer).await?
                }
                Transport::Quic => run_quic(case, state, quic, seed, limit, &mut viewer).await?,
                Transport::Ws => run_websocket(case, state, seed, limit, &mut viewer).await?,
            };
            viewer.end();
            let by_the_link = matches!(close.code, CloseCode::Lost | CloseCode::Timeout);
            if viewer.settled().is_none() && !viewer.timed_out() && !by_the_link {
                anyhow::bail!("the session ended early: {close}");
            }
            Ok(outcome::result(plan, case, seed, &mut viewer, &close, &traffic))
        })
    }

    /// Shows an observer a viewer of the same scene with a fixed camera until it is settled, over a link that takes
    /// almost no time. Must not be called within a runtime.
    ///
    /// # Errors
    /// As [`Run::result`].
    pub fn settle_at(&self, view: View, observer: &mut dyn Observer) -> anyhow::Result<()> {
        let fast = LinkSettings::constant(REFERENCE_BITS_PER_S, 0, REFERENCE_QUEUE_BYTES, 0);
        let link = CaseLink { name: String::new(), down: fast.clone(), up: fast };
        let case = Case {
            transport: Transport::Ws,
            resumed: false,
            link,
            limiter_bits_per_s: None,
            ..self.case.clone()
        };
        virtual_runtime().context("no runtime for virtual time")?.block_on(async {
            let state = ServerState::new(Arc::clone(self.scene), SessionSettings::default());
            let mut viewer = Viewer::at_pose(view, REFERENCE_LIMIT, observer);
            run_websocket(&case, state, 0, REFERENCE_LIMIT, &mut viewer).await?;
            viewer.end();
            Ok(())
        })
    }
}

async fn run_quic(
    case: &Case,
    state: Arc<ServerState>,
    quic: QuicSettings,
    seed: u64,
    limit: Duration,
    viewer: &mut Viewer<'_>,
) -> anyhow::Result<(Close, Traffic)> {
    let QuicNetwork { network, server, client } = QuicNetwork::open(&case.link, quic.server, seed)?;
    let serving = tokio::spawn(serve_quic(server, Arc::clone(&state)));

    // The name is not checked: the certificate is pinned.
    let connecting = client.connect_with(quic.client, SERVER, "localhost")?;
    let close = match QuicConnection::open(connecting, limit).await {
        Ok(connection) => {
            anyhow::ensure!(connection.is_early() == case.resumed, "the first session brought no ticket");
            let clock = viewer.clock();
            end_of(net::run_quic(connection, viewer, clock), limit).await
        }
        Err(QuicOpenError::Timeout) => Close::new(CloseCode::Lost, "no connection within the time limit"),
        Err(why) => Close::new(CloseCode::Lost, format!("no connection: {why}")),
    };
    let traffic = Traffic::over_udp(&network);
    state.stop();
    let _ = timeout(CLOSE_TIMEOUT, serving).await;
    Ok((close, traffic))
}

async fn run_websocket(
    case: &Case,
    state: Arc<ServerState>,
    seed: u64,
    limit: Duration,
    viewer: &mut Viewer<'_>,
) -> anyhow::Result<(Close, Traffic)> {
    let served = Arc::clone(&state);
    let serve = |server| accept_http(server, served, CLIENT);
    let TcpNetwork { client, in_time, serving, counters } =
        TcpNetwork::open(&case.link, seed, limit, serve).await?;
    let close = if in_time {
        let client_clock = viewer.clock();
        let host = SERVER.to_string();
        let session = async {
            match WebSocketConnection::open(client, &host, limit).await {
                Ok(connection) => net::run_websocket(connection, viewer, client_clock).await,
                Err(why) => why,
            }
        };
        end_of(session, limit).await
    } else {
        Close::new(CloseCode::Lost, "no connection within the time limit")
    };
    let traffic = Traffic::over_tcp(&counters);
    state.stop();
    let _ = timeout(CLOSE_TIMEOUT, serving).await;
    Ok((close, traffic))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan;
    use crate::testing::small_scene;

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
                let mut viewer = Viewer::new([640, 360], plan.client, case.path, limit, None);
                let (_, traffic) = match case.transport {
                    Transport::Quic => {
                        let quic = QuicSettings::new(&certificate).unwrap();
                        run_quic(case, state, quic, 1, limit, &mut viewer).await
                    }
                    Transport::Ws => run_websocket(case, state, 1, limit, &mut viewer).await,
                }
                .unwrap();
                let delivered = traffic.down.arrived_payload_bytes;
                (net::Host::core(&mut viewer).stats().transport_bytes, delivered)
            });
            // A packet or two may still be on their way when the client has left.
            assert!(counted <= delivered && delivered - counted < 5000, "{case}: {counted} of {delivered}");
            assert!(counted > 40_000, "{case}: {counted}");
        }
    }
}
