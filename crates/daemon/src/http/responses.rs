//! Responses that the public and the administration port share.

use bytes::Bytes;
use http_body_util::Full;
use hyper::header::{self, HeaderMap, HeaderName, HeaderValue};
use hyper::{Response, StatusCode};

use crate::auth::grant::TokenError;
use crate::session::state::{Phase, ServerState};

/// A response with a complete body.
pub(crate) type TextResponse = Response<Full<Bytes>>;

/// A text response; the connection closes after it.
pub(crate) fn text(status: StatusCode, body: impl Into<Bytes>) -> TextResponse {
    let mut response = Response::new(Full::new(body.into()));
    *response.status_mut() = status;
    let plain = HeaderValue::from_static("text/plain; charset=utf-8");
    response.headers_mut().insert(header::CONTENT_TYPE, plain);
    // One request per connection. (Disabling keep-alive in hyper would also rewrite the response to an upgrade.)
    response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    response
}

/// The scenes for which `listed` returns true, as JSON.
pub(crate) fn scene_list(state: &ServerState, listed: impl Fn(&str) -> bool) -> TextResponse {
    let mut response = text(StatusCode::OK, state.scenes().list(listed));
    let json = HeaderValue::from_static("application/json");
    response.headers_mut().insert(header::CONTENT_TYPE, json);
    response
}

/// Response to a request whose token is refused (RFC 6750, section 3) or cannot be verified.
pub(crate) fn unauthorised(why: &TokenError) -> TextResponse {
    if *why == TokenError::Unavailable {
        return text(StatusCode::SERVICE_UNAVAILABLE, format!("{why}\n"));
    }
    let mut response = text(StatusCode::UNAUTHORIZED, format!("{why}\n"));
    let challenge = match why {
        TokenError::Missing => "Bearer",
        _ => "Bearer error=\"invalid_token\"",
    };
    response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static(challenge));
    response
}

/// Response to a method other than GET and HEAD.
pub(crate) fn wrong_method() -> TextResponse {
    let mut response = text(StatusCode::METHOD_NOT_ALLOWED, "only GET is supported\n");
    response.headers_mut().insert(header::ALLOW, HeaderValue::from_static("GET, HEAD"));
    response
}

/// Liveness: always OK, also while draining.
pub(crate) fn health(state: &ServerState) -> TextResponse {
    text(StatusCode::OK, if state.phase() == Phase::Running { "ok\n" } else { "ok: draining\n" })
}

/// Readiness: whether the server admits clients.
pub(crate) fn ready(state: &ServerState) -> TextResponse {
    match state.phase() {
        Phase::Running => text(StatusCode::OK, "ready\n"),
        Phase::Draining => text(
            StatusCode::SERVICE_UNAVAILABLE,
            "draining: the server is shutting down, and no new sessions are admitted\n",
        ),
        Phase::Stopped => text(StatusCode::SERVICE_UNAVAILABLE, "stopped: the server is shutting down\n"),
    }
}

/// Whether a comma-separated header contains `wanted`.
pub(crate) fn header_contains(headers: &HeaderMap, name: &HeaderName, wanted: &str) -> bool {
    headers
        .get_all(name)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .any(|item| item.trim().eq_ignore_ascii_case(wanted))
}

/// The bearer token of a request (RFC 6750, section 2.1).
pub(crate) fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, token) = headers.get(header::AUTHORIZATION)?.to_str().ok()?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim())
}
