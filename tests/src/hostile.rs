//! Peers that violate the protocol.

use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, TcpStream, UdpSocket};
use std::time::Duration;

use lodestream_client::net::{client_config, endpoint};
use lodestream_daemon::SessionSettings;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{ClientMessage, Close, CloseCode, Hello, RefusedReason, ServerMessage};
use lodestream_scene::BlobId;
use tokio::time::timeout;

use crate::support::LIMIT;
use crate::support::daemon::{Server, Transport};
use crate::support::raw::{RawClient, RawQuic, RawWebSocket, hello, want};
use crate::support::scene::TestScene;
use crate::support::viewer::{Viewer, config};

/// Seeded random bytes.
fn noise(seed: u64, length: usize) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    std::iter::repeat_with(next).take(length).collect()
}

fn garbage_over_udp(server: &Server) {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    for length in (0..1400).step_by(13) {
        let mut datagram = noise(length as u64, length);
        // A third are random, a third look like QUIC Initial packets, a third like later packets.
        match (length % 3, datagram.get_mut(..5)) {
            (1, Some(head)) => head.copy_from_slice(&[0xc3, 0, 0, 0, 1]),
            (2, Some(head)) => head[0] = 0x40,
            _ => {}
        }
        socket.send_to(&datagram, server.quic_address()).unwrap();
    }
}

/// Sends bytes to the HTTP port and returns the answer until the server closes.
fn garbage_over_tcp(server: &Server, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(server.http_address()).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    // The server may close before it has read everything.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(std::net::Shutdown::Write);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

/// Checks that bytes of no protocol and silent connections on both ports do not affect a viewer that is being served.
#[test]
fn garbage_on_the_ports_leaves_the_server_and_its_viewers_alone() {
    let scene = TestScene::small();
    let slow = SessionSettings { rate_bits_per_s: Some(500_000), ..SessionSettings::default() };
    let server = Server::start(scene.source(), slow);
    let mut viewers: Vec<_> =
        Transport::BOTH.iter().map(|t| Viewer::start(&server.address(*t), config())).collect();
    for viewer in &mut viewers {
        viewer.wait("a first frame", |s| s.stats.milestones.first_frame.is_some());
    }
    // Half-open: connected, or in the middle of a request, then silent.
    let mut silent = Vec::new();
    for start in ["", "GET / HT", "GET / HTTP/1.1\r\nHost: s\r\nUpgrade: websocket\r\n"] {
        let mut stream = TcpStream::connect(server.http_address()).unwrap();
        stream.write_all(start.as_bytes()).unwrap();
        silent.push(stream);
    }
    garbage_over_udp(&server);
    for length in [1, 10, 100, 1000, 100_000] {
        garbage_over_tcp(&server, &noise(length as u64, length));
    }
    // Only requests may be answered with success.
    let long = format!("GET /{} HTTP/1.1\r\nHost: s\r\n\r\n", "x".repeat(200_000));
    let many = format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(20_000));
    let cases = [
        "\r\n\r\n\r\n",
        "GET\r\n\r\n",
        "GET / HTTP/9.9\r\n\r\n",
        "POST /health HTTP/1.1\r\nHost: s\r\nContent-Length: 99999999999999999999\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: s\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 1\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: s\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n\r\n",
        "\u{16}\u{3}\u{1}\u{2}\0\u{1}\0\u{1}\u{fc}\u{3}\u{3}",
        long.as_str(),
        many.as_str(),
    ];
    for request in cases {
        let answer = garbage_over_tcp(&server, request.as_bytes());
        let good = ["HTTP/1.1 101", "HTTP/1.1 2"].iter().any(|status| answer.starts_with(status));
        assert!(!good, "{:?} is answered {answer:?}", &request[..request.len().min(80)]);
    }
    for viewer in &mut viewers {
        let stats = viewer.settle().stats;
        assert_eq!((stats.connections, stats.decode_failures, stats.refused), (1, 0, 0), "{stats:?}");
    }
    server.assert_healthy();
    drop(silent);
}

/// Messages of a peer, and the `Close` that the server must answer with: code and part of the reason.
fn rule_breakers() -> Vec<(&'static str, Vec<Vec<u8>>, CloseCode, &'static str)> {
    let first = |message: ClientMessage| vec![encode_client(&message).unwrap()];
    let greeting = || encode_client(&ClientMessage::Hello(hello())).unwrap();
    // Tag of Want; its length field says 200,000.
    let mut too_long = vec![0x02];
    too_long.extend_from_slice(&(0x8000_0000_u32 | 200_000).to_be_bytes());
    too_long.extend(noise(1, 200_000));
    let mut truncated = greeting();
    let cut = truncated.len() - 3;
    truncated.truncate(cut);
    // The message is so short that the header's length takes one byte, which is corrected here.
    truncated[1] -= 3;
    vec![
        (
            "versions that the server does not speak",
            first(ClientMessage::Hello(Hello { version_min: 40, version_max: 50, ..hello() })),
            CloseCode::Version,
            "version",
        ),
        (
            "a scene that does not exist",
            first(ClientMessage::Hello(Hello { scene: "atlantis".into(), ..hello() })),
            CloseCode::NoSuchScene,
            "atlantis",
        ),
        ("an unknown message that may not be skipped", vec![vec![0x33, 0]], CloseCode::Protocol, "0x33"),
        ("an oversized message", vec![greeting(), too_long], CloseCode::Limit, "bytes, but at most"),
        ("a message cut short", vec![truncated], CloseCode::Protocol, "malformed"),
        ("a request before Hello", first(want([BlobId::base(0)])), CloseCode::Protocol, "Hello"),
        ("Hello twice", vec![greeting(), greeting()], CloseCode::Protocol, "Hello"),
        (
            "random bytes in a message",
            vec![greeting(), [&[0x02, 0x30][..], &noise(7, 0x30)].concat()],
            CloseCode::Protocol,
            "malformed",
        ),
    ]
}

