//! QUIC transport: one control stream each way, and one stream from the server per blob.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Buf;
use futures_util::StreamExt;
use futures_util::future::BoxFuture;
use futures_util::stream::FuturesUnordered;
use lodestream_protocol::frame::{FrameError, FrameReader, ServerFrame};
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::stream::{
    ALPN, BLOB_STREAM, BlobStreamReader, CONTROL_STREAM, PAGE_STREAM, alpn_of_scene,
};
use lodestream_transport::quic::{self as transport, READ_BYTES, next_frame};
use lodestream_transport::{Clock, Incoming as _, Received, Receiver};
use quinn::crypto::rustls::QuicClientConfig;
use quinn::{Chunk, Connection, ConnectionError, ReadError, RecvStream, TokenMemoryCache, VarInt};

use tokio::time::timeout;

use super::drive::{Host, drive};
use super::quic_open::QuicConnection;
use super::quic_sender::{QuicSender, SEND_QUEUE_BYTES};
use super::trust::{CertificateRejection, Trust, Verifier};

/// Most streams that the server may have open at once: one for control, the others for blobs.
const MAX_STREAMS: u32 = 256;
/// Flow control window, in total and per stream: 16 Mbit/s over 2 s.
const RECEIVE_WINDOW_BYTES: u32 = 4 << 20;
/// Time without a packet after which the connection counts as lost.
const IDLE_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval of keep-alive packets.
const KEEP_ALIVE: Duration = Duration::from_secs(3);
/// Time within which the server must allow the control stream.
const CONTROL_TIMEOUT: Duration = Duration::from_secs(4);
/// Most TLS session tickets kept of a server; each is used once, and every connection brings new ones.
const MAX_TICKETS: usize = 8;
/// Most QUIC address validation tokens kept of a server.
const MAX_ADDRESS_TOKENS: usize = 8;
/// Receive buffer requested for the socket: 16 Mbit/s for half a second.
const SOCKET_BUFFER_BYTES: usize = 1 << 20;

/// Why QUIC cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum QuicSetupError {
    /// TLS rejects its settings.
    #[error("TLS cannot be set up: {0}")]
    Tls(#[from] rustls::Error),
    /// TLS has no cipher suite for QUIC.
    #[error("QUIC cannot be set up: {0}")]
    Crypto(#[from] quinn::crypto::rustls::NoInitialCipherSuite),
    /// A setting is out of range.
    #[error("QUIC cannot be set up: {0}")]
    Bounds(#[from] quinn::VarIntBoundsExceeded),
    /// The system provides no socket.
    #[error("no UDP socket can be opened: {0}")]
    Socket(#[from] std::io::Error),
}

/// QUIC settings for connections to one server, whose certificate is verified by `trust`.
///
/// They hold, in memory, the session tickets and address tokens that the server gives. Connecting again with the same
/// settings, or a clone of them, resumes the session ([`QuicConnection`]). Use new settings for another server: tickets
/// of one server are then never shown to another, and a session is resumed only under the trust that verified it.
///
/// # Errors
/// TLS or QUIC reject their settings.
#[cfg_attr(not(feature = "runtime"), allow(dead_code, reason = "used by hosts with their own runtime"))]
pub fn client_config(trust: impl Into<Trust>) -> Result<quinn::ClientConfig, QuicSetupError> {
    client_config_of(trust.into(), CertificateRejection::default(), "")
}

/// As [`client_config`], for sessions with a scene (empty: the server's only one). Notes why a certificate is rejected.
pub(super) fn client_config_of(
    trust: Trust,
    rejection: CertificateRejection,
    scene: &str,
) -> Result<quinn::ClientConfig, QuicSetupError> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let verifier = Verifier::new(trust, rejection, provider.clone())?;
    let mut tls = rustls::ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous()
        .with_custom_certificate_verifier(verifier)
        .with_no_client_auth();
    // The name in ALPN lets a server with several scenes send the right one before `Hello` arrives.
    let named = (!scene.is_empty()).then(|| alpn_of_scene(scene));
    tls.alpn_protocols = named.into_iter().map(String::into_bytes).chain([ALPN.into()]).collect();
    tls.resumption = rustls::client::Resumption::in_memory_sessions(MAX_TICKETS);
    tls.enable_early_data = true;
    let mut transport = quinn::TransportConfig::default();
    transport
        .max_concurrent_uni_streams(VarInt::from_u32(MAX_STREAMS))
        .max_concurrent_bidi_streams(VarInt::from_u32(0))
        .receive_window(VarInt::from_u32(RECEIVE_WINDOW_BYTES))
        .stream_receive_window(VarInt::from_u32(RECEIVE_WINDOW_BYTES))
        .send_window(SEND_QUEUE_BYTES as u64 * 4)
        .datagram_receive_buffer_size(None)
        .max_idle_timeout(Some(IDLE_TIMEOUT.try_into()?))
        .keep_alive_interval(Some(KEEP_ALIVE));
    let mut config = quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(tls)?));
    config
        .transport_config(Arc::new(transport))
        .token_store(Arc::new(TokenMemoryCache::new(1, MAX_ADDRESS_TOKENS)));
    Ok(config)
}

