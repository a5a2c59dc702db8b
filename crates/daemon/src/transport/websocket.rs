//! A session over WebSocket: one binary message per frame.

use std::task::{Poll, ready};
use std::time::Duration;

use bytes::Bytes;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{Sink, SinkExt, StreamExt};
use lodestream_protocol::frame::{Frame, FrameError, encode_piece};
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::server::Transmit;
use lodestream_scene::limits::MAX_FRAME_BYTES;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite};
use tokio::time::{Instant, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::error::CapacityError;
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tokio_tungstenite::tungstenite::{self, Message};
use tracing::Instrument;

use crate::limits::byte_rate::{MeterControl, is_byte_rate_exceeded};
use crate::session::connection::{Deliver, Receive, Received};
use crate::session::drive::drive;
use crate::session::guard::SessionGuard;

/// Read buffer of each connection, in bytes.
const READ_BUFFER_BYTES: usize = 4 * 1024;
/// Time limit of the closing handshake.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);
/// Most bytes that are read and discarded from a client that violated the protocol, so that `Close` reaches it.
const MAX_DISCARDED_BYTES: usize = 1 << 20;
/// Offset of close codes: WebSocket reserves 4000 and up for applications (RFC 6455 §7.4.2).
const CLOSE_CODE_BASE: u16 = 4000;
/// Longest reason in a WebSocket close frame (RFC 6455 §5.5): 125 bytes with the code.
const MAX_CLOSE_FRAME_REASON_BYTES: usize = 123;

/// Settings of a session's WebSocket.
fn websocket_config() -> WebSocketConfig {
    WebSocketConfig::default()
        .read_buffer_size(READ_BUFFER_BYTES)
        // Frames are written at once, and the session's loop waits for each, so the buffer holds one frame and pongs.
        .write_buffer_size(0)
        .max_write_buffer_size(2 * MAX_FRAME_BYTES)
        .max_message_size(Some(MAX_FRAME_BYTES))
        .max_frame_size(Some(MAX_FRAME_BYTES))
}

/// Runs the session of `guard` over a stream with a byte rate limit.
pub(crate) async fn run_session<S>(stream: S, meter: MeterControl, mut guard: SessionGuard)
where
    S: AsyncRead + AsyncWrite + Unpin + Send,
{
    let span = tracing::info_span!("session", id = guard.id, transport = "ws", peer = %guard.peer);
    async {
        let started = Instant::now();
        let socket = WebSocketStream::from_raw_socket(stream, Role::Server, Some(websocket_config())).await;
        let (sink, stream) = socket.split();
        let mut receiver = WebSocketReceiver { stream, broken: false };
        let mut sender = WebSocketSender { sink, pending: Pending::Nothing, sent_bytes: 0 };
        // TCP's handshake has validated the address.
        let close = drive(&mut guard, std::future::ready(()), &mut receiver, &mut sender).await;
        tracing::info!(
            scene = guard.scene_name(),
            bytes = sender.sent_bytes,
            seconds = started.elapsed().as_secs_f32(),
            "session ended: {close}"
        );
        finish(sender, receiver, &meter, &close).await;
    }
    .instrument(span)
    .await;
}

/// Performs the closing handshake: our close frame, then the client's.
async fn finish<S>(
    mut sender: WebSocketSender<S>,
    mut receiver: WebSocketReceiver<S>,
    meter: &MeterControl,
    close: &Close,
) where
    S: AsyncRead + AsyncWrite + Unpin,
{
    if close.code == CloseCode::Lost {
        return;
    }
    let mut end = close.reason.len().min(MAX_CLOSE_FRAME_REASON_BYTES);
    while !close.reason.is_char_boundary(end) {
        end -= 1;
    }
    let code = if close.code == CloseCode::Normal { 1000 } else { CLOSE_CODE_BASE + close.code.number() };
    let frame = CloseFrame { code: code.into(), reason: close.reason[..end].into() };
    let _ = timeout(CLOSE_TIMEOUT, async {
        if sender.sink.send(Message::Close(Some(frame))).await.is_err() {
            return;
        }
        // Frames of a client that exceeded a limit are not parsed.
        if !receiver.broken && close.code != CloseCode::Limit {
            while let Some(Ok(_)) = receiver.stream.next().await {}
        } else if let Ok(mut socket) = receiver.stream.reunite(sender.sink) {
            // The bytes that remain are discarded: closing a TCP socket with unread bytes resets it, and `Close` would be
            // lost.
            meter.lift();
            let stream = socket.get_mut();
            let mut discarded = [0; READ_BUFFER_BYTES];
            let mut left = MAX_DISCARDED_BYTES;
            while left > 0
                && let Ok(count @ 1..) = stream.read(&mut discarded).await
            {
                left = left.saturating_sub(count);
            }
        }
    })
    .await;
}

/// Receiving half.
struct WebSocketReceiver<S> {
    stream: SplitStream<WebSocketStream<S>>,
    /// Whether the client violated WebSocket's framing: the stream has no further messages.
    broken: bool,
}

impl<S> Receive for WebSocketReceiver<S>
where
    S: AsyncRead + AsyncWrite + Unpin + Send,
{
    async fn receive(&mut self) -> Received {
        let message = match self.stream.next().await {
            None | Some(Err(tungstenite::Error::ConnectionClosed)) => return Received::Ended,
            Some(Err(why)) => {
                self.broken = true;
                return receive_error(why);
            }
            Some(Ok(message)) => message,
        };
        match message {
            Message::Binary(bytes) => match Frame::parse(bytes).and_then(Frame::into_client_message) {
                Ok(Some(message)) => Received::Message(message),
                // An unknown message that may be ignored.
                Ok(None) => Received::Ignored,
                Err(why) => Received::Malformed(why),
            },
            Message::Text(_) => Received::Violation("text messages are not supported".into()),
            Message::Close(_) => Received::Ended,
            Message::Ping(_) | Message::Pong(_) | Message::Frame(_) => Received::Ignored,
        }
    }
}

fn receive_error(error: tungstenite::Error) -> Received {
    match error {
        tungstenite::Error::Capacity(CapacityError::MessageTooLong { size, max_size }) => {
            Received::Malformed(FrameError::TooLong { bytes: size as u64, limit: max_size })
        }
        tungstenite::Error::Protocol(
            why @ tungstenite::error::ProtocolError::ResetWithoutClosingHandshake,
        ) => Received::Lost(why.to_string()),
        tungstenite::Error::Io(why) if is_byte_rate_exceeded(&why) => Received::ByteRateExceeded,
        why @ (tungstenite::Error::Io(_) | tungstenite::Error::AlreadyClosed) => {
            Received::Lost(why.to_string())
        }
        why => Received::Violation(why.to_string()),
    }
}

/// Data being written.
#[derive(Debug)]
enum Pending {
    Nothing,
    Frame(Bytes),
    /// A frame in the WebSocket's buffer, not yet written to the stream.
    Flushing,
}

/// Sending half.
struct WebSocketSender<S> {
    sink: SplitSink<WebSocketStream<S>, Message>,
    pending: Pending,
    sent_bytes: u64,
}

impl<S> Deliver for WebSocketSender<S>
where
    S: AsyncRead + AsyncWrite + Unpin + Send,
{
    fn start(&mut self, transmit: Transmit) -> Result<usize, FrameError> {
        let frame = match transmit {
            Transmit::Message { frame, .. } => frame,
            Transmit::Piece { piece, .. } => encode_piece(&piece)?.into(),
            Transmit::Abandon(_) => return Ok(0),
        };
        let length = frame.len();
        self.sent_bytes += length as u64;
        self.pending = Pending::Frame(frame);
        Ok(length)
    }

    fn is_idle(&self) -> bool {
        matches!(self.pending, Pending::Nothing)
    }

    async fn flush(&mut self) -> Result<(), String> {
        std::future::poll_fn(|context| {
            let mut sink = std::pin::Pin::new(&mut self.sink);
            if matches!(self.pending, Pending::Frame(_)) {
                ready!(sink.as_mut().poll_ready(context))?;
            }
            if let Pending::Frame(frame) = std::mem::replace(&mut self.pending, Pending::Flushing) {
                // The buffer cannot be full (`WriteBufferFull`), since it was flushed before.
                sink.as_mut().start_send(Message::Binary(frame))?;
            }
            ready!(sink.poll_flush(context))?;
            self.pending = Pending::Nothing;
            Poll::Ready(Ok(()))
        })
        .await
        .map_err(|why: tungstenite::Error| why.to_string())
    }
}
