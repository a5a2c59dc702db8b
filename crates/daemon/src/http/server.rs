//! The public HTTP port, with TLS or without: `/health`, `/ready` and `/scenes`, and the upgrade to WebSocket at `/NAME`
//! for the scene of that name, at `/` and `/stream` for the only one, or for the one that `Hello` names.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytes::Bytes;
use http_body_util::Full;
use hyper::body::Incoming;
use hyper::header::{self, HeaderMap, HeaderName, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::upgrade::OnUpgrade;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use lodestream_protocol::stream::{ALPN, scene_of_path};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::handshake::derive_accept_key;

use crate::admission::byte_rate::{MeterControl, MeteredStream};
use crate::admission::pre_auth_pool::PreAuthSlot;
use crate::admission::refusal::Refusal;
use crate::auth::grant::TokenError;
use crate::metrics::Transport;
use crate::session::guard::SessionGuard;
use crate::session::state::{Phase, ServerState};
use crate::transport::listen::accept_each;
use crate::transport::tls::Tls;
use crate::transport::websocket;

/// Time in which a request's head must be there: slow senders hold a connection no longer.
const HEADER_TIMEOUT: Duration = Duration::from_secs(5);
/// Time in which a request must be answered in full.
pub(crate) const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest head of a request, in bytes.
const MAX_HEADER_BYTES: usize = 16 * 1024;
/// Most header fields of a request.
const MAX_HEADERS: usize = 64;
/// Bytes that the kernel may hold unsent on a connection. What lies there cannot be overtaken.
#[cfg(any(target_os = "linux", target_os = "android"))]
const UNSENT_BYTES: u32 = 16 * 1024;

/// Takes connections of a listener until the daemon stops; while it drains, `/ready` says so. There are as many as the
/// rooms and leases of the state allow: whoever is turned out ends at once.
pub(crate) async fn serve_http(listener: TcpListener, state: Arc<ServerState>, tls: Option<Tls>) {
    let serve = |stream: TcpStream, peer| {
        prepare(&stream);
        let (state, tls) = (Arc::clone(&state), tls.clone());
        async move {
            match tls {
                Some(tls) => accept_https(stream, state, peer, tls).await,
                None => accept_http(stream, state, peer).await,
            }
        }
    };
    accept_each(listener, &state, serve).await;
}

/// How one request of a connection is read.
pub(crate) fn connection_builder() -> http1::Builder {
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .header_read_timeout(HEADER_TIMEOUT)
        .max_headers(MAX_HEADERS)
        .max_buf_size(MAX_HEADER_BYTES)
        .auto_date_header(false);
    builder
}

/// Sets what a streaming connection needs; without it things work, only slower.
fn prepare(stream: &TcpStream) {
    let _ = stream.set_nodelay(true);
    #[cfg(any(target_os = "linux", target_os = "android"))]
    let _ = socket2::SockRef::from(stream).set_tcp_notsent_lowat(UNSENT_BYTES);
}

/// An upgrade that was granted, on its way from the request's handler to its connection.
type PendingUpgrade = Arc<Mutex<Option<(OnUpgrade, SessionGuard)>>>;

/// Serves one connection: one request, and a session if it asks for a WebSocket. While others need its slot more, it is
/// dropped without a word.
pub async fn accept_http<S>(stream: S, state: Arc<ServerState>, peer: SocketAddr)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let slot = state.enter_request(peer);
    let (stream, meter) = MeteredStream::new(stream);
    serve_one(stream, meter, state, peer, slot).await;
}

/// The same over TLS. Its bytes are counted below TLS, which makes work of bytes that never come to HTTP.
pub(crate) async fn accept_https<S>(stream: S, state: Arc<ServerState>, peer: SocketAddr, tls: Tls)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let slot = state.enter_request(peer);
    let (stream, meter) = MeteredStream::new(stream);
    let accepted = tokio::select! {
        biased;
        accepted = tls.accept(stream) => accepted,
        () = slot.evicted() => return state.metrics().http_error(),
    };
    match accepted {
        Ok(stream) => serve_one(stream, meter, state, peer, slot).await,
        Err(why) => {
            tracing::debug!(%peer, "no TLS: {why}");
            state.metrics().http_error();
        }
    }
}

