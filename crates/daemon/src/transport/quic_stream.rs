//! The receiving and sending half of a session on a QUIC connection: one stream of control frames in each direction, and
//! one stream per blob ([`lodestream_protocol::stream`]). In a WebTransport session each stream begins with a prefix that
//! names the session.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use bytes::{Buf as _, Bytes};
use lodestream_protocol::frame::{FrameError, FrameReader};
use lodestream_protocol::message::{ClientMessage, Close, CloseCode};
use lodestream_protocol::server::Transmit;
use lodestream_protocol::stream::{CONTROL_STREAM, PAGE_STREAM, blob_head, quic_priority};
use lodestream_scene::BlobId;
use lodestream_transport::quic::{self, READ_BYTES, close_of, next_frame, open_stream};
use lodestream_transport::{Incoming as _, Received, Receiver, SendError, Sender};
use quinn::{Connection, ConnectionError, ReadError, RecvStream, SendStream, VarInt, WriteError};
use tokio::time::{Instant, timeout};

use crate::limits::byte_rate::{BYTE_RATE_EXCEEDED, ByteRateLimiter};
use crate::session::state::ServerState;
use crate::transport::web_streams::WebStreams;

/// Application error code of streams that are reset because their blob was cancelled.
const ABANDONED: VarInt = VarInt::from_u32(0);
/// Time limit for the client's acknowledgement of `Close`.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
/// Interval at which the send window is adjusted to the path.
const WINDOW_INTERVAL: Duration = Duration::from_millis(50);
/// Bounds of the send window, in bytes.
const SEND_WINDOW_BYTES: std::ops::RangeInclusive<u64> = 16 * 1024..=8 * 1024 * 1024;

/// The send window before any measurement: 1.25 initial congestion windows.
pub(crate) const fn first_send_window(initial_window: u64) -> u64 {
    initial_window + initial_window / 4
}

/// Converts the end of a connection into an event.
pub(crate) fn connection_end<F>(error: &ConnectionError) -> Received<F> {
    let close = close_of(error, ClientMessage::PEER);
    if close.code == CloseCode::Normal { Received::Closed(close) } else { Received::Lost(close.reason) }
}

/// The streams that a client opens.
#[derive(Debug)]
pub(crate) enum ClientStreams {
    /// All streams of the connection.
    All(Connection),
    /// Those of a WebTransport session.
    OfSession(WebStreams),
}

impl ClientStreams {
    /// The next stream, after the prefix. Cancel safe.
    async fn accept(&mut self) -> Result<RecvStream, ConnectionError> {
        match self {
            Self::All(connection) => connection.accept_uni().await,
            Self::OfSession(streams) => streams.accept().await,
        }
    }
}

/// Receiving half: the client's control stream.
#[derive(Debug)]
pub(crate) struct QuicReceiver {
    streams: ClientStreams,
    state: Arc<ServerState>,
    stream: Option<RecvStream>,
    kind_known: bool,
    frames: FrameReader,
    limiter: ByteRateLimiter,
}

impl QuicReceiver {
    pub(crate) fn new(streams: ClientStreams, state: Arc<ServerState>) -> Self {
        Self {
            streams,
            state,
            stream: None,
            kind_known: false,
            frames: FrameReader::new(),
            limiter: ByteRateLimiter::new(),
        }
    }
}

impl Receiver for QuicReceiver {
    type Frame = ClientMessage;

    async fn receive(&mut self) -> Received<ClientMessage> {
        loop {
            if let Some(received) = next_frame(&mut self.frames) {
                return received;
            }
            let Some(stream) = &mut self.stream else {
                match self.streams.accept().await {
                    Ok(stream) => {
                        if stream.is_0rtt() {
                            self.state.metrics().early_data();
                        }
                        self.stream = Some(stream);
                    }
                    Err(why) => return connection_end(&why),
                }
                continue;
            };
            match stream.read_chunk(READ_BYTES, true).await {
                Ok(Some(chunk)) if !self.limiter.take(chunk.bytes.len()) => {
                    return Received::Violation(Close::new(CloseCode::Limit, BYTE_RATE_EXCEEDED));
                }
                Ok(Some(mut chunk)) => {
                    if !self.kind_known && !chunk.bytes.is_empty() {
                        self.kind_known = true;
                        let kind = chunk.bytes.get_u8();
                        if kind != CONTROL_STREAM {
                            return Received::Malformed(FrameError::UnknownStream(kind));
                        }
                    }
                    self.frames.push(&chunk.bytes);
                }
                Ok(None) if self.frames.pending() > 0 => return Received::Malformed(FrameError::Truncated),
                Ok(None) => return Received::Closed(Close::new(CloseCode::Normal, "the client left")),
                Err(ReadError::ConnectionLost(why)) => return connection_end(&why),
                Err(why) => return Received::Lost(format!("the client's control stream failed: {why}")),
            }
        }
    }
}

