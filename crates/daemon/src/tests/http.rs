use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::time::Instant;

use super::*;

/// Sends bytes and returns everything received until the server closes.
pub(super) async fn exchange(state: &Arc<ServerState>, request: &[u8]) -> String {
    let (mut near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, state.clone(), peer()));
    // The server may close before it has read everything.
    let _ = near.write_all(request).await;
    let mut answer = Vec::new();
    let _ = near.read_to_end(&mut answer).await;
    String::from_utf8_lossy(&answer).into_owned()
}

async fn get(state: &Arc<ServerState>, path: &str) -> String {
    exchange(state, format!("GET {path} HTTP/1.1\r\nHost: s\r\n\r\n").as_bytes()).await
}

#[tokio::test(start_paused = true)]
async fn the_public_port_has_health_and_no_metrics() {
    let state = state_of(MemoryScene::new(1, 100, 100), Some(2_000_000));
    let health = get(&state, "/health").await;
    assert!(health.starts_with("HTTP/1.1 200") && health.ends_with("ok\n"), "{health}");
    assert!(get(&state, "/metrics").await.starts_with("HTTP/1.1 404"), "metrics on the public port");
    state.drain();
    let health = get(&state, "/health").await;
    assert!(health.starts_with("HTTP/1.1 200"), "still healthy while draining: {health}");
}

#[tokio::test(start_paused = true)]
async fn a_server_is_ready_until_it_drains() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let ready = get(&state, "/ready").await;
    assert!(ready.starts_with("HTTP/1.1 200") && ready.ends_with("ready\n"), "{ready}");
    assert!(get(&state, "/nowhere").await.contains("/ready"));
    state.drain();
    let ready = get(&state, "/ready").await;
    assert!(
        ready.starts_with("HTTP/1.1 503") && ready.contains("draining: the server is shutting"),
        "{ready}"
    );
    state.stop();
    assert!(get(&state, "/ready").await.starts_with("HTTP/1.1 503"));
}

#[tokio::test(start_paused = true)]
async fn invalid_requests_get_a_status() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let upgrade = "GET / HTTP/1.1\r\nHost: s\r\nConnection: upgrade\r\nUpgrade: websocket\r\n";
    let cases: Vec<(Vec<u8>, &str)> = vec![
        (b"GET /nowhere HTTP/1.1\r\nHost: s\r\n\r\n".to_vec(), "404"),
        (b"POST /health HTTP/1.1\r\nHost: s\r\nContent-Length: 0\r\n\r\n".to_vec(), "405"),
        (b"GET / HTTP/1.1\r\nHost: s\r\n\r\n".to_vec(), "426"),
        (format!("{upgrade}Sec-WebSocket-Version: 8\r\n\r\n").into(), "426"),
        (format!("{upgrade}Sec-WebSocket-Version: 13\r\n\r\n").into(), "400"),
        (format!("{upgrade}Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: short\r\n\r\n").into(), "400"),
        (
            format!(
                "{upgrade}Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
                 Sec-WebSocket-Protocol: chat\r\n\r\n"
            )
            .into(),
            "400",
        ),
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03 not HTTP at all \r\n\r\n".to_vec(), "400"),
        (vec![b'a'; 40_000], "4"),
        (format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "y".repeat(40_000)).into(), "431"),
        (format!("GET / HTTP/1.1\r\n{}\r\n", "X: y\r\n".repeat(200)).into(), "431"),
    ];
    for (request, status) in cases {
        let answer = exchange(&state, &request).await;
        let shown = String::from_utf8_lossy(&request[..request.len().min(60)]).into_owned();
        assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{shown:?}: {answer}");
    }
    assert!(get(&state, "/health").await.starts_with("HTTP/1.1 200"));
}

#[tokio::test(start_paused = true)]
async fn slow_and_silent_peers_are_dropped() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let started = Instant::now();
    exchange(&state, b"").await;
    assert!(started.elapsed() <= Duration::from_secs(10), "{:?}", started.elapsed());

    let (mut near, far) = duplex(64 * 1024);
    let serving = tokio::spawn(accept_http(far, state.clone(), peer()));
    let started = Instant::now();
    for byte in b"GET /health HTTP/1.1\r\nX-Slow: ".iter().cycle().take(1000) {
        tokio::time::sleep(Duration::from_millis(500)).await;
        if near.write_all(&[*byte]).await.is_err() {
            break;
        }
    }
    assert!(started.elapsed() <= Duration::from_secs(11), "{:?}", started.elapsed());
    serving.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_session_without_hello_times_out() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    let mut client = Client::in_memory(&state).await;
    let started = Instant::now();
    let close = client.read_until_close().await;
    assert_eq!(close.code, lodestream_protocol::message::CloseCode::Timeout);
    assert!(started.elapsed() <= Duration::from_secs(30), "{:?}", started.elapsed());
    drop(client);
    state.all_sessions_ended().await;
}
