//! WebSocket transport: one binary message carries one frame.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{Sink, SinkExt, StreamExt};
use lodestream_protocol::frame::{Frame, FrameError};
use lodestream_protocol::message::{Close, CloseCode, Token};
use lodestream_protocol::stream::ALPN;
use lodestream_scene::limits::MAX_FRAME_BYTES;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::error::{CapacityError, ProtocolError};
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::http::StatusCode;
use tokio_tungstenite::tungstenite::http::header::{AUTHORIZATION, SEC_WEBSOCKET_PROTOCOL};
use tokio_tungstenite::tungstenite::protocol::{CloseFrame, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{WebSocketStream, client_async_with_config};

use super::drive::{Clock, Host, Received, SendError, TransportReceiver, TransportSender, drive};

/// Read buffer: room for two pieces.
const READ_BUFFER_BYTES: usize = 32 * 1024;
/// Most messages in the send queue.
const MAX_WAITING_MESSAGES: usize = 8;
/// Added to the protocol's close codes to get WebSocket close codes (RFC 6455 §7.4.2: private use).
const CLOSE_CODE_BASE: u16 = 4000;

/// Target of the HTTP upgrade request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target<'a> {
    /// `HOST:PORT` for the `Host` header.
    pub(super) authority: &'a str,
    /// Path: `/` and the scene's name.
    pub(super) path: &'a str,
}

/// An open WebSocket, ready for a session.
#[derive(Debug)]
pub struct WebSocketConnection<S> {
    socket: WebSocketStream<S>,
    received: Arc<AtomicU64>,
}

impl<S: AsyncRead + AsyncWrite + Unpin> WebSocketConnection<CountingStream<S>> {
    /// Performs the WebSocket handshake over an open byte stream, usually TCP. `authority` is the `HOST:PORT` of the
    /// `Host` header.
    ///
    /// # Errors
    /// The server refuses, does not answer within `limit`, or the connection is lost.
    #[cfg_attr(not(feature = "runtime"), allow(dead_code, reason = "used by hosts with their own runtime"))]
    pub async fn open(stream: S, authority: &str, limit: Duration) -> Result<Self, Close> {
        let (stream, received) = CountingStream::new(stream);
        Self::open_counted(stream, received, Target { authority, path: "/" }, None, limit).await
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> WebSocketConnection<S> {
    /// As [`Self::open`], over a stream whose bytes are counted in `received`, for a scene and with a token.
    pub(super) async fn open_counted(
        stream: S,
        received: Arc<AtomicU64>,
        target: Target<'_>,
        token: Option<&Token>,
        limit: Duration,
    ) -> Result<Self, Close> {
        timeout(limit, handshake(stream, received, target, token)).await.unwrap_or_else(|_| {
            let why = format!(
                "it accepts connections, but gave no answer to the WebSocket request within {} s: is it a lodestream \
                 server?",
                limit.as_secs_f32()
            );
            Err(Close::new(CloseCode::Lost, why))
        })
    }
}

/// Runs one session over a WebSocket until it ends; gives the reason.
pub async fn run_websocket<S, H>(connection: WebSocketConnection<S>, host: &mut H, clock: Clock) -> Close
where
    S: AsyncRead + AsyncWrite + Unpin,
    H: Host,
{
    let (sink, stream) = connection.socket.split();
    let receiver = WebSocketReceiver { stream, received: connection.received };
    drive(host, clock, receiver, WebSocketSender { sink, queue: VecDeque::new(), unflushed: false }).await
}

async fn handshake<S>(
    stream: S,
    received: Arc<AtomicU64>,
    Target { authority, path }: Target<'_>,
    token: Option<&Token>,
) -> Result<WebSocketConnection<S>, Close>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let lost = |why: String| Close::new(CloseCode::Lost, why);
    let mut request = match format!("ws://{authority}{path}").into_client_request() {
        Ok(request) => request,
        Err(why) => return Err(lost(why.to_string())),
    };
    request.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(ALPN));
    if let Some(token) = token {
        let Ok(mut value) = HeaderValue::from_str(&format!("Bearer {}", token.0)) else {
            return Err(Close::new(
                CloseCode::Unauthorised,
                "the token has characters that are not allowed in a token",
            ));
        };
        value.set_sensitive(true);
        request.headers_mut().insert(AUTHORIZATION, value);
    }
    let limits = WebSocketConfig::default()
        .read_buffer_size(READ_BUFFER_BYTES)
        .write_buffer_size(0)
        .max_write_buffer_size(2 * MAX_FRAME_BYTES)
        .max_message_size(Some(MAX_FRAME_BYTES))
        .max_frame_size(Some(MAX_FRAME_BYTES));
    match client_async_with_config(request, stream, Some(limits)).await {
        Ok((socket, _)) => Ok(WebSocketConnection { socket, received }),
        Err(Error::Http(response)) => {
            let status = response.status();
            if status == StatusCode::UNAUTHORIZED {
                let reason = first_line(response.body().as_deref()).unwrap_or("the server refuses the token");
                return Err(Close::new(CloseCode::Unauthorised, reason));
            }
            if status == StatusCode::NOT_FOUND && path != "/" {
                let reason = first_line(response.body().as_deref()).unwrap_or("the server has no such scene");
                return Err(Close::new(CloseCode::NoSuchScene, reason));
            }
            let code = if status.is_server_error() { CloseCode::Busy } else { CloseCode::Protocol };
            Err(Close::new(code, format!("the server answers the WebSocket request with {status}")))
        }
        // A TLS alert does not parse as HTTP.
        Err(why @ Error::Protocol(ProtocolError::HttparseError(_))) => Err(lost(format!(
            "the WebSocket handshake failed: {why}; does the server print wss:// for this port?"
        ))),
        Err(why) => Err(lost(format!("the WebSocket handshake failed: {why}"))),
    }
}

