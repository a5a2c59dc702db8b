//! The client against servers that are none.

use lodestream_protocol::message::{Close, CloseCode};
use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

use super::websocket::run_websocket;
use super::{Clock, End, Retry, stream};
use crate::core::{ClientCore, Config, StartView};

fn core() -> ClientCore {
    ClientCore::new(Config::new(StartView::OfScene { viewport_px: [64, 64], target_px: 1.0 }))
}

/// What comes of a peer that answers the first bytes with `answer` and hangs up.
async fn answered(answer: &'static [u8]) -> Close {
    let (client, mut server) = duplex(4096);
    let peer = async move {
        let mut request = [0; 1024];
        let _ = server.read(&mut request).await;
        let _ = server.write_all(answer).await;
    };
    let mut core = core();
    let (close, ()) = tokio::join!(run_websocket(client, "host:1", &mut core, Clock::start()), peer);
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
    let retry = Retry { first_attempts: 2, reconnect: true };
    let mut told = Vec::new();
    let end = stream(&address, &mut core(), Clock::start(), retry, |_, message| told.extend(message)).await;
    assert!(
        matches!(&end, End::Unreachable { attempts: 2, why } if why.contains("cannot be reached")),
        "{end:?}"
    );
    assert!(told[0].contains("connecting again"), "{told:?}");
}
