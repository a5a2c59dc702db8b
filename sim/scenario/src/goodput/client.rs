//! The minimal client over a simulated link.

use std::sync::Arc;

use anyhow::Context as _;
use lodestream_client::net::{Pin, client_config};
use lodestream_daemon::{Certificate, ServerState, accept_http, serve_quic, server_config};
use lodestream_netsim::clock::VirtualClock;
use lodestream_netsim::link::{IP_UDP_BYTES, LinkCounters};
use lodestream_netsim::stream_pipe::{self, Opening, StreamCounters};
use lodestream_netsim::tcp::IP_TCP_BYTES;
use lodestream_netsim::udp::UdpNetwork;
use lodestream_scene::BlobId;
use lodestream_select::Priority;

use super::case::Case;
use crate::bare_client::{Arrival, BareClient};
use crate::network::{CLIENT, SERVER, under};
use crate::plan::Transport;

/// Access to the link's counters.
enum Network {
    Udp(UdpNetwork),
    Tcp(StreamCounters),
}

/// A connected client.
pub(super) struct Client {
    pub(super) clock: VirtualClock,
    network: Network,
    bare: BareClient,
}

impl Client {
    /// Connects over the case's link and sends `Hello`.
    pub(super) async fn connect(
        case: &Case,
        clock: VirtualClock,
        state: &Arc<ServerState>,
        certificate: &Certificate,
    ) -> anyhow::Result<Self> {
        let (bare, network) = match case.transport {
            Transport::Quic => over_quic(case, clock, state, certificate).await?,
            Transport::Ws => over_websocket(case, clock, state).await?,
        };
        bare.hello().await?;
        Ok(Self { clock, network, bare })
    }

    /// Requests blobs.
    pub(super) async fn want(&self, ids: &[BlobId], priority: Priority) -> anyhow::Result<()> {
        self.bare.want(ids, priority).await
    }

    /// The next bytes that arrive. Cancel-safe.
    pub(super) async fn next(&mut self) -> anyhow::Result<Arrival> {
        self.bare.next().await.context("the connection was lost")
    }

    /// Counters of the link to the client. Packets count as soon as they are sent.
    pub(super) fn downlink(&self) -> LinkCounters {
        match &self.network {
            Network::Udp(network) => network.counters(SERVER, CLIENT),
            Network::Tcp(counters) => counters.links()[0],
        }
    }

    /// Bytes of the packets that the client has received, headers included; their number is estimated from the mean
    /// length of all packets so far.
    pub(super) fn wire_bytes(&self) -> f64 {
        let (received, overhead_bytes) = match &self.network {
            Network::Udp(network) => (network.received_bytes(CLIENT), IP_UDP_BYTES),
            Network::Tcp(counters) => (counters.client_received_bytes(), IP_TCP_BYTES),
        };
        let link = self.downlink();
        let per_byte = link.arrived as f64 / link.arrived_payload_bytes.max(1) as f64;
        received as f64 * (1.0 + per_byte * f64::from(overhead_bytes))
    }
}

async fn over_quic(
    case: &Case,
    clock: VirtualClock,
    state: &Arc<ServerState>,
    certificate: &Certificate,
) -> anyhow::Result<(BareClient, Network)> {
    let network = UdpNetwork::new(clock);
    let link = under(&case.link(), IP_UDP_BYTES);
    network.connect(SERVER, CLIENT, link.clone(), 1);
    network.connect(CLIENT, SERVER, link, 2);
    let server = network.endpoint(SERVER, Some(server_config(certificate)?), [1; 32])?;
    let client = network.endpoint(CLIENT, None, [2; 32])?;
    tokio::spawn(serve_quic(server, Arc::clone(state)));
    let config = client_config(Pin::Certificate(certificate.fingerprint()))?;
    let connection = client.connect_with(config, SERVER, "localhost")?.await?;
    Ok((BareClient::over_quic(client, connection, clock).await?, Network::Udp(network)))
}

async fn over_websocket(
    case: &Case,
    clock: VirtualClock,
    state: &Arc<ServerState>,
) -> anyhow::Result<(BareClient, Network)> {
    let link = under(&case.link(), IP_TCP_BYTES);
    let Opening { client, server, client_ready_ns, server_ready_ns, counters } =
        stream_pipe::open(clock, link.clone(), link, 1)?;
    let state = Arc::clone(state);
    tokio::spawn(async move {
        clock.sleep_until(server_ready_ns).await;
        accept_http(server, state, CLIENT).await;
    });
    clock.sleep_until(client_ready_ns).await;
    let bare = BareClient::over_websocket(client, &SERVER.to_string(), clock).await?;
    Ok((bare, Network::Tcp(counters)))
}