/// The first line of an HTTP response's body, unless it is empty: the server's reason.
fn first_line(body: Option<&[u8]>) -> Option<&str> {
    let text = std::str::from_utf8(body?).ok()?;
    text.lines().next().filter(|line| !line.is_empty())
}

/// A stream that counts the bytes read from it.
#[derive(Debug)]
pub struct CountingStream<S> {
    stream: S,
    received: Arc<AtomicU64>,
}

impl<S> CountingStream<S> {
    /// Wraps a stream; gives the counter too.
    pub(super) fn new(stream: S) -> (Self, Arc<AtomicU64>) {
        let received = Arc::new(AtomicU64::new(0));
        (Self { stream, received: Arc::clone(&received) }, received)
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for CountingStream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let polled = Pin::new(&mut self.stream).poll_read(context, buffer);
        self.received.fetch_add((buffer.filled().len() - before) as u64, Ordering::Relaxed);
        polled
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for CountingStream<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

struct WebSocketReceiver<S> {
    stream: SplitStream<WebSocketStream<S>>,
    received: Arc<AtomicU64>,
}

impl<S: AsyncRead + AsyncWrite + Unpin> TransportReceiver for WebSocketReceiver<S> {
    async fn receive(&mut self) -> Received {
        let message = match self.stream.next().await {
            None | Some(Err(Error::ConnectionClosed | Error::AlreadyClosed)) => {
                return Received::Lost("the server closed the connection".into());
            }
            Some(Err(Error::Capacity(CapacityError::MessageTooLong { size, max_size }))) => {
                return Received::Malformed(FrameError::TooLong { bytes: size as u64, limit: max_size });
            }
            Some(Err(why)) => return Received::Lost(why.to_string()),
            Some(Ok(message)) => message,
        };
        match message {
            Message::Binary(bytes) => match Frame::parse(bytes).and_then(Frame::into_server_frame) {
                Ok(Some(frame)) => Received::Frame(frame),
                // An unknown message that may be skipped.
                Ok(None) => Received::Nothing,
                Err(why) => Received::Malformed(why),
            },
            Message::Close(frame) => closed(frame),
            Message::Text(_) => Received::Lost("the server sent a text message".into()),
            Message::Ping(_) | Message::Pong(_) | Message::Frame(_) => Received::Nothing,
        }
    }

    fn received_bytes(&self) -> u64 {
        self.received.load(Ordering::Relaxed)
    }
}

fn closed(frame: Option<CloseFrame>) -> Received {
    let Some(frame) = frame else { return Received::Lost("the server closed the connection".into()) };
    let number = u16::from(frame.code);
    let code = number.checked_sub(CLOSE_CODE_BASE).and_then(|n| CloseCode::from_number(u64::from(n)));
    let reason = frame.reason.as_str();
    match code {
        Some(code) => Received::Closed(Close::new(code, reason)),
        None if number == 1000 => Received::Closed(Close::new(CloseCode::Normal, reason)),
        None => Received::Lost(format!("the server closed the connection: {number} {reason}")),
    }
}

struct WebSocketSender<S> {
    sink: SplitSink<WebSocketStream<S>, Message>,
    queue: VecDeque<Message>,
    unflushed: bool,
}

impl<S: AsyncRead + AsyncWrite + Unpin> WebSocketSender<S> {
    fn poll(&mut self, context: &mut Context<'_>) -> Poll<Result<(), Error>> {
        while !self.queue.is_empty() {
            ready!(self.sink.poll_ready_unpin(context))?;
            if let Some(message) = self.queue.pop_front() {
                self.unflushed = true;
                self.sink.start_send_unpin(message)?;
            }
        }
        if self.unflushed {
            ready!(Pin::new(&mut self.sink).poll_flush(context))?;
            self.unflushed = false;
        }
        Poll::Ready(Ok(()))
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> TransportSender for WebSocketSender<S> {
    fn has_room(&self) -> bool {
        self.queue.len() < MAX_WAITING_MESSAGES
    }

    fn queue(&mut self, frame: Vec<u8>) {
        self.queue.push_back(Message::Binary(frame.into()));
    }

    fn is_idle(&self) -> bool {
        self.queue.is_empty() && !self.unflushed
    }

    async fn flush(&mut self) -> Result<(), SendError> {
        poll_fn(|context| self.poll(context)).await.map_err(|why| Box::new(why).into())
    }

    async fn finish(mut self, close: &Close) {
        if close.code != CloseCode::Lost {
            let code =
                if close.code == CloseCode::Normal { 1000 } else { CLOSE_CODE_BASE + close.code.number() };
            let frame = CloseFrame { code: code.into(), reason: truncate(&close.reason).into() };
            let _ = self.sink.send(Message::Close(Some(frame))).await;
        }
    }
}

/// The beginning of a reason that fits into a close frame (RFC 6455 §5.5).
fn truncate(reason: &str) -> &str {
    let mut end = reason.len().min(123);
    while !reason.is_char_boundary(end) {
        end -= 1;
    }
    &reason[..end]
}
