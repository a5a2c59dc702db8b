//! A daemon's connection handlers and a client over a simulated link, in virtual time.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::SystemTime;

use lodestream_client::net::{Pin, client_config};
use lodestream_daemon::{Certificate, ServerState, accept_http, serve_quic, server_config};
use lodestream_netsim::clock::VirtualClock;
use lodestream_netsim::link::{IP_UDP_BYTES, LinkCounters, LinkSettings, Rate};
use lodestream_netsim::stream_pipe::{self, Opening, StreamCounters, StreamEnd};
use lodestream_netsim::tcp::IP_TCP_BYTES;
use lodestream_netsim::udp::UdpNetwork;

pub(crate) const SERVER: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1)), 4433);
const CLIENT: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 2)), 50_000);

/// A rate that drops to zero after some time, for the rest of a test.
pub(crate) fn cut_after(cut_ms: u64, rate_bits_per_s: u64) -> Rate {
    let cut_ns = cut_ms * 1_000_000;
    Rate::steps(&[(0, rate_bits_per_s), (cut_ns, 0), (cut_ns + 3_600_000_000_000, 1)]).unwrap()
}

fn link(rate_bits_per_s: u64, rtt_ms: u64, overhead_bytes: u32) -> LinkSettings {
    LinkSettings::constant(
        NonZeroU64::new(rate_bits_per_s).unwrap(),
        rtt_ms * 1_000_000 / 2,
        256 * 1024,
        overhead_bytes,
    )
}

/// Bytes on the wire, headers included.
fn wire_bytes(counters: LinkCounters, overhead_bytes: u32) -> u64 {
    counters.arrived_payload_bytes + counters.arrived * u64::from(overhead_bytes)
}

/// A network with a daemon's QUIC listener on it.
pub(crate) struct QuicLink {
    network: UdpNetwork,
    client: quinn::Endpoint,
    pin: Pin,
}

impl QuicLink {
    pub(crate) fn new(state: Arc<ServerState>, rate_bits_per_s: u64, rtt_ms: u64) -> Self {
        Self::over(state, link(rate_bits_per_s, rtt_ms, IP_UDP_BYTES))
    }

    /// The same with a rate that may vary.
    pub(crate) fn with_rate(state: Arc<ServerState>, rate: Rate, rtt_ms: u64) -> Self {
        Self::over(state, LinkSettings { rate, ..link(1, rtt_ms, IP_UDP_BYTES) })
    }

    fn over(state: Arc<ServerState>, settings: LinkSettings) -> Self {
        let network = UdpNetwork::new(VirtualClock::start());
        network.connect(SERVER, CLIENT, settings.clone(), 1);
        network.connect(CLIENT, SERVER, settings, 2);
        let endpoint = |address, config, seed| {
            let mut settings = quinn::EndpointConfig::default();
            settings.rng_seed(Some([seed; 32]));
            let runtime = Arc::new(quinn::TokioRuntime);
            quinn::Endpoint::new_with_abstract_socket(settings, config, network.socket(address), runtime)
                .unwrap()
        };
        let certificate = Certificate::self_signed(SystemTime::now()).unwrap();
        let server = endpoint(SERVER, Some(server_config(&certificate).unwrap()), 1);
        let client = endpoint(CLIENT, None, 2);
        tokio::spawn(serve_quic(server, state));
        Self { network, client, pin: Pin::Certificate(certificate.fingerprint()) }
    }

    /// Opens a connection.
    pub(crate) async fn connect(&self) -> quinn::Connection {
        let config = client_config(self.pin).unwrap();
        self.client.connect_with(config, SERVER, "localhost").unwrap().await.unwrap()
    }

    /// Bytes on the wire from server to client so far.
    pub(crate) fn wire_bytes(&self) -> u64 {
        wire_bytes(self.network.counters(SERVER, CLIENT), IP_UDP_BYTES)
    }
}

/// Counter of bytes on a TCP connection's wire.
pub(crate) struct TcpWire(StreamCounters);

impl TcpWire {
    /// Bytes from server to client so far.
    pub(crate) fn wire_bytes(&self) -> u64 {
        wire_bytes(self.0.links()[0], IP_TCP_BYTES)
    }
}

/// Opens a TCP connection to a daemon's HTTP listener.
pub(crate) async fn tcp_connect(
    state: Arc<ServerState>,
    rate_bits_per_s: u64,
    rtt_ms: u64,
) -> (StreamEnd, TcpWire) {
    tcp_over(state, link(rate_bits_per_s, rtt_ms, IP_TCP_BYTES)).await
}

/// The same with a rate that may vary.
pub(crate) async fn tcp_with_rate(state: Arc<ServerState>, rate: Rate, rtt_ms: u64) -> (StreamEnd, TcpWire) {
    tcp_over(state, LinkSettings { rate, ..link(1, rtt_ms, IP_TCP_BYTES) }).await
}

async fn tcp_over(state: Arc<ServerState>, settings: LinkSettings) -> (StreamEnd, TcpWire) {
    let clock = VirtualClock::start();
    let Opening { client, server, client_ready_ns, server_ready_ns, counters } =
        stream_pipe::open(clock, settings.clone(), settings, 1).unwrap();
    tokio::spawn(async move {
        clock.sleep_until(server_ready_ns).await;
        accept_http(server, state, CLIENT).await;
    });
    clock.sleep_until(client_ready_ns).await;
    (client, TcpWire(counters))
}