/// Opens an endpoint on a UDP socket for connections to `server`.
///
/// # Errors
/// The system provides no socket.
pub fn endpoint(server: SocketAddr, config: quinn::ClientConfig) -> Result<quinn::Endpoint, QuicSetupError> {
    let any: SocketAddr = if server.is_ipv6() { ([0_u16; 8], 0).into() } else { ([0_u8; 4], 0).into() };
    let socket = socket2::Socket::new(socket2::Domain::for_address(any), socket2::Type::DGRAM, None)?;
    // The system may refuse or halve the size; streaming still works, with more loss at high rates.
    let _ = socket.set_recv_buffer_size(SOCKET_BUFFER_BYTES);
    socket.set_nonblocking(true)?;
    socket.bind(&any.into())?;
    let runtime = Arc::new(quinn::TokioRuntime);
    let mut endpoint = quinn::Endpoint::new(quinn::EndpointConfig::default(), None, socket.into(), runtime)?;
    endpoint.set_default_client_config(config);
    Ok(endpoint)
}

/// Runs one session over a connection until it ends; gives the reason.
pub async fn run_quic<H: Host>(connection: impl Into<QuicConnection>, host: &mut H, clock: Clock) -> Close {
    let QuicConnection { connection, early } = connection.into();
    // Immediate with every server that allows the client a stream.
    match timeout(CONTROL_TIMEOUT, QuicSender::open(connection.clone(), early)).await {
        Ok(Ok(mut sender)) => {
            let mut receiver = QuicReceiver::new(connection.clone());
            let received_bytes = || connection.stats().udp_rx.bytes;
            let close = drive(host, clock, &mut receiver, &mut sender, received_bytes).await;
            transport::close(&connection, &close);
            close
        }
        Ok(Err(why)) => close_of(&why),
        Err(_) => {
            let limit = CONTROL_TIMEOUT.as_secs();
            let why =
                format!("the server allows no control stream within {limit} s: is it a lodestream server?");
            Close::new(CloseCode::Lost, why)
        }
    }
}

/// The reason for the end of a connection, from the server or the transport.
pub(super) fn close_of(error: &ConnectionError) -> Close {
    transport::close_of(error, ServerFrame::PEER)
}

fn received_of(error: &ConnectionError) -> Received<ServerFrame> {
    let close = close_of(error);
    if close.code == CloseCode::Lost { Received::Lost(close.reason) } else { Received::Closed(close) }
}

/// Contents of a stream from the server.
#[derive(Debug)]
enum StreamKind {
    /// Its type byte has not arrived.
    Unknown,
    Control(FrameReader),
    Page(FrameReader),
    Blob(BlobStreamReader),
}

#[derive(Debug)]
struct Incoming {
    stream: RecvStream,
    kind: StreamKind,
}

/// A pending read of a stream.
type Reading = BoxFuture<'static, (Incoming, Result<Option<Chunk>, ReadError>)>;

fn read(mut incoming: Incoming) -> Reading {
    Box::pin(async move {
        let chunk = incoming.stream.read_chunk(READ_BYTES, true).await;
        (incoming, chunk)
    })
}

