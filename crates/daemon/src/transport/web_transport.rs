//! WebTransport over HTTP/3 (draft-ietf-webtrans-http3), for browsers: the `CONNECT` request that opens a session. The
//! session's streams carry the same bytes as our own QUIC connections.
//!
//! A connection serves this one request and no other. HTTP/3's control stream is sent before the handshake is complete, so
//! that the client need not wait for the settings; the session's first bytes follow the answer to `CONNECT` at once.

use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use bytes::BufMut as _;
use hyper::StatusCode;
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::stream::{RESUME_QUERY, scene_of_path};
use quinn::{Connection, VarInt};
use tokio::time::timeout;
use web_transport_proto as h3;

use crate::auth::grant::TokenError;
use crate::http::origin::is_own_name;
use crate::http::responses::bearer;
use crate::limits::refusal::Refusal;
use crate::session::guard::SessionGuard;
use crate::session::state::{Phase, ServerState};
use crate::transport::web_session::WebSession;

/// ALPN name of HTTP/3.
pub(crate) const H3_ALPN: &[u8] = b"h3";
/// Streams that a client may open: `CONNECT`; HTTP/3's control stream and the two of header compression, one of reserved
/// type (RFC 9114, section 6.2.3), and our control stream, with some to spare.
pub(crate) const BIDIRECTIONAL_STREAMS: u32 = 1;
pub(crate) const UNIDIRECTIONAL_STREAMS: u32 = 8;
/// Datagrams must be enabled (RFC 9297), but we use none: room for one. Later ones replace it.
pub(crate) const DATAGRAM_BYTES: usize = 2048;
/// Time limit for `CONNECT`, as for `Hello`.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// `H3_REQUEST_REJECTED` (RFC 9114, section 8.1).
const REQUEST_REJECTED: VarInt = VarInt::from_u32(0x10b);

/// Settings of the server's side of HTTP/3 (RFC 9114, section 7.2.4.1), as the drafts that browsers follow demand.
const SETTINGS: [(h3::Setting, u32); 7] = [
    (h3::Setting::MAX_FIELD_SECTION_SIZE, 16 * 1024),
    (h3::Setting::ENABLE_CONNECT_PROTOCOL, 1),
    (h3::Setting::ENABLE_DATAGRAM, 1),
    (h3::Setting::ENABLE_DATAGRAM_DEPRECATED, 1),
    (h3::Setting::WEBTRANSPORT_ENABLE_DEPRECATED, 1),
    (h3::Setting::WEBTRANSPORT_MAX_SESSIONS_DEPRECATED, 1),
    (h3::Setting::WEBTRANSPORT_MAX_SESSIONS, 1),
];

/// The first bytes of our control stream.
fn settings() -> Vec<u8> {
    let (mut body, mut out) = (Vec::new(), Vec::new());
    for (setting, value) in SETTINGS {
        setting.encode(&mut body);
        h3::VarInt::from_u32(value).encode(&mut body);
    }
    h3::StreamUni::CONTROL.encode(&mut out);
    h3::Frame::SETTINGS.encode(&mut out);
    // A byte, as the body is short.
    out.put_u8(u8::try_from(body.len()).unwrap_or(0));
    out.extend_from_slice(&body);
    out
}