async fn break_rules(client: &mut impl RawClient, frames: &[Vec<u8>]) -> Option<Close> {
    for frame in frames {
        // The server may have closed before the last frame.
        if client.send_bytes(frame.clone()).await.is_err() {
            break;
        }
    }
    timeout(LIMIT, client.close()).await.expect("the server neither answers nor closes")
}

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap()
}

async fn over_quic(server: &Server) -> (quinn::Endpoint, RawQuic) {
    let pin = server.address(Transport::Quic).pin.expect("a QUIC address with a fingerprint");
    let endpoint = endpoint(server.quic_address(), client_config(pin).unwrap()).unwrap();
    let connection = endpoint.connect(server.quic_address(), "localhost").unwrap().await.unwrap();
    (endpoint, RawQuic::new(connection))
}

async fn over_websocket(server: &Server) -> RawWebSocket<tokio::net::TcpStream> {
    RawWebSocket::open(tokio::net::TcpStream::connect(server.http_address()).await.unwrap()).await
}

/// Checks that peers which send frames but violate the protocol receive the reason, on both transports alike, and that
/// other sessions are not affected.
#[test]
fn peers_that_violate_the_protocol_receive_the_reason() {
    let scene = TestScene::small();
    let server = Server::start(scene.source(), SessionSettings::default());
    runtime().block_on(async {
        for (what, frames, code, reason) in rule_breakers() {
            let (_endpoint, mut quic) = over_quic(&server).await;
            let mut websocket = over_websocket(&server).await;
            let closes = [break_rules(&mut quic, &frames).await, break_rules(&mut websocket, &frames).await];
            for (transport, close) in Transport::BOTH.iter().zip(closes) {
                let close = close.unwrap_or_else(|| panic!("{what} over {transport:?}: no reason given"));
                assert_eq!(close.code, code, "{what} over {transport:?}: {close}");
                assert!(close.reason.contains(reason), "{what} over {transport:?}: {close}");
                assert_eq!(close.reason.lines().count(), 1, "{close}");
            }
        }
    });
    server.wait_for_sessions(0);
    server.assert_healthy();
}

/// Checks valid but useless messages: requests for missing blobs are refused, all at once, messages of a later version
/// are skipped, and the session continues.
async fn ask_for_nonsense(client: &mut impl RawClient) {
    client.send(&ClientMessage::Hello(hello())).await;
    let nonsense =
        [BlobId::base(999), BlobId::chunk(0, u32::MAX), BlobId::index_page(0, 77), BlobId::texture(0, 9, 9)];
    client.send(&want(nonsense)).await;
    let message = client.message(|m| matches!(m, ServerMessage::RefusedMany(_))).await;
    let ServerMessage::RefusedMany(many) = message else { unreachable!() };
    assert!(many.iter().all(|refused| refused.reason == RefusedReason::NotFound), "{many:?}");
    let mut refused: Vec<_> = many.into_iter().map(|refused| refused.id).collect();
    refused.sort_unstable();
    let mut nonsense = nonsense.to_vec();
    nonsense.sort_unstable();
    assert_eq!(refused, nonsense);
    client.send(&ClientMessage::Cancel(nonsense)).await;
    client.send_bytes(vec![0x80 | 0x3f, 2, 1, 1]).await.unwrap();
    client.send(&ClientMessage::Ping(5)).await;
    client.message(|m| *m == ServerMessage::Pong(5)).await;
}

#[test]
fn requests_for_missing_blobs_are_refused() {
    let scene = TestScene::small();
    let server = Server::start(scene.source(), SessionSettings::default());
    runtime().block_on(async {
        let (_endpoint, mut quic) = over_quic(&server).await;
        timeout(LIMIT, ask_for_nonsense(&mut quic)).await.expect("over QUIC");
        let mut websocket = over_websocket(&server).await;
        timeout(LIMIT, ask_for_nonsense(&mut websocket)).await.expect("over WebSocket");
    });
    server.assert_healthy();
}

/// Checks that the viewer ends with one line, in bounded time, if the peer is not a Lodestream server.
#[test]
fn a_viewer_ends_with_a_message_if_the_peer_is_no_server() {
    let answers: [&[u8]; 4] = [
        b"",
        &noise(3, 5000),
        b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi",
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: x\r\n\r\n\x82\x05hello",
    ];
    for answer in answers {
        let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let answer = answer.to_vec();
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let Ok(mut stream) = stream else { break };
                let mut request = [0; 1024];
                let _ = stream.read(&mut request);
                let _ = stream.write_all(&answer);
            }
        });
        let mut viewer = Viewer::start(&format!("ws://127.0.0.1:{port}/").parse().unwrap(), config());
        let end = viewer.end(Duration::from_secs(50));
        assert_eq!(end.lines().count(), 1, "{end}");
    }
}
