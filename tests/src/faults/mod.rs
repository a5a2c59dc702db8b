//! Faults of servers and networks in virtual time: restarted servers, vanished clients, lost and reordered packets,
//! clock jumps, address changes.

mod addresses;
mod links;
mod restart;
mod vanished;

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use futures_util::future::join_all;
use lodestream_client::core::{ClientCore, Config, Progress};
use lodestream_client::net::{
    Clock, End, Host, Pin, QuicConnection, QuicOpenError, Retry, client_config, stream_quic,
};
use lodestream_daemon::{Certificate, ServerState, SessionSettings, serve_quic, server_config};
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use lodestream_netsim::link::{IP_UDP_BYTES, Jitter, LinkSettings, Loss};
use lodestream_netsim::udp::UdpNetwork;
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::source::SceneSource as _;
use lodestream_protocol::time::Time;
use lodestream_scene::{BlobId, BlobPart};
use tokio::time::{Instant, sleep, timeout};

use crate::support::scene::TestScene;
use crate::support::viewer::config;
use crate::support::virtual_link::SERVER;

const RATE_BITS_PER_S: u64 = 2_000_000;
const RTT_MS: u64 = 50;
/// Virtual time limit of a connection attempt.
const ATTEMPT: Duration = Duration::from_secs(4);
/// Virtual time limit of a test, including a clock jump of an hour.
const TIMEOUT: Duration = Duration::from_secs(7200);

fn client(n: u8, port: u16) -> SocketAddr {
    SocketAddr::new(IpAddr::V4(Ipv4Addr::new(10, 0, 1, n)), port)
}

fn link() -> LinkSettings {
    let rate = NonZeroU64::new(RATE_BITS_PER_S).unwrap();
    LinkSettings::constant(rate, RTT_MS * 1_000_000 / 2, 256 * 1024, IP_UDP_BYTES)
}

/// A network with one server's address.
struct TestNetwork {
    udp: UdpNetwork,
    certificate: Certificate,
}

impl TestNetwork {
    fn new() -> Self {
        Self {
            udp: UdpNetwork::new(VirtualClock::start()),
            certificate: Certificate::self_signed(SystemTime::now()).unwrap(),
        }
    }

    /// Starts a server; aborting the task kills it.
    fn serve(&self, state: Arc<ServerState>, seed: u8) -> tokio::task::JoinHandle<()> {
        let config = server_config(&self.certificate).unwrap();
        let endpoint = self.udp.endpoint(SERVER, Some(config), [seed; 32]).unwrap();
        tokio::spawn(serve_quic(endpoint, state))
    }

    fn connect(&self, client: SocketAddr, settings: &LinkSettings) {
        let seed = u64::from(client.port());
        self.udp.connect(SERVER, client, settings.clone(), seed);
        self.udp.connect(client, SERVER, settings.clone(), seed + 1);
    }

    fn client(&self, address: SocketAddr, settings: &LinkSettings) -> quinn::Endpoint {
        self.connect(address, settings);
        let [.., last] = address.port().to_be_bytes();
        let mut endpoint = self.udp.endpoint(address, None, [last; 32]).unwrap();
        let pin = Pin::Certificate(self.certificate.fingerprint());
        endpoint.set_default_client_config(client_config(pin).unwrap());
        endpoint
    }
}

async fn open(endpoint: &quinn::Endpoint) -> Result<QuicConnection, Close> {
    let connecting = endpoint.connect(SERVER, "localhost").unwrap();
    QuicConnection::open(connecting, ATTEMPT).await.map_err(|why| match why {
        QuicOpenError::Timeout => Close::new(CloseCode::Lost, "the server does not answer"),
        QuicOpenError::Handshake(why) => Close::new(CloseCode::Lost, why.to_string()),
    })
}

fn settings(rate_bits_per_s: Option<u64>) -> SessionSettings {
    SessionSettings { rate_bits_per_s, ..SessionSettings::default() }
}

/// A client that leaves when it is settled.
struct UntilSettled {
    core: ClientCore,
    settled: bool,
    /// Bytes received of each blob when the first connection was lost.
    held: Option<BTreeMap<BlobId, u64>>,
}

impl UntilSettled {
    fn new() -> Self {
        let config = Config { track_received: true, ..config() };
        Self { core: ClientCore::new(config), settled: false, held: None }
    }

    /// Bytes received of each blob so far, including repetitions.
    fn received(&self) -> BTreeMap<BlobId, u64> {
        self.core.received().iter().map(|(id, received)| (*id, received.bytes)).collect()
    }
}

impl Host for UntilSettled {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        let progress = self.core.update(now, u64::MAX);
        // Takes changes as a renderer would.
        self.core.take_changes(now, usize::MAX);
        if self.held.is_none() && self.core.closed().is_some() {
            self.held = Some(self.received());
        }
        self.settled |= self.core.is_settled();
        progress
    }

    fn wants_to_leave(&self) -> bool {
        self.settled
    }
}

/// Streams until settled; returns the times of the connection attempts.
async fn stream(endpoint: &quinn::Endpoint, host: &mut UntilSettled) -> Vec<Instant> {
    let mut attempts = Vec::new();
    let connect = async || {
        attempts.push(Instant::now());
        open(endpoint).await
    };
    let retry = Retry { first_attempts: 3, first_within: Duration::MAX, reconnect: true };
    let streaming = stream_quic("the server", connect, host, Clock::start(), retry, |_, _| {});
    let end = timeout(TIMEOUT, streaming).await.expect("the picture does not settle");
    assert_eq!(end, End::Left);
    attempts
}

fn length(scene: &TestScene, id: &BlobId) -> u64 {
    scene.store.blob_len(id).map_or(0, u64::from)
}

/// Blobs received more than once, at least in part, with the excess bytes.
fn sent_twice(scene: &TestScene, received: &BTreeMap<BlobId, u64>) -> BTreeMap<BlobId, u64> {
    assert!(!received.is_empty(), "nothing was noted");
    let more = received.iter().map(|(id, bytes)| (*id, bytes.saturating_sub(length(scene, id))));
    more.filter(|(_, bytes)| *bytes > 0).collect()
}

/// A link without throughput, as to a machine that is gone.
fn cut() -> LinkSettings {
    LinkSettings { loss: Loss::Random(1.0), ..link() }
}

fn is_chunk(id: &BlobId) -> bool {
    matches!(id.part(), Some(BlobPart::Chunk(_)))
}

/// Whether a server may push a blob before it knows the client's inventory.
fn is_pushed(id: &BlobId) -> bool {
    matches!(id.part(), Some(BlobPart::Base | BlobPart::Texture { level: 0, .. }))
}
