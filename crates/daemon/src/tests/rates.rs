//! Shared rate limits, per address and in all.

use std::future::Future;

use lodestream_protocol::limiter::LimiterConfig;
use lodestream_protocol::message::Token;
use tokio::time::{Instant, sleep_until, timeout_at};
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;

use super::*;
use crate::http::proxy::Network;
use crate::metrics::Transport;
use crate::session::admission_settings::AdmissionSettings;
use crate::session::guard::SessionGuard;
use crate::tests::tokens::{in_s, requiring_tokens_with, signed_claims, with_header};

const MBIT: u64 = 1_000_000;

fn sharing(per_address: Option<u64>, total: Option<u64>) -> SessionSettings {
    SessionSettings {
        rate_per_address_bits_per_s: per_address,
        total_rate_bits_per_s: total,
        ..SessionSettings::default()
    }
}

/// Nearly 4 MB of textures.
fn scene() -> MemoryScene {
    MemoryScene::new(8, 1000, 60_000)
}

fn from(n: u8) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::new(10, 0, 0, n), 50_000))
}

/// A client that has sent `Hello`.
async fn greeted(client: impl Future<Output = Result<Client<DuplexStream>, String>>) -> Client<DuplexStream> {
    let mut client = client.await.unwrap();
    client.send(&hello()).await;
    client
}

/// Requests everything and reads until `end`; returns the bits received after `begin`, as limiters count them.
async fn received_bits(mut client: Client<DuplexStream>, begin: Instant, end: Instant) -> u64 {
    let limiter = LimiterConfig::websocket(None);
    client.send(&want_textures(8)).await;
    let mut bytes = 0;
    while let Ok(frame) = timeout_at(end, client.next()).await {
        if let ServerFrame::Piece(piece) = frame.expect("closed")
            && Instant::now() >= begin
        {
            bytes += limiter.wire_bytes(piece.bytes.len());
        }
    }
    8 * bytes
}

/// Rate of each client in Mbit/s, over three seconds that begin one second after the start.
async fn measured_rates(clients: Vec<Client<DuplexStream>>) -> Vec<f64> {
    let begin = Instant::now() + Duration::from_secs(1);
    let end = begin + Duration::from_secs(3);
    let all: Vec<_> =
        clients.into_iter().map(|client| tokio::spawn(received_bits(client, begin, end))).collect();
    let mut parts = Vec::new();
    for one in all {
        parts.push(one.await.unwrap() as f64 / (3 * MBIT) as f64);
    }
    parts
}

#[track_caller]
fn near(parts: &[f64], expected: &[f64]) {
    let near = parts.iter().zip(expected).all(|(part, expected)| (part / expected - 1.0).abs() <= 0.02);
    assert!(near && parts.len() == expected.len(), "{parts:?} for {expected:?}");
}

#[tokio::test(start_paused = true)]
async fn all_sessions_share_one_rate_and_those_of_an_address_another() {
    let state = ServerState::new(Arc::new(scene()), sharing(Some(2 * MBIT), Some(5 * MBIT)));
    let mut clients = Vec::new();
    for n in [1, 1, 1, 1, 2, 3, 3] {
        clients.push(greeted(Client::from(from(n), &state)).await);
    }
    // Three addresses share 5 Mbit/s: an address with few sessions gets no more than its own limit.
    let parts = measured_rates(clients).await;
    near(&parts, &[0.5, 0.5, 0.5, 0.5, 1.0, 1.0, 1.0]);
    let text = state.render_metrics();
    for line in [
        "lodestream_rate_per_address_bits_per_second 2000000",
        "lodestream_total_rate_bits_per_second 5000000",
        "lodestream_rate_bits_per_second 0",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    }
}

#[tokio::test(start_paused = true)]
async fn the_assigned_rate_is_reported_while_data_is_queued() {
    let state = ServerState::new(Arc::new(scene()), sharing(None, Some(2 * MBIT)));
    let given = |bits: u64| {
        let line = format!("lodestream_given_rate_bits_per_second {bits}");
        let text = state.render_metrics();
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    };
    given(0);
    let client = greeted(Client::from(peer(), &state)).await;
    let now = Instant::now();
    let reading = tokio::spawn(received_bits(client, now, now + Duration::from_secs(2)));
    sleep_until(now + Duration::from_secs(1)).await;
    given(2 * MBIT);
    reading.await.unwrap();
    state.all_sessions_ended().await;
    tokio::time::advance(Duration::from_secs(1)).await;
    given(0);
}

