//! The network of a run: the case's link between the two fixed addresses.
//!
//! Runs of this project and of baselines open it here, so that the same seed loses the same packets in both.

use std::future::Future;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use lodestream_netsim::clock::VirtualClock;
use lodestream_netsim::link::{IP_UDP_BYTES, LinkCounters, LinkSettings};
use lodestream_netsim::stream_pipe::{self, Opening, StreamCounters, StreamEnd};
use lodestream_netsim::tcp::IP_TCP_BYTES;
use lodestream_netsim::udp::UdpNetwork;
use lodestream_protocol::message::{Close, CloseCode};
use rand::{RngCore, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::plan::CaseLink;

pub(crate) const SERVER: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(10, 0, 0, 1)), 4433);
pub(crate) const CLIENT: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::new(10, 0, 0, 2)), 50_000);

/// Virtual time that the server may take to close after the client has left.
pub(super) const CLOSE_TIMEOUT: Duration = Duration::from_secs(60);

/// Virtual time after the time limit in which client and server may close the connection.
const CLOSE_MARGIN: Duration = Duration::from_secs(60);

/// Counters of both directions after a run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Traffic {
    pub(crate) down: LinkCounters,
    pub(crate) up: LinkCounters,
    pub(crate) trace: u64,
}

impl Traffic {
    pub(crate) fn over_udp(network: &UdpNetwork) -> Self {
        let (down, up) = (network.counters(SERVER, CLIENT), network.counters(CLIENT, SERVER));
        Self { down, up, trace: network.trace() }
    }

    pub(crate) fn over_tcp(counters: &StreamCounters) -> Self {
        let [down, up] = counters.links();
        Self { down, up, trace: counters.trace() }
    }
}

/// One direction of a case's link, with the headers of a transport.
pub(crate) fn under(direction: &LinkSettings, overhead_bytes: u32) -> LinkSettings {
    LinkSettings { overhead_bytes, ..direction.clone() }
}

/// A UDP network with a QUIC endpoint at each end of the link.
pub(crate) struct QuicNetwork {
    pub(crate) network: UdpNetwork,
    pub(crate) server: quinn::Endpoint,
    pub(crate) client: quinn::Endpoint,
}

impl QuicNetwork {
    pub(crate) fn open(link: &CaseLink, config: quinn::ServerConfig, seed: u64) -> anyhow::Result<Self> {
        let mut seeds = Pcg64Mcg::seed_from_u64(seed);
        let network = UdpNetwork::new(VirtualClock::start());
        network.connect(SERVER, CLIENT, under(&link.down, IP_UDP_BYTES), seeds.next_u64());
        network.connect(CLIENT, SERVER, under(&link.up, IP_UDP_BYTES), seeds.next_u64());
        let mut next_seed = || {
            let mut seed = [0; 32];
            seeds.fill_bytes(&mut seed);
            seed
        };
        let server = network.endpoint(SERVER, Some(config), next_seed())?;
        let client = network.endpoint(CLIENT, None, next_seed())?;
        Ok(Self { network, server, client })
    }
}

/// A TCP connection over a link.
pub(crate) struct TcpNetwork {
    /// The client's end.
    pub(crate) client: StreamEnd,
    /// Whether it is open now; otherwise the time limit came first.
    pub(crate) in_time: bool,
    /// The task that serves the other end.
    pub(crate) serving: JoinHandle<()>,
    pub(crate) counters: StreamCounters,
}

impl TcpNetwork {
    /// Waits until the client's end is open; `serve` receives the server's end.
    pub(crate) async fn open<F>(
        link: &CaseLink,
        seed: u64,
        limit: Duration,
        serve: impl FnOnce(StreamEnd) -> F + Send + 'static,
    ) -> anyhow::Result<Self>
    where
        F: Future<Output = ()> + Send,
    {
        let clock = VirtualClock::start();
        let [down, up] = [&link.down, &link.up].map(|direction| under(direction, IP_TCP_BYTES));
        let Opening { client, server, client_ready_ns, server_ready_ns, counters } =
            stream_pipe::open(clock, down, up, seed)?;
        let serving = tokio::spawn(async move {
            clock.sleep_until(server_ready_ns).await;
            serve(server).await;
        });
        let in_time = u128::from(client_ready_ns) <= limit.as_nanos();
        if in_time {
            clock.sleep_until(client_ready_ns).await;
        }
        Ok(Self { client, in_time, serving, counters })
    }
}

/// Waits for the end of a session. A session that has not ended some time after the time limit, for example because the
/// server never answers, is cut off.
pub(crate) async fn end_of(session: impl Future<Output = Close>, limit: Duration) -> Close {
    let cut_off = || {
        Close::new(CloseCode::Lost, "the session had not ended a minute after the time limit and was cut off")
    };
    timeout(limit + CLOSE_MARGIN, session).await.unwrap_or_else(|_| cut_off())
}
