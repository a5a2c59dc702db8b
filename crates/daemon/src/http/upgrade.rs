//! The upgrade to WebSocket: origin, handshake, token, session.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};

use http_body_util::Full;
use hyper::body::Incoming;
use hyper::header::{self, HeaderMap, HeaderValue};
use hyper::upgrade::OnUpgrade;
use hyper::{Method, Request, Response, StatusCode};
use lodestream_protocol::stream::{ALPN, RESUME_QUERY};
use tokio_tungstenite::tungstenite::handshake::derive_accept_key;

use crate::auth::grant::TokenError;
use crate::http::origin::is_same_origin;
use crate::http::responses::{TextResponse, bearer, header_contains, text, unauthorised};
use crate::limits::refusal::Refusal;
use crate::metrics::Transport;
use crate::session::guard::SessionGuard;
use crate::session::state::ServerState;

/// Slot in which the request handler leaves an accepted upgrade for its connection.
pub(crate) type PendingUpgrade = Arc<Mutex<Option<(OnUpgrade, SessionGuard)>>>;

/// Whether a request asks for WebSocket.
pub(crate) fn is_upgrade(headers: &HeaderMap) -> bool {
    header_contains(headers, &header::CONNECTION, "upgrade")
        && header_contains(headers, &header::UPGRADE, "websocket")
}

/// Performs the server's part of the opening handshake (RFC 6455 §4.2) and starts a session for `name`.
pub(crate) async fn upgrade(
    request: &mut Request<Incoming>,
    state: &Arc<ServerState>,
    peer: SocketAddr,
    pending_upgrade: &PendingUpgrade,
    name: Option<String>,
) -> TextResponse {
    let headers = request.headers();
    let peer = state.admission().proxies.client(peer, headers);
    if *request.method() != Method::GET || !is_upgrade(headers) {
        let hint = "this is a Lodestream server: open this address with a viewer, as ws://HOST:PORT or wss://HOST:PORT\n";
        let mut response = text(StatusCode::UPGRADE_REQUIRED, hint);
        response.headers_mut().insert(header::UPGRADE, HeaderValue::from_static("websocket"));
        return response;
    }
    let own = |origin: &str| state.site().has_page() && is_same_origin(origin, headers);
    if let Some(origin) = state.admission().origins.refused(headers, own) {
        state.metrics().session_refused(Refusal::Origin);
        tracing::info!(%peer, ?origin, "session refused: a web page that --allow-origin does not name");
        return text(
            StatusCode::FORBIDDEN,
            "this web page may not open sessions: the server's --allow-origin does not name its origin (the server's \
             own page may if it is opened by IP address, as localhost, by a name without dots, or over https)\n",
        );
    }
    if !header_contains(headers, &header::SEC_WEBSOCKET_VERSION, "13") {
        let mut response = text(StatusCode::UPGRADE_REQUIRED, "only WebSocket version 13 is supported\n");
        response.headers_mut().insert(header::SEC_WEBSOCKET_VERSION, HeaderValue::from_static("13"));
        return response;
    }
    let Some(key) = headers.get(header::SEC_WEBSOCKET_KEY).filter(|key| key.len() == 24) else {
        return text(StatusCode::BAD_REQUEST, "Sec-WebSocket-Key is missing or malformed\n");
    };
    let Ok(accept) = HeaderValue::from_str(&derive_accept_key(key.as_bytes())) else {
        return text(StatusCode::BAD_REQUEST, "Sec-WebSocket-Key is malformed\n");
    };
    // A client may offer no subprotocol; if it offers any, ours must be among them.
    let offers = headers.contains_key(header::SEC_WEBSOCKET_PROTOCOL);
    if offers && !header_contains(headers, &header::SEC_WEBSOCKET_PROTOCOL, ALPN) {
        return text(StatusCode::BAD_REQUEST, format!("the only supported subprotocol is {ALPN}\n"));
    }
    // Without a token in the request, the client may send one in a message.
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
            guard.resumes = request.uri().query() == Some(RESUME_QUERY);
            guard
        }
        Err(why) => {
            tracing::info!(%peer, "session refused: {why}");
            return text(StatusCode::SERVICE_UNAVAILABLE, format!("{why}\n"));
        }
    };
    let pending = hyper::upgrade::on(request);
    *pending_upgrade.lock().unwrap_or_else(PoisonError::into_inner) = Some((pending, guard));
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
