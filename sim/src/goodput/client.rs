//! A client that asks and reads, and does nothing else.

use std::sync::Arc;

use anyhow::Context as _;
use futures_util::{SinkExt as _, StreamExt as _};
use lodestream_client::net::{Pin, client_config};
use lodestream_protocol::BlobId;
use lodestream_protocol::frame::{BlobPiece, Frame, ServerFrame, encode_client};
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_protocol::select::Priority;
use lodestream_protocol::stream::{ALPN, BLOB_STREAM, BlobStreamReader, CONTROL_STREAM};
use lodestream_server::daemon::ServerState;
use lodestream_server::daemon::certificate::Certificate;
use lodestream_server::daemon::http::accept_http;
use lodestream_server::daemon::quic::{serve_quic, server_config};
use tokio::sync::mpsc;
use tokio_tungstenite::client_async;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::http::header::SEC_WEBSOCKET_PROTOCOL;

use super::Case;
use crate::clock::VirtualClock;
use crate::link::{IP_UDP_BYTES, LinkCounters};
use crate::scenario::plan::Transport;
use crate::scenario::run::{CLIENT, SERVER, under};
use crate::stream_pipe::{self, Opening, StreamCounters};
use crate::tcp::IP_TCP_BYTES;
use crate::udp::UdpNetwork;

/// Most wants in a message.
const WANTS_PER_MESSAGE: usize = 500;
/// Arrivals that may wait to be looked at.
const WAITING: usize = 1024;

/// Bytes of a blob that came.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    pub(super) id: BlobId,
    pub(super) at_ns: u64,
    pub(super) bytes: u64,
    /// Whether they are its last.
    pub(super) last: bool,
}

impl Arrival {
    fn of(piece: &BlobPiece, clock: VirtualClock) -> Self {
        let (at_ns, bytes) = (clock.now_ns(), piece.bytes.len() as u64);
        Self { id: piece.id, at_ns, bytes, last: piece.is_last() }
    }
}

/// Where the link's counters are.
enum Network {
    Udp(UdpNetwork),
    Tcp(StreamCounters),
}

/// A connected client.
pub(super) struct Client {
    pub(super) clock: VirtualClock,
    network: Network,
    requests: mpsc::Sender<Vec<u8>>,
    arrivals: mpsc::Receiver<Arrival>,
}

impl Client {
    /// Connects over the case's link and says hello.
    pub(super) async fn connect(
        case: &Case,
        clock: VirtualClock,
        state: &Arc<ServerState>,
        certificate: &Certificate,
    ) -> anyhow::Result<Self> {
        let (requests, to_send) = mpsc::channel(WAITING);
        let (found, arrivals) = mpsc::channel(WAITING);
        let network = match case.transport {
            Transport::Quic => over_quic(case, clock, state, certificate, to_send, found).await?,
            Transport::Ws => over_websocket(case, clock, state, to_send, found).await?,
        };
        let client = Self { clock, network, requests, arrivals };
        let hello = Hello {
            version_min: 1,
            version_max: 2,
            scene: String::new(),
            view: None,
            max_blob_bytes: 1 << 26,
            budget_bytes: 1 << 30,
            fingerprint: [0; 16],
            have: Vec::new(),
        };
        client.say(&ClientMessage::Hello(hello)).await?;
        Ok(client)
    }

    /// Asks for blobs.
    pub(super) async fn want(&self, ids: &[BlobId], priority: Priority) -> anyhow::Result<()> {
        for ids in ids.chunks(WANTS_PER_MESSAGE) {
            let wants = ids.iter().map(|&id| Want::whole(id, priority)).collect();
            self.say(&ClientMessage::Want(wants)).await?;
        }
        Ok(())
    }

    async fn say(&self, message: &ClientMessage) -> anyhow::Result<()> {
        self.requests.send(encode_client(message)?).await.ok().context("the connection was lost")
    }

    /// The next bytes that come. May be dropped before it resolves.
    pub(super) async fn next(&mut self) -> anyhow::Result<Arrival> {
        self.arrivals.recv().await.context("the connection was lost")
    }

