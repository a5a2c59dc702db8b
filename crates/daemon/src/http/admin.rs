//! The administration port: `/health`, `/ready`, `/metrics` and `/scenes`. Its connections have a pool of their own, so it
//! responds while the public port is flooded.

use std::convert::Infallible;
use std::net::{Ipv4Addr, SocketAddr};
use std::str::FromStr;
use std::sync::Arc;

use hyper::body::Incoming;
use hyper::header::{self, HeaderValue};
use hyper::service::service_fn;
use hyper::{Method, Request, StatusCode};
use hyper_util::rt::TokioIo;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::time::timeout;

use crate::http::responses::{TextResponse, health, ready, scene_list, text, wrong_method};
use crate::http::server::{REQUEST_TIMEOUT, connection_builder};
use crate::limits::invalid_setting::InvalidSetting;
use crate::limits::pre_auth_pool::PreAuthPool;
use crate::session::state::ServerState;
use crate::transport::listen::{accept_each, listen_tcp};

/// Address of the administration port, which untrusted peers should not reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdminPort {
    /// No such port.
    Off,
    /// This address; port 0 for any free port.
    At(SocketAddr),
    /// 127.0.0.1:8081, or any free port of 127.0.0.1 if that one is taken.
    Standard,
}

impl FromStr for AdminPort {
    type Err = InvalidSetting;

    fn from_str(text: &str) -> Result<Self, InvalidSetting> {
        if text.eq_ignore_ascii_case("off") {
            return Ok(Self::Off);
        }
        let expected = |_| InvalidSetting::new(text, "an address", "for example 127.0.0.1:8081, or off");
        text.parse().map(Self::At).map_err(expected)
    }
}

impl AdminPort {
    /// Binds the address.
    pub(crate) fn listen(self) -> anyhow::Result<Option<TcpListener>> {
        let loopback = |port| listen_tcp(SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
        match self {
            Self::Off => Ok(None),
            Self::At(address) => listen_tcp(address).map(Some),
            Self::Standard => loopback(STANDARD_PORT).or_else(|_| loopback(0)).map(Some),
        }
    }
}

/// Default port.
const STANDARD_PORT: u16 = 8081;
/// Most connections at once: monitoring sends few requests.
const MAX_REQUESTS: usize = 64;

/// Serves a listener until the daemon stops, also while it drains.
pub(crate) async fn serve_admin(listener: TcpListener, state: Arc<ServerState>) {
    let pool = PreAuthPool::new(MAX_REQUESTS);
    let stopped = Arc::clone(&state);
    accept_each(listener, &stopped, move |stream, peer| {
        serve_one(stream, Arc::clone(&state), Arc::clone(&pool), peer)
    })
    .await;
}

/// Serves one request.
pub(crate) async fn serve_one<S>(stream: S, state: Arc<ServerState>, pool: Arc<PreAuthPool>, peer: SocketAddr)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let slot = pool.enter(peer.ip());
    let service = service_fn(|request: Request<Incoming>| {
        let response = answer(&request, &state);
        async move { Ok::<_, Infallible>(response) }
    });
    let connection = connection_builder().serve_connection(TokioIo::new(stream), service);
    // Errors concern only the requester.
    tokio::select! {
        biased;
        _ = timeout(REQUEST_TIMEOUT, connection) => {}
        () = slot.evicted() => {}
    }
}

fn answer(request: &Request<Incoming>, state: &ServerState) -> TextResponse {
    let path = request.uri().path();
    if !matches!(path, "/health" | "/ready" | "/metrics" | "/scenes") {
        return text(StatusCode::NOT_FOUND, "not found: try /health, /ready, /metrics or /scenes\n");
    }
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        return wrong_method();
    }
    match path {
        "/health" => return health(state),
        "/ready" => return ready(state),
        "/scenes" => return scene_list(state, |_| true),
        _ => {}
    }
    let mut response = text(StatusCode::OK, state.render_metrics());
    let version = HeaderValue::from_static("text/plain; version=0.0.4; charset=utf-8");
    response.headers_mut().insert(header::CONTENT_TYPE, version);
    response
}
