//! A minimal client over either transport: it requests blobs, reads them and decodes nothing.

use std::sync::Arc;

use anyhow::Context as _;
use futures_util::{SinkExt as _, StreamExt as _};
use lodestream_netsim::clock::VirtualClock;
use lodestream_protocol::frame::{BlobPiece, Frame, ServerFrame, encode_client};
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_protocol::source::SceneSource;
use lodestream_protocol::stream::{ALPN, BLOB_STREAM, BlobStreamReader, CONTROL_STREAM};
use lodestream_scene::BlobId;
use lodestream_scene::limits::MAX_QUEUED;
use lodestream_select::Priority;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::mpsc;
use tokio_tungstenite::client_async;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::http::header::SEC_WEBSOCKET_PROTOCOL;

/// Most requests in one message.
const WANTS_PER_MESSAGE: usize = 500;
/// Capacity of the channels: arrivals not yet read, messages not yet sent.
const WAITING: usize = 256;

/// All chunks of a scene, up to the number of requests that a session queues.
pub(crate) fn chunks(source: &Arc<dyn SceneSource>) -> Vec<BlobId> {
    let pages = (0..source.header().page_count).filter_map(|page| source.page(page));
    let assets = pages.flat_map(|page| page.assets.clone());
    let of_asset = |(asset, chunks): (u32, u32)| (0..chunks).map(move |chunk| BlobId::chunk(asset, chunk));
    (0..).zip(assets.map(|asset| asset.chunk_count)).flat_map(of_asset).take(MAX_QUEUED).collect()
}

/// Bytes of a blob that arrived.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arrival {
    pub(crate) id: BlobId,
    pub(crate) at_ns: u64,
    pub(crate) bytes: u64,
    /// Whether these are the blob's last bytes.
    pub(crate) last: bool,
}

impl Arrival {
    fn of(piece: &BlobPiece, clock: VirtualClock) -> Self {
        let (at_ns, bytes) = (clock.now_ns(), piece.bytes.len() as u64);
        Self { id: piece.id, at_ns, bytes, last: piece.is_last() }
    }
}

/// A minimal client. Its tasks end after it is dropped, the next time that they have something to send or receive.
#[derive(Debug)]
pub(crate) struct BareClient {
    requests: mpsc::Sender<Vec<u8>>,
    arrivals: mpsc::Receiver<Arrival>,
}

impl BareClient {
    /// Runs over a QUIC connection, and keeps its endpoint alive.
    pub(crate) async fn over_quic(
        endpoint: quinn::Endpoint,
        connection: quinn::Connection,
        clock: VirtualClock,
    ) -> anyhow::Result<Self> {
        let (client, mut to_send, found) = Self::channels();
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
            let _endpoint = endpoint;
            while let Ok(stream) = connection.accept_uni().await {
                tokio::spawn(read_stream(stream, clock, found.clone()));
            }
        });
        Ok(client)
    }

    /// Runs over a TCP connection or a simulated one.
    pub(crate) async fn over_websocket<S>(stream: S, host: &str, clock: VirtualClock) -> anyhow::Result<Self>
    where
        S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
    {
        let (client, mut to_send, found) = Self::channels();
        let mut request = format!("ws://{host}/").into_client_request()?;
        request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(ALPN));
        let (socket, _) = client_async(request, stream).await?;
        let (mut sink, mut stream) = socket.split();
        tokio::spawn(async move {
            while let Some(bytes) = to_send.recv().await {
                if sink.send(Message::Binary(bytes.into())).await.is_err() {
                    break;
                }
            }
        });
        tokio::spawn(async move {
            while let Some(Ok(message)) = stream.next().await {
                let Message::Binary(bytes) = message else { continue };
                let frame = Frame::parse(bytes).and_then(Frame::into_server_frame);
                if let Ok(Some(ServerFrame::Piece(piece))) = frame
                    && found.send(Arrival::of(&piece, clock)).await.is_err()
                {
                    break;
                }
            }
        });
        Ok(client)
    }

    fn channels() -> (Self, mpsc::Receiver<Vec<u8>>, mpsc::Sender<Arrival>) {
        let (requests, to_send) = mpsc::channel(WAITING);
        let (found, arrivals) = mpsc::channel(WAITING);
        (Self { requests, arrivals }, to_send, found)
    }

    /// Sends `Hello` without a view.
    pub(crate) async fn hello(&self) -> anyhow::Result<()> {
        self.say(&ClientMessage::Hello(Hello::new(""))).await
    }

    /// Requests blobs.
    pub(crate) async fn want(&self, ids: &[BlobId], priority: Priority) -> anyhow::Result<()> {
        for ids in ids.chunks(WANTS_PER_MESSAGE) {
            let wants = ids.iter().map(|&id| Want::whole(id, priority)).collect();
            self.say(&ClientMessage::Want(wants)).await?;
        }
        Ok(())
    }

    async fn say(&self, message: &ClientMessage) -> anyhow::Result<()> {
        self.requests.send(encode_client(message)?).await.ok().context("the connection was lost")
    }

    /// The next bytes that arrive; `None` once the connection is closed. Cancel-safe.
    pub(crate) async fn next(&mut self) -> Option<Arrival> {
        self.arrivals.recv().await
    }
}

/// Forwards the pieces of a blob's stream; ignores other streams.
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
