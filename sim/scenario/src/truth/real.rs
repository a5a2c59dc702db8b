//! A case of a plan in real time: the shipped daemon, a relay in place of the link, and the simulator's client.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::mpsc;
use std::time::{Duration, SystemTime};

use anyhow::Context as _;
use lodestream_client::net::{self, Address, Pin, Scheme};
use lodestream_daemon::{Certificate, Daemon, DaemonOptions, SessionSettings};
use lodestream_netsim::link::{IP_UDP_BYTES, LinkCounters};
use lodestream_netsim::tcp::IP_TCP_BYTES;
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::source::SceneSource;
use rand::{RngCore, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tokio::net::TcpStream;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;
use tokio::time::timeout;

use super::relay_tcp::TcpRelay;
use super::relay_udp::UdpRelay;
use crate::network::{Traffic, end_of, under};
use crate::outcome;
use crate::plan::{Case, Plan, Transport};
use crate::result::RunResult;
use crate::viewer::Viewer;

/// Time that daemon and relay may take to stop.
const STOP_TIMEOUT: Duration = Duration::from_secs(10);

/// A case's server and link in real time, for any client.
pub struct RealLink {
    server: Server,
    relay: Relay,
    scheme: Scheme,
}

impl RealLink {
    /// Serves the scene over the case's link.
    ///
    /// # Errors
    /// Sockets and folders that the system refuses.
    pub fn start(case: &Case, scene: &Arc<dyn SceneSource>, seed: u64) -> anyhow::Result<Self> {
        let server = Server::start(case, scene)?;
        let relay = Relay::start(case, &server, seed)?;
        let scheme = match case.transport {
            Transport::Quic => Scheme::Quic,
            Transport::Ws => Scheme::WebSocket,
        };
        Ok(Self { server, relay, scheme })
    }

    /// The address for a client.
    #[must_use]
    pub fn address(&self) -> Address {
        Address {
            scheme: self.scheme,
            host: self.relay.address.ip().to_string(),
            port: self.relay.address.port(),
            scene: String::new(),
            pin: (self.scheme == Scheme::Quic).then_some(Pin::Certificate(self.server.fingerprint)),
        }
    }

    /// Stops daemon and relay.
    ///
    /// # Errors
    /// Errors of the relay.
    pub fn stop(self) -> anyhow::Result<()> {
        self.relay.stop()?;
        self.server.stop();
        Ok(())
    }
}

/// Runs a case; takes the real time of its session.
pub(super) fn run_case(
    plan: &Plan,
    case: &Case,
    scene: &Arc<dyn SceneSource>,
    seed: u64,
) -> anyhow::Result<RunResult> {
    let server = Server::start(case, scene)?;
    let relay = Relay::start(case, &server, seed)?;
    let limit = Duration::from_secs_f64(case.time_limit_s);
    let (viewer, close) = client_runtime()?.block_on(async {
        let mut viewer = Viewer::in_real_time(plan.viewport_px, plan.client, case.path, limit);
        let close = match case.transport {
            Transport::Quic => over_quic(&relay, &server, limit, &mut viewer).await?,
            Transport::Ws => over_websocket(&relay, limit, &mut viewer).await?,
        };
        viewer.end();
        anyhow::Ok((viewer, close))
    })?;
    let [down, up] = relay.stop()?;
    server.stop();
    let mut viewer = viewer;
    if viewer.settled().is_none() && !viewer.timed_out() {
        anyhow::bail!("in real time, the session of {case} ended early: {close}");
    }
    Ok(outcome::result(plan, case, seed, &mut viewer, &close, &Traffic { down, up, trace: 0 }))
}

fn client_runtime() -> anyhow::Result<Runtime> {
    Builder::new_current_thread().enable_all().build().context("no runtime for the client")
}

async fn over_quic(
    relay: &Relay,
    server: &Server,
    limit: Duration,
    viewer: &mut Viewer<'_>,
) -> anyhow::Result<Close> {
    let config = net::client_config(Pin::Certificate(server.fingerprint))?;
    let endpoint = net::endpoint(relay.address, config)?;
    let connecting = endpoint.connect(relay.address, "localhost")?;
    let close = match timeout(limit, connecting).await {
        Ok(Ok(connection)) => {
            let clock = viewer.clock();
            end_of(net::run_quic(connection, viewer, clock), limit).await
        }
        Ok(Err(why)) => Close::new(CloseCode::Lost, format!("no connection: {why}")),
        Err(_) => Close::new(CloseCode::Lost, "no connection within the time limit"),
    };
    let _ = timeout(STOP_TIMEOUT, endpoint.wait_idle()).await;
    Ok(close)
}

async fn over_websocket(relay: &Relay, limit: Duration, viewer: &mut Viewer<'_>) -> anyhow::Result<Close> {
    let stream = TcpStream::connect(relay.address).await.context("the relay cannot be reached")?;
    stream.set_nodelay(true)?;
    let clock = viewer.clock();
    let host = relay.address.to_string();
    let session = async {
        match net::WebSocketConnection::open(stream, &host, limit).await {
            Ok(connection) => net::run_websocket(connection, viewer, clock).await,
            Err(why) => why,
        }
    };
    Ok(end_of(session, limit).await)
}

/// The shipped daemon on its own threads.
struct Server {
    runtime: Runtime,
    stop: tokio::sync::mpsc::Sender<()>,
    quic: SocketAddr,
    http: SocketAddr,
    fingerprint: [u8; 32],
    /// Folder of the certificate.
    _folder: tempfile::TempDir,
}

impl Server {
    fn start(case: &Case, scene: &Arc<dyn SceneSource>) -> anyhow::Result<Self> {
        let folder = tempfile::tempdir().context("no folder for the certificate")?;
        let certificate = Certificate::load_or_create(folder.path(), SystemTime::now())?;
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let sessions =
            SessionSettings { rate_bits_per_s: case.limiter_bits_per_s, ..SessionSettings::default() };
        let options = DaemonOptions {
            listen: Some(any),
            http: Some(any),
            sessions,
            ..DaemonOptions::new(folder.path())
        };
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let daemon = runtime.block_on(Daemon::bind(options, Arc::clone(scene)))?;
        let quic = daemon.quic_address().context("the daemon has no QUIC address")?;
        let http = daemon.http_address().context("the daemon has no HTTP address")?;
        let (stop, stopped) = tokio::sync::mpsc::channel(2);
        runtime.spawn(daemon.serve(stopped));
        Ok(Self { runtime, stop, quic, http, fingerprint: certificate.fingerprint(), _folder: folder })
    }

    fn stop(self) {
        // The second request stops it at once.
        let _ = self.stop.try_send(());
        let _ = self.stop.try_send(());
        self.runtime.shutdown_timeout(STOP_TIMEOUT);
    }
}

/// The relay on its own thread.
struct Relay {
    address: SocketAddr,
    stop: oneshot::Sender<()>,
    thread: std::thread::JoinHandle<anyhow::Result<[LinkCounters; 2]>>,
}

impl Relay {
    fn start(case: &Case, server: &Server, seed: u64) -> anyhow::Result<Self> {
        let (ready, addressed) = mpsc::sync_channel(1);
        let (stop, stopped) = oneshot::channel();
        let mut seeds = Pcg64Mcg::seed_from_u64(seed);
        let seeds = [seeds.next_u64(), seeds.next_u64()];
        let links = |overhead| [under(&case.link.down, overhead), under(&case.link.up, overhead)];
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let thread = match case.transport {
            Transport::Quic => {
                let (links, server) = (links(IP_UDP_BYTES), server.quic);
                std::thread::spawn(move || {
                    runtime.block_on(async {
                        let relay = UdpRelay::bind(server, links, seeds).await?;
                        let _ = ready.send(relay.address()?);
                        Ok(relay.run(stopped).await)
                    })
                })
            }
            Transport::Ws => {
                let (links, server) = (links(IP_TCP_BYTES), server.http);
                std::thread::spawn(move || {
                    runtime.block_on(async {
                        let relay = TcpRelay::bind(server, links, seed)?;
                        let _ = ready.send(relay.address()?);
                        tokio::select! {
                            biased;
                            result = relay.run() => result?,
                            _ = stopped => {}
                        }
                        // The counters of its links stay inside the modelled connection.
                        Ok([LinkCounters::default(); 2])
                    })
                })
            }
        };
        match addressed.recv() {
            Ok(address) => Ok(Self { address, stop, thread }),
            Err(_) => match thread.join() {
                Ok(Err(why)) => Err(why.context("the relay cannot be started")),
                _ => anyhow::bail!("the relay ended before it began"),
            },
        }
    }

    fn stop(self) -> anyhow::Result<[LinkCounters; 2]> {
        let _ = self.stop.send(());
        self.thread.join().map_err(|_| anyhow::anyhow!("the relay failed"))?
    }
}
