//! The public HTTP port, with or without TLS: `/health`, `/ready`, `/scenes`, the page for browsers, and the upgrade to
//! WebSocket. The path `/NAME` names a scene; `/` and `/stream` stand for the only scene, or for the one that `Hello`
//! names. Without an upgrade, `/` and `/NAME` are the page.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use hyper::body::Incoming;
use hyper::header::{self, HeaderMap};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use lodestream_protocol::stream::scene_of_path;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};

use crate::auth::grant::TokenError;
use crate::http::paced_body::{PacedBody, Progress};
use crate::http::responses::{
    TextResponse, bearer, header_contains, health, ready, scene_list, text, unauthorised, wrong_method,
};
use crate::http::upgrade::{PendingUpgrade, is_upgrade, upgrade};
use crate::limits::byte_rate::{MeterControl, metered};
use crate::limits::pre_auth_pool::PreAuthSlot;
use crate::limits::refusal::Refusal;
use crate::session::state::ServerState;
use crate::transport::listen::accept_each;
use crate::transport::tls::Tls;
use crate::transport::websocket;

/// Time limit for a request's head, against slow senders.
const HEADER_TIMEOUT: Duration = Duration::from_secs(5);
/// Time limit for a request and its response, or for the next piece of the page.
pub(crate) const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// Time limit for all requests of a connection, which a browser uses for several files of the page.
const CONNECTION_TIMEOUT: Duration = Duration::from_secs(300);
/// Longest request head, in bytes.
const MAX_HEADER_BYTES: usize = 16 * 1024;
/// Most header fields in a request.
const MAX_HEADERS: usize = 64;
/// Unsent bytes that the kernel may buffer on a connection (`TCP_NOTSENT_LOWAT`). Buffered data cannot be overtaken.
#[cfg(any(target_os = "linux", target_os = "android"))]
const UNSENT_BYTES: u32 = 16 * 1024;

/// Serves a listener until the daemon stops, also while it drains. The state's pre-auth pools and leases bound the
/// connections; evicted ones end at once.
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

/// Settings of HTTP connections.
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

/// Sets socket options for streaming. Errors are ignored: they only cost latency.
fn prepare(stream: &TcpStream) {
    let _ = stream.set_nodelay(true);
    #[cfg(any(target_os = "linux", target_os = "android"))]
    let _ = socket2::SockRef::from(stream).set_tcp_notsent_lowat(UNSENT_BYTES);
}

/// Serves one connection: requests for the page's files, one other request, and a session if it upgrades to WebSocket. A connection that is evicted from the
/// pre-auth pool is dropped without a response.
pub async fn accept_http<S>(stream: S, state: Arc<ServerState>, peer: SocketAddr)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let slot = state.enter_request(peer);
    let (stream, meter) = metered(stream);
    serve_one(stream, meter, state, peer, slot).await;
}

/// Serves one connection over TLS. The byte rate limit counts bytes below TLS, since they cost work even if none reach
/// HTTP.
pub(crate) async fn accept_https<S>(stream: S, state: Arc<ServerState>, peer: SocketAddr, tls: Tls)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let slot = state.enter_request(peer);
    let (stream, meter) = metered(stream);
    let accepted = tokio::select! {
        biased;
        accepted = tls.accept(stream) => accepted,
        () = slot.evicted() => return state.metrics().http_error(),
    };
    match accepted {
        Ok(stream) => serve_one(stream, meter, state, peer, slot).await,
        Err(why) => {
            tracing::debug!(%peer, "TLS handshake failed: {why}");
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
    let pending_upgrade = PendingUpgrade::default();
    let progress = Progress::start();
    let service = service_fn(|mut request: Request<Incoming>| {
        let (state, pending_upgrade) = (Arc::clone(&state), Arc::clone(&pending_upgrade));
        let progress = progress.clone();
        async move {
            let response = answer(&mut request, &state, peer, &pending_upgrade).await;
            Ok::<_, Infallible>(response.map(|body| PacedBody::new(body, progress)))
        }
    });
    let connection = connection_builder().serve_connection(TokioIo::new(stream), service).with_upgrades();
    let served = tokio::select! {
        biased;
        served = progress.limit(connection, REQUEST_TIMEOUT, CONNECTION_TIMEOUT) => served,
        () = slot.evicted() => return state.metrics().http_error(),
    };
    drop(slot);
    match served {
        Some(Ok(())) => {}
        Some(Err(why)) => {
            tracing::debug!(%peer, "invalid request: {why}");
            state.metrics().http_error();
        }
        None => state.metrics().http_error(),
    }
    let pending_upgrade = pending_upgrade.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let Some((upgrade, guard)) = pending_upgrade
        && let Ok(upgraded) = upgrade.await
    {
        websocket::run_session(TokioIo::new(upgraded), meter, guard).await;
    }
}

async fn answer(
    request: &mut Request<Incoming>,
    state: &Arc<ServerState>,
    peer: SocketAddr,
    pending_upgrade: &PendingUpgrade,
) -> TextResponse {
    state.metrics().http_request();
    let path = request.uri().path();
    let reads = matches!(*request.method(), Method::GET | Method::HEAD);
    if reads && let Some(file) = state.site().file(state, path, request.headers()) {
        return file;
    }
    let name = match path {
        "/" | "/stream" | "/health" | "/ready" | "/scenes" => None,
        // A malformed path is reported as an unknown scene.
        path => Some(scene_of_path(path).unwrap_or_else(|| path.to_owned())),
    };
    // If tokens are required, a client without one must not learn whether a scene exists.
    let public = state.admission().access.is_none();
    if let Some(name) = name.as_deref().filter(|name| public && state.scenes().get(name).is_none()) {
        if header_contains(request.headers(), &header::UPGRADE, "websocket") {
            state.metrics().session_refused(Refusal::Scene);
        }
        let missing = state.scenes().missing(name, true);
        return text(
            StatusCode::NOT_FOUND,
            format!("{missing}; other paths are /health, /ready and /scenes\n"),
        );
    }
    if !reads {
        return wrong_method();
    }
    match path {
        "/health" => health(state),
        "/ready" => ready(state),
        "/scenes" => list(request.headers(), state, peer).await,
        "/stream" => upgrade(request, state, peer, pending_upgrade, name).await,
        _ => {
            let page = if is_upgrade(request.headers()) {
                None
            } else {
                state.site().index(state, name.as_deref(), request.headers()).await
            };
            match page {
                Some(page) => page,
                None => upgrade(request, state, peer, pending_upgrade, name).await,
            }
        }
    }
}

/// The list of scenes: those that the request's token covers, or all if no token is required.
async fn list(headers: &HeaderMap, state: &Arc<ServerState>, peer: SocketAddr) -> TextResponse {
    if state.admission().access.is_none() {
        return scene_list(state, |_| true);
    }
    let Some(token) = bearer(headers) else { return unauthorised(&TokenError::Missing) };
    let peer = state.admission().proxies.client(peer, headers);
    match state.clone().verify_token(token.to_owned(), None, peer).await {
        Ok(grant) => scene_list(state, |name| grant.allows(name)),
        Err(why) => unauthorised(&why),
    }
}
