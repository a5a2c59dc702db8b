//! The client against peers that are not Lodestream servers.

#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]

use std::net::SocketAddr;
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::time::Time;
use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

use super::addresses::Resolver;
use super::reconnect::stream_to;
use super::steps::STEP_TIMEOUT;
use super::websocket::{WebSocketConnection, run_websocket};
use super::{Clock, End, Host, Retry, stream};
use crate::core::{ClientCore, Config, Progress, StartView};

fn core() -> ClientCore {
    ClientCore::new(Config::new(StartView::OfScene { viewport_px: [64, 64], target_px: 1.0 }))
}

/// The client's error after a peer has answered the first bytes with `answer` and closed the connection.
async fn answered(answer: &'static [u8]) -> Close {
    let (client, mut server) = duplex(4096);
    let peer = async move {
        let mut request = [0; 1024];
        let _ = server.read(&mut request).await;
        let _ = server.write_all(answer).await;
    };
    let mut core = core();
    let session = async {
        match WebSocketConnection::open(client, "host:1", STEP_TIMEOUT).await {
            Ok(connection) => run_websocket(connection, &mut core, Clock::start()).await,
            Err(why) => why,
        }
    };
    let (close, ()) = tokio::join!(session, peer);
    assert!(core.scene().is_none());
    close
}

#[tokio::test]
async fn peers_that_speak_no_websocket_are_closed_with_a_reason() {
    for answer in [&b""[..], b"garbage\r\n\r\n", b"HTTP/1.1 200 OK\r\n\r\n", &[0xFF; 300]] {
        let close = answered(answer).await;
        assert!(!close.reason.is_empty(), "{answer:?}");
        assert_ne!(close.code, CloseCode::Normal);
    }
}

#[tokio::test]
async fn a_busy_server_is_tried_again_and_a_wrong_one_is_not() {
    let busy = answered(b"HTTP/1.1 503 Service Unavailable\r\ncontent-length: 0\r\n\r\n").await;
    assert!(busy.code.worth_retrying() && busy.reason.contains("503"), "{busy}");
    let wrong = answered(b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n").await;
    assert!(!wrong.code.worth_retrying() && wrong.reason.contains("404"), "{wrong}");
}

#[tokio::test]
async fn an_address_where_nobody_listens_is_given_up_after_some_attempts() {
    // A port that was free a moment ago.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let address = format!("ws://127.0.0.1:{port}").parse().unwrap();
    let retry = attempts(2);
    let mut told = Vec::new();
    let end = stream(&address, &mut core(), Clock::start(), retry, |_, message| told.extend(message)).await;
    assert!(
        matches!(&end, End::Unreachable { attempts: 2, why } if why.contains("cannot be reached")),
        "{end:?}"
    );
    assert!(told[0].contains("connecting again"), "{told:?}");
}

fn attempts(first_attempts: u32) -> Retry {
    Retry { first_attempts, first_within: Duration::MAX, reconnect: true }
}

/// All attempts together take under five seconds, although each step may take four.
#[tokio::test(start_paused = true)]
async fn an_address_where_nobody_answers_fails_within_five_seconds() {
    let (_listener, at) = silent();
    // A socket from which nobody reads.
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut addresses = vec![format!("ws://{at}")];
    if cfg!(feature = "quic") {
        addresses.push(format!("quic://{}#sha256={}", socket.local_addr().unwrap(), "ab".repeat(32)));
    }
    for address in addresses {
        let clock = Clock::start();
        let address = address.parse().unwrap();
        let end = stream(&address, &mut core(), clock, Retry::default(), |_, _| ()).await;
        let took = clock.now();
        assert!(matches!(&end, End::Unreachable { why, .. } if why.contains("within 4 s")), "{end:?}");
        assert!(took < Time::from_ms(5000), "{}: {took:?}", address.address);
    }
}

/// A TCP port that accepts connections and never answers.
fn silent() -> (std::net::TcpListener, SocketAddr) {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    (listener, address)
}

#[tokio::test(start_paused = true)]
async fn a_peer_that_accepts_and_stays_silent_is_given_up() {
    let (client, server) = duplex(4096);
    let why = WebSocketConnection::open(client, "host:1", STEP_TIMEOUT).await.err().unwrap();
    drop(server);
    assert!(
        why.code.worth_retrying() && why.reason.contains("no answer to the WebSocket request within 4 s"),
        "{why}"
    );

    let (_listener, at) = silent();
    let retry = attempts(2);
    let mut told = Vec::new();
    let address = format!("ws://{at}").parse().unwrap();
    let end = stream(&address, &mut core(), Clock::start(), retry, |_, message| told.extend(message)).await;
    assert!(
        matches!(&end, End::Unreachable { attempts: 2, why } if why.contains(&at.to_string()) && why.contains("4 s")),
        "{end:?}"
    );
    assert!(told[0].contains("no answer") && told[0].contains("connecting again"), "{told:?}");
}

/// A host that wants to leave after some turns.
struct Leaving {
    core: ClientCore,
    turns: u32,
}

impl Host for Leaving {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        self.turns = self.turns.saturating_sub(1);
        self.core.update(now, u64::MAX)
    }

    async fn wake(&mut self) {}

    fn wants_to_leave(&self) -> bool {
        self.turns == 0
    }
}