    /// What the link to the client has done. Packets count as soon as they are on their way.
    pub(super) fn downlink(&self) -> LinkCounters {
        match &self.network {
            Network::Udp(network) => network.counters(SERVER, CLIENT),
            Network::Tcp(counters) => counters.links()[0],
        }
    }

    /// Bytes of the packets that the client has received, with their headers, whose number follows from the mean length
    /// of all packets so far.
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
    mut to_send: mpsc::Receiver<Vec<u8>>,
    found: mpsc::Sender<Arrival>,
) -> anyhow::Result<Network> {
    let network = UdpNetwork::new(clock);
    let link = under(&case.link(), IP_UDP_BYTES);
    network.connect(SERVER, CLIENT, link.clone(), 1);
    network.connect(CLIENT, SERVER, link, 2);
    let server = network.endpoint(SERVER, Some(server_config(certificate)?), [1; 32])?;
    let client = network.endpoint(CLIENT, None, [2; 32])?;
    tokio::spawn(serve_quic(server, Arc::clone(state)));
    let config = client_config(Pin(certificate.fingerprint()))?;
    let connection = client.connect_with(config, SERVER, "localhost")?.await?;
    let mut control = connection.open_uni().await?;
    control.write_all(&[CONTROL_STREAM]).await?;
    tokio::spawn(async move {
        while let Some(bytes) = to_send.recv().await {
            if control.write_all(&bytes).await.is_err() {
                break;
            }
        }
    });
    tokio::spawn(async move {
        // The endpoint lives as long as its connection is read.
        let _client = client;
        while let Ok(stream) = connection.accept_uni().await {
            tokio::spawn(read_stream(stream, clock, found.clone()));
        }
    });
    Ok(Network::Udp(network))
}

/// Passes on what a stream brings, if it is a blob's.
async fn read_stream(mut stream: quinn::RecvStream, clock: VirtualClock, found: mpsc::Sender<Arrival>) {
    let mut kind = [0];
    if stream.read_exact(&mut kind).await.is_err() {
        return;
    }
    let mut blob = BlobStreamReader::new();
    while let Ok(Some(chunk)) = stream.read_chunk(1 << 16, true).await {
        if kind[0] != BLOB_STREAM {
            continue;
        }
        let Ok(pieces) = blob.push(chunk.bytes) else { return };
        for piece in &pieces {
            if found.send(Arrival::of(piece, clock)).await.is_err() {
                return;
            }
        }
    }
}

async fn over_websocket(
    case: &Case,
    clock: VirtualClock,
    state: &Arc<ServerState>,
    mut to_send: mpsc::Receiver<Vec<u8>>,
    found: mpsc::Sender<Arrival>,
) -> anyhow::Result<Network> {
    let link = under(&case.link(), IP_TCP_BYTES);
    let Opening { client, server, client_ready_ns, server_ready_ns, counters } =
        stream_pipe::open(clock, link.clone(), link, 1)?;
    let state = Arc::clone(state);
    tokio::spawn(async move {
        clock.sleep_until(server_ready_ns).await;
        accept_http(server, state, CLIENT).await;
    });
    clock.sleep_until(client_ready_ns).await;
    let mut request = format!("ws://{SERVER}/").into_client_request()?;
    request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(ALPN));
    let (socket, _) = client_async(request, client).await?;
    let (mut sink, mut stream) = socket.split();
    tokio::spawn(async move {
        while let Some(bytes) = to_send.recv().await {
            if sink.send(Message::Binary(bytes.into())).await.is_err() {
                break;
            }
        }
    });
    tokio::spawn(async move {
        while let Some(Ok(Message::Binary(bytes))) = stream.next().await {
            if let Ok(Some(ServerFrame::Piece(piece))) =
                Frame::parse(bytes).and_then(Frame::into_server_frame)
                && found.send(Arrival::of(&piece, clock)).await.is_err()
            {
                break;
            }
        }
    });
    Ok(Network::Tcp(counters))
}
