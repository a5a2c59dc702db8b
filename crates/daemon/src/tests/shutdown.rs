use lodestream_protocol::message::CloseCode;
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout};

use super::*;

#[tokio::test(start_paused = true)]
async fn a_session_finishes_its_requests_while_draining() {
    // Two seconds' worth at 2 Mbit/s.
    let state = state_of(MemoryScene::new(1, 1000, 60_000), Some(2_000_000));
    let mut client = Client::requesting_textures(&state).await;
    client.next().await.unwrap();
    state.drain();
    let blobs = client.read_blobs(9).await;
    assert_eq!(blobs.len(), 9);
    let close = client.read_until_close().await;
    assert_eq!(close.code, CloseCode::ShuttingDown);
    assert!(close.code.worth_retrying());
}

#[tokio::test(start_paused = true)]
async fn draining_is_bounded_in_time() {
    let state = state_of(MemoryScene::new(1, 1000, 10_000_000), Some(2_000_000));
    let mut client = Client::requesting_textures(&state).await;
    client.next().await.unwrap();
    let started = Instant::now();
    state.drain();
    assert_eq!(client.read_until_close().await.code, CloseCode::ShuttingDown);
    drop(client);
    state.all_sessions_ended().await;
    let took = started.elapsed();
    assert!((Duration::from_secs(3)..Duration::from_secs(5)).contains(&took), "{took:?}");
}

#[tokio::test(start_paused = true)]
async fn no_session_starts_while_draining() {
    let state = state_of(MemoryScene::new(1, 1000, 1000), None);
    state.drain();
    let (near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, state, peer()));
    let refused = tokio_tungstenite::client_async("ws://server/", near).await.unwrap_err();
    assert!(refused.to_string().contains("503"), "{refused}");
}

#[tokio::test]
async fn quic_clients_are_refused_with_a_reason_while_draining() {
    let settings = SessionSettings {
        rate_bits_per_s: Some(1_000_000),
        drain: Duration::from_secs(3600),
        ..SessionSettings::default()
    };
    let (daemon, folder) = loopback(MemoryScene::new(1, 1000, 10_000_000), settings).await;
    let certificate = super::quic::certificate(&folder);
    let (quic, http, state) =
        (daemon.quic_address().unwrap(), daemon.http_address().unwrap(), daemon.state().clone());
    let (_stop, stopped) = mpsc::channel(2);
    let serving = tokio::spawn(daemon.serve(stopped));
    // A session over WebSocket with a transfer that takes longer than this test.
    let mut client = Client::over(tokio::net::TcpStream::connect(http).await.unwrap()).await;
    client.send(&hello()).await;
    client.send(&want_textures(1)).await;
    client.next().await.unwrap();
    state.drain();
    for _ in 0..2 {
        let late = super::quic::QuicClient::connect(quic, &certificate).await;
        let close = timeout(REAL_TIME_LIMIT, late.closed()).await.unwrap();
        assert_eq!(close.code, CloseCode::ShuttingDown, "{close}");
        assert!(close.code.worth_retrying() && close.reason.contains("shutting down"), "{close}");
    }
    assert!(!serving.is_finished());
    serving.abort();
}

#[tokio::test]
async fn a_second_request_ends_the_daemon_at_once() {
    let settings = SessionSettings {
        rate_bits_per_s: Some(1_000_000),
        drain: Duration::from_secs(3600),
        ..SessionSettings::default()
    };
    let (daemon, _folder) = loopback(MemoryScene::new(1, 1000, 10_000_000), settings).await;
    let address = daemon.http_address().unwrap();
    let (stop, stopped) = mpsc::channel(2);
    let serving = tokio::spawn(daemon.serve(stopped));
    let stream = tokio::net::TcpStream::connect(address).await.unwrap();
    let mut client = Client::over(stream).await;
    client.send(&hello()).await;
    client.send(&want_textures(1)).await;
    client.next().await.unwrap();
    stop.send(()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(50)).await;
    assert!(!serving.is_finished());
    stop.send(()).await.unwrap();
    let ended = timeout(REAL_TIME_LIMIT, serving).await.unwrap().unwrap();
    assert!(ended.unwrap_err().to_string().contains("second signal"));
}

#[tokio::test]
async fn urls_name_real_ports_and_the_fingerprint() {
    let (daemon, _folder) = loopback(MemoryScene::new(1, 10, 10), SessionSettings::default()).await;
    let urls = daemon.urls();
    let quic = format!("quic://{}#spki-sha256=", daemon.quic_address().unwrap());
    let fingerprint = urls[0].strip_prefix(&quic).unwrap();
    assert!(fingerprint.len() == 64 && fingerprint.bytes().all(|b| b"0123456789abcdef".contains(&b)));
    assert_eq!(urls[1], format!("ws://{}/", daemon.http_address().unwrap()));
    assert_ne!(daemon.http_address().unwrap().port(), 0);
}
