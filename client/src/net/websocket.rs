//! WebSocket transport: one binary message carries one frame.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode, Token};
use lodestream_protocol::stream::{ALPN, RESUME_QUERY};
use lodestream_transport::websocket::{config, split};
use lodestream_transport::{Clock, ObservedStream, ReadObserver};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::Error;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::error::ProtocolError;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::http::StatusCode;
use tokio_tungstenite::tungstenite::http::header::{AUTHORIZATION, SEC_WEBSOCKET_PROTOCOL};
use tokio_tungstenite::{WebSocketStream, client_async_with_config};

use super::drive::{CLOSE_TIMEOUT, Host, drive};

/// Read buffer: room for two pieces.
const READ_BUFFER_BYTES: usize = 32 * 1024;
/// Most messages in the send queue.
const MAX_WAITING_MESSAGES: usize = 8;

/// Target of the HTTP upgrade request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target<'a> {
    /// `HOST:PORT` for the `Host` header.
    pub(super) authority: &'a str,
    /// Path: `/` and the scene's name.
    pub(super) path: &'a str,
}

/// Path and query of the upgrade request.
pub(super) fn request_path(path: &str, resumes: bool) -> String {
    if resumes { format!("{path}?{RESUME_QUERY}") } else { path.to_owned() }
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
        Self::open_resumed(stream, authority, false, limit).await
    }

    /// The same; `resumes`: the client has something of the scene, so the server must push nothing unasked.
    ///
    /// # Errors
    /// As [`Self::open`].
    #[cfg_attr(not(feature = "runtime"), allow(dead_code, reason = "used by hosts with their own runtime"))]
    pub async fn open_resumed(
        stream: S,
        authority: &str,
        resumes: bool,
        limit: Duration,
    ) -> Result<Self, Close> {
        let (stream, received) = counting(stream);
        let path = request_path("/", resumes);
        Self::open_counted(stream, received, Target { authority, path: &path }, None, limit).await
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
    S: AsyncRead + AsyncWrite + Unpin + Send,
    H: Host,
{
    let WebSocketConnection { socket, received } = connection;
    let (mut receiver, mut sender) = split(socket, MAX_WAITING_MESSAGES);
    let close = drive(host, clock, &mut receiver, &mut sender, || received.load(Ordering::Relaxed)).await;
    if close.code != CloseCode::Lost {
        let _ = timeout(CLOSE_TIMEOUT, sender.send_close(&close)).await;
    }
    close
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
    match client_async_with_config(request, stream, Some(config(READ_BUFFER_BYTES))).await {
        Ok((socket, _)) => Ok(WebSocketConnection { socket, received }),
        Err(Error::Http(response)) => {
            let status = response.status();
            if status == StatusCode::UNAUTHORIZED {
                let reason = first_line(response.body().as_deref()).unwrap_or("the server refuses the token");
                return Err(Close::new(CloseCode::Unauthorised, reason));
            }
            if status == StatusCode::NOT_FOUND && path.trim_end_matches(RESUME_QUERY) != "/" {
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

/// Counts the bytes read from a stream.
#[derive(Debug)]
pub struct ByteCounter(Arc<AtomicU64>);

impl ReadObserver for ByteCounter {
    fn after_read(&mut self, count: usize) {
        self.0.fetch_add(count as u64, Ordering::Relaxed);
    }
}

/// A stream that counts the bytes read from it.
pub type CountingStream<S> = ObservedStream<S, ByteCounter>;

/// Wraps a stream; gives the counter too.
pub(super) fn counting<S>(stream: S) -> (CountingStream<S>, Arc<AtomicU64>) {
    let received = Arc::default();
    (counting_in(stream, &received), received)
}

/// Wraps a stream whose bytes are added to a counter.
pub(super) fn counting_in<S>(stream: S, received: &Arc<AtomicU64>) -> CountingStream<S> {
    ObservedStream::new(stream, ByteCounter(Arc::clone(received)))
}