/// Data being written.
#[derive(Debug)]
enum Pending {
    Nothing,
    /// The rest of a control frame.
    Control(Bytes),
    /// The rest of a scene page, with the stream's kind if the stream is not open yet.
    Page {
        priority: i32,
        stream: Option<SendStream>,
        bytes: Bytes,
    },
    /// The rest of a piece, with the stream's head if the stream is not open yet.
    Piece {
        id: BlobId,
        priority: i32,
        head: Bytes,
        bytes: Bytes,
        last: bool,
    },
}

/// Sending half.
#[derive(Debug)]
pub(crate) struct QuicSender {
    connection: Connection,
    /// First bytes of each stream.
    prefix: Bytes,
    /// Error code of streams whose blob was cancelled.
    abandoned: VarInt,
    rate_bits_per_s: Option<u64>,
    control: Option<SendStream>,
    /// Open streams of blobs; `None` if the client has stopped the stream.
    blobs: BTreeMap<BlobId, Option<SendStream>>,
    pending: Pending,
    next_adjustment: Instant,
}

impl QuicSender {
    pub(crate) fn new(connection: Connection, rate_bits_per_s: Option<u64>) -> Self {
        Self::with_prefix(connection, rate_bits_per_s, Bytes::new(), ABANDONED)
    }

    /// For a WebTransport session, whose streams have a prefix and whose error codes are mapped.
    pub(crate) fn with_prefix(
        connection: Connection,
        rate_bits_per_s: Option<u64>,
        prefix: Bytes,
        abandoned: VarInt,
    ) -> Self {
        Self {
            connection,
            prefix,
            abandoned,
            rate_bits_per_s,
            control: None,
            blobs: BTreeMap::new(),
            pending: Pending::Nothing,
            next_adjustment: Instant::now() + WINDOW_INTERVAL,
        }
    }

    /// Adjusts the send window to 1.25 congestion windows: enough to replace acknowledged bytes at once, and no more, since
    /// data in the window cannot be overtaken.
    fn adjust_window(&mut self) {
        let now = Instant::now();
        if now < self.next_adjustment {
            return;
        }
        self.next_adjustment = now + WINDOW_INTERVAL;
        let path = self.connection.stats().path;
        let mut window = path.cwnd + path.cwnd / 4;
        if let Some(rate) = self.rate_bits_per_s {
            // Twice the bandwidth–delay product, and 50 ms for delayed acknowledgements and timers.
            let rtt_ms = u64::try_from(path.rtt.as_millis()).unwrap_or(u64::MAX).min(10_000);
            window = window.min((rate / 8000).saturating_mul(2 * rtt_ms + 50));
        }
        self.connection.set_send_window(window.clamp(*SEND_WINDOW_BYTES.start(), *SEND_WINDOW_BYTES.end()));
    }

    /// Closes the connection; unless it is lost, waits for `Close` to arrive.
    pub(crate) async fn finish(mut self, close: &Close) {
        self.finish_control(close).await;
        quic::close(&self.connection, close);
    }

    /// Ends the stream of control frames; unless the connection is lost, waits for `Close` to arrive.
    pub(crate) async fn finish_control(&mut self, close: &Close) {
        if close.code != CloseCode::Lost
            && let Some(control) = &mut self.control
        {
            finish_stream(control, &self.connection).await;
        }
    }
}