/// Accepts the client's session and learns its scene and token from `CONNECT`; `None` if the connection has ended.
/// Meanwhile waits for `handshake`.
pub(crate) async fn accept(
    connection: &Connection,
    guard: &mut SessionGuard,
    handshake: impl Future<Output = ()>,
) -> Option<WebSession> {
    let state = Arc::clone(&guard.state);
    let connected = async {
        let mut control = connection.open_uni().await.ok()?;
        // Before the session's data.
        let _ = control.set_priority(i32::MAX);
        control.write_all(&settings()).await.ok()?;
        let (answer, mut request) = connection.accept_bi().await.ok()?;
        let _ = answer.set_priority(i32::MAX);
        let connect = h3::ConnectRequest::read(&mut request).await;
        Some((WebSession { connection: connection.clone(), answer, request, _control: control }, connect))
    };
    let evicted = tokio::select! {
        biased;
        () = state.wait_for_phase(Phase::Draining) => Err((CloseCode::ShuttingDown, "the server is shutting down")),
        why = guard.evicted() => Err((CloseCode::Busy, why)),
        connected = timeout(CONNECT_TIMEOUT, after(handshake, connected)) => {
            connected.map_err(|_| (CloseCode::Timeout, "no CONNECT within 10 seconds"))
        }
    };
    let (session, connect) = match evicted {
        Ok(connected) => connected?,
        Err((code, why)) => {
            guard.close_code = code;
            tracing::info!("session refused: {why}");
            connection.close(REQUEST_REJECTED, why.as_bytes());
            return None;
        }
    };
    let verdict = match connect {
        Ok(connect) => judge(&connect, guard).await,
        Err(why) => Err((StatusCode::BAD_REQUEST, why.to_string())),
    };
    match verdict {
        Ok(()) => session.answered().await,
        Err((status, why)) => {
            guard.close_code = CloseCode::Protocol;
            tracing::info!("session refused: {why}");
            session.refuse(status, &why).await;
            None
        }
    }
}

/// Runs both; the result comes after the handshake, unless it is `None`.
async fn after<T>(
    handshake: impl Future<Output = ()>,
    connected: impl Future<Output = Option<T>>,
) -> Option<T> {
    let (mut handshake, mut connected) = (pin!(handshake), pin!(connected));
    let result = tokio::select! {
        biased;
        () = handshake.as_mut() => return connected.await,
        result = connected.as_mut() => result?,
    };
    handshake.await;
    Some(result)
}

/// Judges a request as the WebSocket upgrade does: its path names the scene, its origin must be allowed, and it may carry
/// a token, which browsers cannot set here.
async fn judge(connect: &h3::ConnectRequest, guard: &mut SessionGuard) -> Result<(), (StatusCode, String)> {
    let state = Arc::clone(&guard.state);
    let own = |origin: &str| is_own_origin(origin, connect.url.host_str(), &state);
    if let Some(origin) = state.admission().origins.refused(&connect.headers, own) {
        state.metrics().session_refused(Refusal::Origin);
        let why = format!("a web page of {origin:?}, which --allow-origin does not name");
        return Err((StatusCode::FORBIDDEN, why));
    }
    let path = connect.url.path();
    let name = match path {
        "/" | "/stream" => None,
        path => Some(scene_of_path(path).unwrap_or_else(|| path.to_owned())),
    };
    let access = state.admission().access.clone();
    // If tokens are required, a client without one must not learn whether a scene exists.
    if let Some(name) = name.as_deref().filter(|name| access.is_none() && state.scenes().get(name).is_none())
    {
        state.metrics().session_refused(Refusal::Scene);
        return Err((StatusCode::NOT_FOUND, state.scenes().missing(name, true)));
    }
    if let Some(token) = bearer(&connect.headers).filter(|_| access.is_some()) {
        let scene = name.clone().or_else(|| state.scenes().only().map(|only| only.name().to_owned()));
        match Arc::clone(&state).verify_token(token.to_owned(), scene, guard.peer).await {
            Ok(grant) => guard.grant = Some(grant),
            Err(why) if why == TokenError::Unavailable => {
                return Err((StatusCode::SERVICE_UNAVAILABLE, why.to_string()));
            }
            Err(why) => {
                state.metrics().session_refused(Refusal::Token);
                return Err((StatusCode::UNAUTHORIZED, why.to_string()));
            }
        }
    }
    guard.requested_scene = name;
    guard.resumes = connect.url.query() == Some(RESUME_QUERY);
    Ok(())
}

/// Whether an origin is that of the server's own page, which is on the HTTP port of the same host.
fn is_own_origin(origin: &str, host: Option<&str>, state: &ServerState) -> bool {
    let (site, Some(host), Some((scheme, of_page))) = (state.site(), host, origin.split_once("://")) else {
        return false;
    };
    let default_port = if scheme == "https" { 443 } else { 80 };
    let own = site.http_port.is_some_and(|port| {
        of_page.eq_ignore_ascii_case(&format!("{host}:{port}"))
            || (port == default_port && of_page.eq_ignore_ascii_case(host))
    });
    own && site.has_page() && is_own_name(scheme, of_page)
}