/// The receiving half: reads all of the server's streams at once.
struct QuicReceiver {
    connection: Connection,
    reading: FuturesUnordered<Reading>,
    /// Streams of frames that hold some that were not returned yet.
    framed: VecDeque<Incoming>,
    has_control: bool,
}

impl QuicReceiver {
    fn new(connection: Connection) -> Self {
        Self { connection, reading: FuturesUnordered::new(), framed: VecDeque::new(), has_control: false }
    }

    /// The next buffered frame of a stream of frames; once a stream has none, it is read again.
    fn next_frame(&mut self) -> Option<Received<ServerFrame>> {
        while let Some(mut incoming) = self.framed.pop_front() {
            let (StreamKind::Control(frames) | StreamKind::Page(frames)) = &mut incoming.kind else {
                continue;
            };
            match next_frame(frames) {
                Some(malformed @ Received::Malformed(_)) => return Some(malformed),
                Some(received) => {
                    self.framed.push_front(incoming);
                    return Some(received);
                }
                None => self.reading.push(read(incoming)),
            }
        }
        None
    }

    fn take(&mut self, mut incoming: Incoming, chunk: Option<Chunk>) -> Received<ServerFrame> {
        let Some(chunk) = chunk else {
            return match incoming.kind {
                StreamKind::Unknown => Received::Skipped,
                StreamKind::Control(frames) | StreamKind::Page(frames) if frames.pending() > 0 => {
                    Received::Malformed(FrameError::Truncated)
                }
                StreamKind::Control(_) | StreamKind::Page(_) => Received::Skipped,
                StreamKind::Blob(blob) => match blob.finish() {
                    Ok(()) => Received::Skipped,
                    Err(why) => Received::Malformed(why),
                },
            };
        };
        let mut bytes = chunk.bytes;
        if matches!(incoming.kind, StreamKind::Unknown) && !bytes.is_empty() {
            incoming.kind = match bytes.get_u8() {
                CONTROL_STREAM if !self.has_control => StreamKind::Control(FrameReader::new()),
                BLOB_STREAM => StreamKind::Blob(BlobStreamReader::new()),
                PAGE_STREAM => StreamKind::Page(FrameReader::new()),
                unknown => return Received::Malformed(FrameError::UnknownStream(unknown)),
            };
            self.has_control |= matches!(incoming.kind, StreamKind::Control(_));
        }
        match &mut incoming.kind {
            StreamKind::Unknown => {
                self.reading.push(read(incoming));
                Received::Skipped
            }
            StreamKind::Control(frames) | StreamKind::Page(frames) => {
                frames.push(&bytes);
                self.framed.push_back(incoming);
                Received::Skipped
            }
            StreamKind::Blob(blob) => match blob.push(bytes) {
                Ok(pieces) => {
                    self.reading.push(read(incoming));
                    Received::Pieces(pieces)
                }
                Err(why) => Received::Malformed(why),
            },
        }
    }
}

impl Receiver for QuicReceiver {
    type Frame = ServerFrame;

    async fn receive(&mut self) -> Received<ServerFrame> {
        if let Some(received) = self.next_frame() {
            return received;
        }
        tokio::select! {
            biased;
            Some((incoming, chunk)) = self.reading.next() => match chunk {
                Ok(chunk) => self.take(incoming, chunk),
                Err(ReadError::Reset(_)) => match &incoming.kind {
                    StreamKind::Blob(blob) => {
                        blob.blob().map_or(Received::Skipped, |(id, _)| Received::Abandoned(id))
                    }
                    StreamKind::Unknown => Received::Skipped,
                    StreamKind::Control(_) => Received::Lost("the server reset its control stream".into()),
                    StreamKind::Page(_) => Received::Lost("the server reset a stream of a page".into()),
                },
                Err(ReadError::ConnectionLost(why)) => received_of(&why),
                Err(why) => Received::Lost(why.to_string()),
            },
            accepted = self.connection.accept_uni() => match accepted {
                Ok(stream) => {
                    self.reading.push(read(Incoming { stream, kind: StreamKind::Unknown }));
                    Received::Skipped
                }
                Err(why) => received_of(&why),
            },
        }
    }
}