/// Ends a stream and waits, within a limit, until the client has it or the connection is closed.
pub(crate) async fn finish_stream(stream: &mut SendStream, connection: &Connection) {
    if stream.finish().is_ok() {
        let (stopped, closed) = (stream.stopped(), connection.closed());
        let _ = timeout(CLOSE_TIMEOUT, async {
            tokio::select! {
                biased;
                _ = closed => {}
                _ = stopped => {}
            }
        })
        .await;
    }
}

/// Writes all bytes; returns `false` if the client has stopped the stream. Cancel safe: written bytes are removed.
async fn write(stream: &mut SendStream, bytes: &mut Bytes) -> Result<bool, WriteError> {
    match quic::write(stream, bytes).await {
        Err(WriteError::Stopped(_) | WriteError::ClosedStream) => Ok(false),
        written => written.map(|()| true),
    }
}

impl Sender for QuicSender {
    type Item = Transmit;

    fn has_room(&self) -> bool {
        self.is_idle()
    }

    fn push(&mut self, transmit: Transmit) -> Result<usize, FrameError> {
        match transmit {
            Transmit::Message { frame, page_priority: Some(priority), .. } => {
                let bytes: Bytes = [&self.prefix[..], &[PAGE_STREAM], &frame].concat().into();
                let length = bytes.len();
                self.pending = Pending::Page { priority: quic_priority(priority), stream: None, bytes };
                Ok(length)
            }
            Transmit::Message { frame, .. } => {
                let length = frame.len();
                self.pending = Pending::Control(frame);
                Ok(length)
            }
            Transmit::Piece { piece, priority } => {
                let last = piece.is_last();
                let begins = !self.blobs.contains_key(&piece.id);
                let head = if begins {
                    [&self.prefix[..], &blob_head(&piece)?].concat().into()
                } else {
                    Bytes::new()
                };
                let length = head.len() + piece.bytes.len();
                let priority = quic_priority(priority);
                self.pending = Pending::Piece { id: piece.id, priority, head, bytes: piece.bytes, last };
                Ok(length)
            }
            Transmit::Abandon(id) => {
                if let Some(Some(mut stream)) = self.blobs.remove(&id) {
                    let _ = stream.reset(self.abandoned);
                }
                Ok(0)
            }
        }
    }

    fn is_idle(&self) -> bool {
        matches!(self.pending, Pending::Nothing)
    }

    async fn flush(&mut self) -> Result<(), SendError> {
        self.adjust_window();
        // Cancel safe: written bytes are removed from `pending`.
        if let Pending::Control(frame) = &self.pending
            && self.control.is_none()
        {
            let first = [&self.prefix[..], &[CONTROL_STREAM], frame].concat();
            self.control = Some(open_stream(&self.connection, i32::MAX).await?);
            self.pending = Pending::Control(first.into());
        }
        if let Pending::Piece { id, priority, .. } = self.pending
            && !self.blobs.contains_key(&id)
        {
            let stream = open_stream(&self.connection, priority).await?;
            self.blobs.insert(id, Some(stream));
        }
        match &mut self.pending {
            Pending::Nothing => {}
            Pending::Control(frame) => {
                if let Some(control) = &mut self.control
                    && !write(control, frame).await?
                {
                    return Err(SendError::Stopped(ClientMessage::PEER));
                }
            }
            Pending::Page { priority, stream, bytes } => {
                let stream = match stream {
                    Some(stream) => stream,
                    None => stream.insert(open_stream(&self.connection, *priority).await?),
                };
                if !write(stream, bytes).await? {
                    return Err(SendError::Stopped(ClientMessage::PEER));
                }
                let _ = stream.finish();
            }
            Pending::Piece { id, priority, head, bytes, last } => {
                if let Some(slot) = self.blobs.get_mut(id) {
                    if let Some(stream) = slot {
                        // The client may have changed the priority since the last piece.
                        let _ = stream.set_priority(*priority);
                        if !(write(stream, head).await? && write(stream, bytes).await?) {
                            *slot = None;
                        }
                    }
                    if *last {
                        if let Some(stream) = slot {
                            let _ = stream.finish();
                        }
                        self.blobs.remove(id);
                    }
                }
            }
        }
        self.pending = Pending::Nothing;
        Ok(())
    }
}