/// Leaving does not wait for the deadline of a connection attempt.
#[tokio::test]
async fn a_host_may_leave_while_a_peer_stays_silent() {
    let (_listener, at) = silent();
    let address = format!("ws://{at}").parse().unwrap();
    let mut host = Leaving { core: core(), turns: 5 };
    let retry = attempts(u32::MAX);
    let start = Clock::start();
    let leaving = stream(&address, &mut host, start, retry, |_, _| ());
    // A guard against waiting forever.
    let end = tokio::time::timeout(std::time::Duration::from_secs(60), leaving).await;
    assert_eq!(end, Ok(End::Left));
}

struct Fixed(Vec<SocketAddr>);

impl Resolver for Fixed {
    async fn resolve(&self, _: &str) -> std::io::Result<Vec<SocketAddr>> {
        Ok(self.0.clone())
    }
}

#[tokio::test]
async fn a_name_whose_first_address_refuses_is_reached_at_its_second() {
    // The first port has no listener any more, the second answers 503.
    let nobody = silent().1;
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let somebody = listener.local_addr().unwrap();
    let peer = async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        let _ = stream.read(&mut [0; 1024]).await;
        let _ = stream.write_all(b"HTTP/1.1 503 Service Unavailable\r\ncontent-length: 0\r\n\r\n").await;
    };
    let address = "ws://name.example:80".parse().unwrap();
    let retry = attempts(1);
    let (resolver, mut core) = (Fixed(vec![nobody, somebody]), core());
    let streaming = stream_to(&address, &resolver, &mut core, Clock::start(), retry, |_, _| ());
    let (end, ()) = tokio::join!(streaming, peer);
    let End::Unreachable { why, .. } = end else { panic!("{end:?}") };
    assert!(why.contains("503") && why.contains(&format!("{nobody}: ")), "{why}");
    assert!(why.contains(&format!("{somebody}: ")), "{why}");
}

#[cfg(feature = "quic")]
#[tokio::test(start_paused = true)]
async fn quic_tries_every_address_of_a_name_in_bounded_time_too() {
    // Sockets from which nobody reads.
    let sockets = [(); 2].map(|()| std::net::UdpSocket::bind("127.0.0.1:0").unwrap());
    let servers = sockets.each_ref().map(|socket| socket.local_addr().unwrap());
    let address = format!("quic://name.example:80#sha256={}", "ab".repeat(32)).parse().unwrap();
    let retry = attempts(1);
    let (resolver, mut core) = (Fixed(servers.to_vec()), core());
    let end = stream_to(&address, &resolver, &mut core, Clock::start(), retry, |_, _| ()).await;
    let End::Unreachable { why, .. } = end else { panic!("{end:?}") };
    assert!(servers.iter().all(|server| why.contains(&format!("{server}: no answer within 4 s"))), "{why}");
}

/// A server that sends a blob and closes each connection: the client must not reconnect without increasing pauses.
#[tokio::test(start_paused = true)]
async fn reconnections_pause_if_the_server_cuts_every_session() {
    use futures_util::SinkExt as _;
    use lodestream_protocol::frame::{BlobPiece, encode_piece, encode_server};
    use lodestream_protocol::message::{ServerMessage, VERSIONS, Welcome};
    use lodestream_protocol::source::SceneSource as _;
    use lodestream_protocol::stream::ALPN;
    use lodestream_scene::BlobId;
    use tokio_tungstenite::tungstenite::Message;
    use tokio_tungstenite::tungstenite::handshake::server::{Request, Response};

    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("ws://{}", listener.local_addr().unwrap()).parse().unwrap();
    let scene = crate::core::testing::TestScene::new(1);
    let welcome = ServerMessage::Welcome(Welcome {
        version: *VERSIONS.end(),
        session: 1,
        rate_bits_per_s: 0,
        idle_timeout_ms: 30_000,
        scene: scene.header().clone(),
    });
    let page = ServerMessage::ScenePage((*scene.page(0).unwrap()).clone());
    let id = BlobId::base(0);
    let bytes = scene.read(&id).unwrap();
    let total = bytes.len() as u32;
    let base = encode_piece(&BlobPiece { id, offset: 0, end: total, total, bytes }).unwrap();
    let frames = [encode_server(&welcome).unwrap(), encode_server(&page).unwrap(), base];
    let connections = std::cell::Cell::new(0);
    let server = async {
        loop {
            let (stream, _) = listener.accept().await.unwrap();
            connections.set(connections.get() + 1);
            #[expect(clippy::result_large_err, reason = "tungstenite's")]
            let named = |_: &Request, mut answer: Response| {
                answer.headers_mut().insert("sec-websocket-protocol", ALPN.parse().unwrap());
                Ok(answer)
            };
            let mut socket = tokio_tungstenite::accept_hdr_async(stream, named).await.unwrap();
            for frame in &frames {
                socket.send(Message::Binary(frame.clone().into())).await.unwrap();
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    let mut core = core();
    let streaming = stream(&address, &mut core, Clock::start(), Retry::default(), |_, _| ());
    tokio::select! {
        () = server => {}
        end = streaming => panic!("{end}"),
        () = tokio::time::sleep(Duration::from_secs(60)) => {}
    }
    assert!(core.scene().is_some() && core.stats().session.blobs > 0, "each session brings something");
    // Pauses of 0.5, 1, 2, 4, 8, 16 and 30 s, and at least half of each.
    assert!((4..=9).contains(&connections.get()), "{} connections in a minute", connections.get());
}