#[tokio::test(start_paused = true)]
async fn clients_behind_a_trusted_proxy_share_the_rate_of_their_own_address() {
    let admission = AdmissionSettings {
        proxies: ["10.0.0.9".parse::<Network>().unwrap()].into_iter().collect(),
        ..AdmissionSettings::default()
    };
    let state = ServerState::with_admission(Arc::new(scene()), sharing(Some(MBIT), None), admission);
    let mut clients = Vec::new();
    for forwarded_for in ["203.0.113.1", "2001:db8:1:2::1", "2001:db8:1:2::7"] {
        let (near, far) = duplex(64 * 1024);
        tokio::spawn(accept_http(far, Arc::clone(&state), from(9)));
        let mut request = "ws://server/stream".into_client_request().unwrap();
        request.headers_mut().insert("X-Forwarded-For", HeaderValue::from_str(forwarded_for).unwrap());
        let opened = tokio_tungstenite::client_async(request, near).await;
        let opened = opened.map(|(socket, _)| Client(socket)).map_err(|why| why.to_string());
        clients.push(greeted(std::future::ready(opened)).await);
    }
    near(&measured_rates(clients).await, &[1.0, 0.5, 0.5]);
}

#[tokio::test(start_paused = true)]
async fn a_token_sets_weight_and_rate() {
    let state = requiring_tokens_with(scene(), sharing(None, Some(8 * MBIT)));
    let token = |more: &str| signed_claims(&format!(r#"{{"exp":{},"scene":"memory"{more}}}"#, in_s(600)));
    let mut clients = Vec::new();
    for more in [r#","weight":2"#, r#","weight":5"#, "", r#","weight":100,"rate":1600000"#] {
        clients.push(greeted(with_header(&state, &token(more))).await);
    }
    near(&measured_rates(clients).await, &[1.6, 4.0, 0.8, 1.6]);
    // A newer token replaces the old one, and one without claims resets weight and rate.
    let mut clients = Vec::new();
    for (first, second) in
        [(r#","weight":100"#, r#","weight":3"#), (r#","rate":1000"#, r#","weight":3"#), ("", "")]
    {
        let mut client = greeted(with_header(&state, &token(first))).await;
        client.send(&ClientMessage::Token(Token(token(second)))).await;
        clients.push(client);
    }
    let parts = measured_rates(clients).await;
    near(&parts, &[24.0 / 7.0, 24.0 / 7.0, 8.0 / 7.0]);
}

#[tokio::test(start_paused = true)]
async fn an_address_that_is_not_validated_is_not_charged() {
    let state = ServerState::new(Arc::new(scene()), sharing(Some(MBIT), None));
    let mut guard = SessionGuard::begin(&state, Transport::Quic, from(1)).unwrap();
    assert_eq!(guard.group(), None);
    guard.count_for_address().unwrap();
    let proved = guard.group();
    assert!(proved.is_some());
    guard.set_peer(SocketAddr::from((Ipv4Addr::new(10, 0, 0, 1), 9)));
    assert_eq!(guard.group(), proved, "another port is the same address");
    guard.set_peer(from(2));
    assert!(guard.group().is_some() && guard.group() != proved);
    let over_tcp = SessionGuard::begin(&state, Transport::WebSocket, from(1)).unwrap();
    assert_eq!(over_tcp.group(), proved);
}

#[tokio::test(start_paused = true)]
async fn changed_settings_apply_to_new_sessions_and_shared_limits_to_all() {
    let state = ServerState::new(Arc::new(scene()), sharing(None, Some(2 * MBIT)));
    let old = greeted(Client::from(from(1), &state)).await;
    let settings =
        SessionSettings { rate_bits_per_s: Some(MBIT), max_sessions: 2, ..sharing(None, Some(4 * MBIT)) };
    state.update_settings(settings, AdmissionSettings::default());
    let new = greeted(Client::from(from(2), &state)).await;
    assert!(Client::from(from(3), &state).await.is_err(), "two are open");
    // The new session has its own rate, the old one the rest of the new total.
    near(&measured_rates(vec![old, new]).await, &[3.0, 1.0]);
}
