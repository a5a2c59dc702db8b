use lodestream_protocol::message::CloseCode;
use lodestream_scene::BlobPart;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::time::Instant;

use super::*;
use crate::session::admission_settings::AdmissionSettings;

#[tokio::test(start_paused = true)]
async fn the_push_precedes_hello() {
    let state = state_of(MemoryScene::new(3, 1500, 1000), None);
    let mut client = Client::in_memory(&state).await;
    let started = Instant::now();
    let Some(ServerFrame::Message(ServerMessage::Welcome(welcome))) = client.next().await else {
        panic!("the first message is not Welcome");
    };
    assert_eq!((welcome.scene.name.as_str(), welcome.session), ("memory", 1));
    let Some(ServerFrame::Message(ServerMessage::ScenePage(page))) = client.next().await else {
        panic!("the second message is not the first page");
    };
    assert_eq!(page.assets.len(), 3);
    let mut assembler = Assembler::default();
    while assembler.complete.len() < 3 {
        match client.next().await.unwrap() {
            ServerFrame::Piece(piece) => assembler.push(piece),
            other => panic!("{other:?}"),
        }
    }
    assert!(assembler.complete.iter().all(|(id, _)| id.part() == Some(BlobPart::Base)));
    assert_eq!(started.elapsed(), Duration::ZERO);
}

#[tokio::test(start_paused = true)]
async fn the_push_is_in_the_same_flight_as_the_upgrade() {
    let state = state_of(MemoryScene::new(2, 1500, 1000), None);
    let (mut near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, state, peer()));
    let request = "GET / HTTP/1.1\r\nHost: s\r\nConnection: keep-alive, Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
         Sec-WebSocket-Protocol: lodestream.2\r\n\r\n";
    near.write_all(request.as_bytes()).await.unwrap();
    // The client sends nothing more, and no time passes.
    let mut received = Vec::new();
    while received.len() < 3300 {
        let count = near.read_buf(&mut received).await.unwrap();
        assert!(count > 0, "the server has closed after {} bytes", received.len());
    }
    let head = String::from_utf8_lossy(&received[..400]).to_ascii_lowercase();
    assert!(head.starts_with("http/1.1 101 "), "{head}");
    // The key's answer of RFC 6455, section 1.3.
    assert!(head.contains("sec-websocket-accept: s3pplmbitxaq9kygzzhzrbk+xoo="), "{head}");
    assert!(head.contains("sec-websocket-protocol: lodestream.2"), "{head}");
}

/// Status line of the response to a page of `origin` that requests a session.
async fn answer_to(state: &Arc<ServerState>, origin: &str) -> String {
    let (mut near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, Arc::clone(state), peer()));
    let request = format!(
        "GET /stream HTTP/1.1\r\nHost: localhost:8080\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Origin: {origin}\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    );
    near.write_all(request.as_bytes()).await.unwrap();
    let mut received = Vec::new();
    while !received.contains(&b'\n') {
        assert!(near.read_buf(&mut received).await.unwrap() > 0, "the server has closed without a word");
    }
    let text = String::from_utf8_lossy(&received).into_owned();
    text.lines().next().unwrap_or_default().to_owned()
}

#[tokio::test(start_paused = true)]
async fn a_page_of_another_origin_is_refused() {
    let state = state_of(MemoryScene::new(1, 100, 100), None);
    // The server's own origin is refused too: it serves no pages, and DNS rebinding can forge its name.
    for origin in ["https://evil.example", "http://localhost:8080", "null"] {
        assert!(answer_to(&state, origin).await.starts_with("HTTP/1.1 403"), "{origin}");
    }
    assert_eq!(state.metrics().active_sessions(), 0, "refused pages take no lease");
    let allowed = ["https://viewer.example".parse().unwrap()].into_iter().collect();
    let scene = Arc::new(MemoryScene::new(1, 100, 100));
    let admission = AdmissionSettings { origins: allowed, ..AdmissionSettings::default() };
    let state = ServerState::with_admission(scene, SessionSettings::default(), admission);
    assert!(answer_to(&state, "https://viewer.example").await.starts_with("HTTP/1.1 101"));
    assert!(answer_to(&state, "https://evil.example").await.starts_with("HTTP/1.1 403"));
}