async fn serve_one<S>(
    stream: S,
    meter: MeterControl,
    state: Arc<ServerState>,
    peer: SocketAddr,
    slot: PreAuthSlot,
) where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let granted = PendingUpgrade::default();
    let service = service_fn(|mut request: Request<Incoming>| {
        let (state, granted) = (Arc::clone(&state), Arc::clone(&granted));
        async move { Ok::<_, Infallible>(answer(&mut request, &state, peer, &granted).await) }
    });
    let connection = connection_builder().serve_connection(TokioIo::new(stream), service).with_upgrades();
    let served = tokio::select! {
        biased;
        served = timeout(REQUEST_TIMEOUT, connection) => served,
        () = slot.evicted() => return state.metrics().http_error(),
    };
    drop(slot);
    match served {
        Ok(Ok(())) => {}
        Ok(Err(why)) => {
            tracing::debug!(%peer, "no proper request: {why}");
            state.metrics().http_error();
        }
        Err(_) => state.metrics().http_error(),
    }
    let granted = granted.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let Some((upgrade, guard)) = granted
        && let Ok(upgraded) = upgrade.await
    {
        websocket::run_session(TokioIo::new(upgraded), meter, guard).await;
    }
}

pub(crate) type TextResponse = Response<Full<Bytes>>;

pub(crate) fn text(status: StatusCode, body: impl Into<Bytes>) -> TextResponse {
    let mut response = Response::new(Full::new(body.into()));
    *response.status_mut() = status;
    let plain = HeaderValue::from_static("text/plain; charset=utf-8");
    response.headers_mut().insert(header::CONTENT_TYPE, plain);
    // One request a connection. (Turning keep-alive off in hyper would also rewrite an upgrade's answer.)
    response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    response
}

async fn answer(
    request: &mut Request<Incoming>,
    state: &Arc<ServerState>,
    peer: SocketAddr,
    granted: &PendingUpgrade,
) -> TextResponse {
    state.metrics().http_request();
    let path = request.uri().path();
    let name = match path {
        "/" | "/stream" | "/health" | "/ready" | "/scenes" => None,
        // What can be no name is none of a scene.
        path => Some(scene_of_path(path).unwrap_or_else(|| path.to_owned())),
    };
    // Where tokens are asked for, who shows none learns not even whether there is such a scene.
    let open = state.admission().access.is_none();
    if let Some(name) = name.as_deref().filter(|name| open && state.scenes().get(name).is_none()) {
        if lists(request.headers(), &header::UPGRADE, "websocket") {
            state.metrics().session_refused(Refusal::Scene);
        }
        let missing = state.scenes().missing(name, true);
        return text(
            StatusCode::NOT_FOUND,
            format!("{missing}; there are also /health, /ready and /scenes\n"),
        );
    }
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        return wrong_method();
    }
    match path {
        "/health" => health(state),
        "/ready" => ready(state),
        "/scenes" => list(request.headers(), state, peer).await,
        _ => upgrade(request, state, peer, granted, name).await,
    }
}

/// The scenes that the request's token is for, or where none is asked for, all.
async fn list(headers: &HeaderMap, state: &Arc<ServerState>, peer: SocketAddr) -> TextResponse {
    if state.admission().access.is_none() {
        return scenes(state, |_| true);
    }
    let Some(token) = bearer(headers) else { return unauthorised(&TokenError::Missing) };
    let peer = state.admission().proxies.client(peer, headers);
    match state.clone().verify_token(token.to_owned(), None, peer).await {
        Ok(grant) => scenes(state, |name| grant.allows(name)),
        Err(why) => unauthorised(&why),
    }
}

/// A list of scenes, as JSON.
pub(crate) fn scenes(state: &ServerState, listed: impl Fn(&str) -> bool) -> TextResponse {
    let mut response = text(StatusCode::OK, state.scenes().list(listed));
    let json = HeaderValue::from_static("application/json");
    response.headers_mut().insert(header::CONTENT_TYPE, json);
    response
}

/// To a request whose token is not taken (RFC 6750, section 3), or of whose token nothing is known.
fn unauthorised(why: &TokenError) -> TextResponse {
    if *why == TokenError::Unavailable {
        return text(StatusCode::SERVICE_UNAVAILABLE, format!("{why}\n"));
    }
    let mut response = text(StatusCode::UNAUTHORIZED, format!("{why}\n"));
    let asked = match why {
        TokenError::Missing => "Bearer",
        _ => "Bearer error=\"invalid_token\"",
    };
    response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static(asked));
    response
}

pub(crate) fn wrong_method() -> TextResponse {
    let mut response = text(StatusCode::METHOD_NOT_ALLOWED, "only GET is understood\n");
    response.headers_mut().insert(header::ALLOW, HeaderValue::from_static("GET, HEAD"));
    response
}

/// Whether the process is well: to be left alone, also while sessions end.
pub(crate) fn health(state: &ServerState) -> TextResponse {
    text(StatusCode::OK, if state.phase() == Phase::Running { "ok\n" } else { "ok: draining\n" })
}