#[tokio::test(start_paused = true)]
async fn requested_blobs_arrive_complete() {
    let state = state_of(MemoryScene::new(2, 1500, 70_000), None);
    let mut client = Client::in_memory(&state).await;
    client.send(&hello()).await;
    assert_eq!(client.read_blobs(2).await.len(), 2);
    client.send(&want_textures(2)).await;
    let blobs = client.read_blobs(16).await;
    assert_eq!(blobs.len(), 16);
    client.send(&ClientMessage::Bye).await;
    while client.next().await.is_some() {}
    state.all_sessions_ended().await;
    let text = state.render_metrics();
    for line in [
        "lodestream_sessions_total{transport=\"ws\"} 1",
        "lodestream_sent_total{kind=\"texture\"} 16",
        "lodestream_sent_total{kind=\"base\"} 2",
        "lodestream_sessions_ended_total{reason=\"Normal\"} 1",
        "lodestream_bases_sent_seconds_count 1",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    }
}

/// Bytes on the wire of a TCP connection: IPv4 and TCP with timestamps on each segment of 1448 bytes.
fn tcp_wire_bytes(payload: f64) -> f64 {
    payload * (1.0 + 52.0 / 1448.0)
}

#[tokio::test(start_paused = true)]
async fn every_three_second_window_is_within_two_percent_of_the_rate() {
    for rate in [2_000_000, 16_000_000_u64] {
        let state = state_of(MemoryScene::new(4, 1500, 2_000_000), Some(rate));
        let (near, far) = duplex(256 * 1024);
        tokio::spawn(accept_http(far, state.clone(), peer()));
        // Arrivals are recorded on the raw stream, below the WebSocket.
        let (near, relay) = {
            let (a, b) = duplex(256 * 1024);
            let (mut server_read, mut server_write) = tokio::io::split(near);
            let (mut client_read, mut client_write) = tokio::io::split(b);
            let record = async move {
                let mut arrivals = Vec::new();
                let mut buffer = vec![0; 64 * 1024];
                let end = Instant::now() + Duration::from_secs(12);
                while Instant::now() < end {
                    let count = server_read.read(&mut buffer).await.unwrap();
                    // A stream that has ended would return zero bytes forever.
                    assert!(count > 0, "the server closed after {} reads", arrivals.len());
                    arrivals.push((Instant::now(), count));
                    client_write.write_all(&buffer[..count]).await.unwrap();
                }
                arrivals
            };
            // One task for both directions: if it fails, the client's stream ends.
            let relay = async move {
                tokio::select! {
                    biased;
                    arrivals = record => arrivals,
                    ended = tokio::io::copy(&mut client_read, &mut server_write) => {
                        panic!("the direction to the server ended: {ended:?}")
                    }
                }
            };
            (a, tokio::spawn(relay))
        };
        let mut client = Client::over(near).await;
        client.send(&hello()).await;
        client.send(&want_textures(4)).await;
        let reading = tokio::spawn(async move { while client.next().await.is_some() {} });
        let arrivals = relay.await.unwrap();
        reading.abort();
        let first = arrivals[0].0 + Duration::from_millis(200);
        for offset_ms in (0..8500).step_by(50) {
            let from = first + Duration::from_millis(offset_ms);
            let window = from..from + Duration::from_secs(3);
            let bytes: usize = arrivals.iter().filter(|(at, _)| window.contains(at)).map(|(_, n)| n).sum();
            let ratio = tcp_wire_bytes(bytes as f64) * 8.0 / (3.0 * rate as f64);
            assert!((0.98..=1.02).contains(&ratio), "{rate} at {offset_ms} ms: {ratio}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_urgent_blob_overtakes_bulk_data() {
    let state = state_of(MemoryScene::new(2, 1500, 1_000_000), Some(2_000_000));
    let mut client = Client::requesting_textures(&state).await;
    tokio::time::sleep(Duration::from_secs(2)).await;
    let requested = Instant::now();
    let urgent = BlobId::base(1);
    client.send(&ClientMessage::Cancel(vec![urgent])).await;
    client.send(&ClientMessage::Want(vec![Want::whole(urgent, u32::MAX >> 1)])).await;
    let mut seen = 0;
    loop {
        // The first copy was pushed.
        if let ServerFrame::Piece(piece) = client.next().await.expect("closed before the urgent blob")
            && piece.id == urgent
            && piece.is_last()
        {
            seen += 1;
            if seen == 2 {
                break;
            }
        }
    }
    // The 64 KiB in the in-memory stream were sent before; only the server's delay counts.
    assert!(requested.elapsed() < Duration::from_millis(60), "{:?}", requested.elapsed());
}

#[tokio::test]
async fn a_vanished_client_does_not_affect_others() {
    let (daemon, _folder) = loopback(MemoryScene::new(2, 1500, 200_000), SessionSettings::default()).await;
    let address = daemon.http_address().unwrap();
    let state = daemon.state().clone();
    let (_stop, stopped) = tokio::sync::mpsc::channel(2);
    let serving = tokio::spawn(daemon.serve(stopped));
    let connect = || async {
        let stream = tokio::net::TcpStream::connect(address).await.unwrap();
        Client::over(stream).await
    };
    tokio::time::timeout(REAL_TIME_LIMIT, async {
        let (mut victim, mut other) = (connect().await, connect().await);
        for client in [&mut victim, &mut other] {
            client.send(&hello()).await;
            client.send(&want_textures(2)).await;
        }
        victim.next().await.unwrap();
        drop(victim);
        assert_eq!(other.read_blobs(18).await.len(), 18);
        // The server notices, and admits new clients.
        while state.metrics().active_sessions() > 1 {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        let mut third = connect().await;
        third.send(&hello()).await;
        assert_eq!(third.read_blobs(2).await.len(), 2);
    })
    .await
    .unwrap();
    serving.abort();
}

#[tokio::test(start_paused = true)]
async fn a_protocol_violation_closes_with_a_reason() {
    let state = state_of(MemoryScene::new(1, 1500, 1000), None);
    let encoded = |message: &ClientMessage| Message::Binary(encode_client(message).unwrap().into());
    let ClientMessage::Hello(good) = hello() else { panic!() };
    let cases = [
        (Message::Text("hi".into()), CloseCode::Protocol, "text"),
        (Message::Binary(vec![0x7f, 0].into()), CloseCode::Protocol, "unknown message 0x7f"),
        (Message::Binary(Bytes::new()), CloseCode::Protocol, "ends early"),
        (Message::Binary(vec![0x02; 200_000].into()), CloseCode::Limit, "200000 bytes"),
        (
            encoded(&ClientMessage::Hello(Hello { version_min: 7, version_max: 9, ..good.clone() })),
            CloseCode::Version,
            "version",
        ),
        (
            encoded(&ClientMessage::Hello(Hello { scene: "other".into(), ..good })),
            CloseCode::NoSuchScene,
            "other",
        ),
        (encoded(&want_textures(1)), CloseCode::Protocol, "Hello"),
    ];
    let count = cases.len() as u64;
    for (message, code, reason) in cases {
        let mut client = Client::in_memory(&state).await;
        client.0.send(message).await.unwrap();
        let close = client.read_until_close().await;
        assert_eq!(close.code, code, "{close}");
        assert!(close.reason.contains(reason), "{close}");
        // Then the WebSocket close frame, with an application code.
        match client.0.next().await {
            Some(Ok(Message::Close(Some(frame)))) => assert_eq!(u16::from(frame.code), 4000 + code.number()),
            other => panic!("{other:?}"),
        }
        drop(client);
    }
    state.all_sessions_ended().await;
    assert_eq!(state.metrics().active_sessions(), 0);
    assert_eq!(state.metrics().rejected_messages(), count - 3);
}