/// Whether the server takes clients: to be sent some.
pub(crate) fn ready(state: &ServerState) -> TextResponse {
    match state.phase() {
        Phase::Running => text(StatusCode::OK, "ready\n"),
        Phase::Draining => text(
            StatusCode::SERVICE_UNAVAILABLE,
            "draining: the server is shutting down, and no new sessions are taken\n",
        ),
        Phase::Stopped => text(StatusCode::SERVICE_UNAVAILABLE, "stopped: the server is shutting down\n"),
    }
}

/// Whether a comma-separated header names `wanted`.
fn lists(headers: &HeaderMap, name: &HeaderName, wanted: &str) -> bool {
    headers
        .get_all(name)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|item| item.trim().eq_ignore_ascii_case(wanted))
}

/// The token of a request (RFC 6750, section 2.1).
fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}

/// The server's part of the opening handshake (RFC 6455 §4.2).
async fn upgrade(
    request: &mut Request<Incoming>,
    state: &Arc<ServerState>,
    peer: SocketAddr,
    granted: &PendingUpgrade,
    name: Option<String>,
) -> TextResponse {
    let headers = request.headers();
    let peer = state.admission().proxies.client(peer, headers);
    let asks = *request.method() == Method::GET
        && lists(headers, &header::CONNECTION, "upgrade")
        && lists(headers, &header::UPGRADE, "websocket");
    if !asks {
        let hint = "this is a Lodestream server: open this address with a viewer, as ws://HOST:PORT or wss://HOST:PORT\n";
        let mut response = text(StatusCode::UPGRADE_REQUIRED, hint);
        response.headers_mut().insert(header::UPGRADE, HeaderValue::from_static("websocket"));
        return response;
    }
    if let Err(origin) = state.admission().origins.check(headers) {
        state.metrics().session_refused(Refusal::Origin);
        tracing::info!(%peer, ?origin, "session refused: a web page that --allow-origin does not name");
        return text(
            StatusCode::FORBIDDEN,
            "web pages may open sessions where the server's --allow-origin names them\n",
        );
    }
    if !lists(headers, &header::SEC_WEBSOCKET_VERSION, "13") {
        let mut response = text(StatusCode::UPGRADE_REQUIRED, "only WebSocket version 13 is understood\n");
        response.headers_mut().insert(header::SEC_WEBSOCKET_VERSION, HeaderValue::from_static("13"));
        return response;
    }
    let Some(key) = headers.get(header::SEC_WEBSOCKET_KEY).filter(|key| key.len() == 24) else {
        return text(StatusCode::BAD_REQUEST, "Sec-WebSocket-Key is missing or malformed\n");
    };
    let Ok(accept) = HeaderValue::from_str(&derive_accept_key(key.as_bytes())) else {
        return text(StatusCode::BAD_REQUEST, "Sec-WebSocket-Key is malformed\n");
    };
    // A client may offer no subprotocol; if it offers some, ours must be among them.
    let offers = headers.contains_key(header::SEC_WEBSOCKET_PROTOCOL);
    if offers && !lists(headers, &header::SEC_WEBSOCKET_PROTOCOL, ALPN) {
        return text(StatusCode::BAD_REQUEST, format!("the only subprotocol here is {ALPN}\n"));
    }
    // Who sends none here may still do so in a message.
    let grant = match bearer(headers).filter(|_| state.admission().access.is_some()) {
        None => None,
        Some(token) => {
            let scene = name.clone().or_else(|| state.scenes().only().map(|only| only.name().to_owned()));
            match state.clone().verify_token(token.to_owned(), scene, peer).await {
                Ok(grant) => Some(grant),
                Err(why) => {
                    if why != TokenError::Unavailable {
                        state.metrics().session_refused(Refusal::Token);
                    }
                    tracing::info!(%peer, "session refused: {why}");
                    return unauthorised(&why);
                }
            }
        }
    };
    let guard = match SessionGuard::begin(state, Transport::WebSocket, peer) {
        Ok(mut guard) => {
            (guard.requested_scene, guard.grant) = (name, grant);
            guard
        }
        Err(why) => {
            tracing::info!(%peer, "session refused: {why}");
            return text(StatusCode::SERVICE_UNAVAILABLE, format!("{why}\n"));
        }
    };
    let pending = hyper::upgrade::on(request);
    *granted.lock().unwrap_or_else(PoisonError::into_inner) = Some((pending, guard));
    let mut response = Response::new(Full::default());
    *response.status_mut() = StatusCode::SWITCHING_PROTOCOLS;
    let headers = response.headers_mut();
    headers.insert(header::CONNECTION, HeaderValue::from_static("upgrade"));
    headers.insert(header::UPGRADE, HeaderValue::from_static("websocket"));
    headers.insert(header::SEC_WEBSOCKET_ACCEPT, accept);
    if offers {
        headers.insert(header::SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(ALPN));
    }
    response
}
