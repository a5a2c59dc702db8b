//! Requested blobs are sent once, in order, or refused.

use std::time::Duration;

use super::*;
use crate::frame::BlobPiece;
use crate::message::{ClientMessage, RefusedReason, Want};
use crate::scheduler::Unit;
use crate::source::SceneSource as _;
use lodestream_scene::view::View;

/// A client requests the rest of a pushed part once it has the part. A second run sent before that request would be
/// ignored.
#[test]
fn request_that_crosses_a_pushed_part_sends_no_second_run() {
    let scene = MemoryScene::new(2, 2, 5);
    let mut server = session(&scene, ServerConfig::quic(None));
    // From far away, where truncated chunks suffice.
    let view = View { eye: [0.0, 12.0, 30.0], ..scene.header.camera.view([1280, 720], 1.0) };
    let hello = Hello { view: Some(view), ..hello(&scene.header) };
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello));
    let part = drain(&mut server, Time::ZERO).into_iter().find_map(|transmit| match transmit {
        Transmit::Piece { piece, .. } if piece.is_last() && piece.end < piece.total => Some(piece),
        _ => None,
    });
    let BlobPiece { id, end, total, .. } = part.unwrap();
    let mut ask = |message| {
        server.handle_message(Time::ZERO, message);
        let runs = drain(&mut server, Time::ZERO).into_iter().filter_map(|transmit| match transmit {
            Transmit::Piece { piece, .. } if piece.id == id => Some((piece.offset, piece.end)),
            _ => None,
        });
        runs.collect::<Vec<_>>()
    };
    let want = |offset| ClientMessage::Want(vec![Want { offset, ..Want::whole(id, 9) }]);
    assert_eq!(ask(want(0)), []);
    assert_eq!(ask(want(end)), [(end, total)]);
    assert_eq!(ask(want(0)), []);
    assert_eq!(ask(ClientMessage::Cancel(vec![id])), []);
    assert_eq!(ask(want(0)), [(0, total)]);
}

#[test]
fn blobs_are_sent_once_unless_cancelled_in_between() {
    let scene = MemoryScene::new(1, 1, 3);
    let mut server = session(&scene, ServerConfig::websocket(None));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    drain(&mut server, Time::ZERO);
    let id = BlobId::chunk(0, 3);
    let want = ClientMessage::Want(vec![Want::whole(id, 9)]);
    let mut ask = |message: &ClientMessage| {
        server.handle_message(Time::ZERO, message.clone());
        begun(&drain(&mut server, Time::ZERO)).len()
    };
    assert!(ask(&want) <= 1);
    assert_eq!(ask(&want), 0);
    assert_eq!(ask(&ClientMessage::Cancel(vec![id])), 0);
    assert_eq!(ask(&want), 1);
}

#[test]
fn parts_are_sent_once_and_bad_ones_are_refused_with_a_reason() {
    let scene = MemoryScene::new(1, 1, 3);
    let mut server =
        session(&scene, ServerConfig { push_after_hello_bytes: 0, ..ServerConfig::websocket(None) });
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    drain(&mut server, Time::ZERO);
    let id = BlobId::chunk(0, 3);
    let length = scene.blob_len(&id).unwrap();
    let mut ask = |offset: u32, end: Option<u32>| {
        let want = Want { offset, end, ..Want::whole(id, 9) };
        server.handle_message(Time::ZERO, ClientMessage::Want(vec![want]));
        let (mut sent, mut refused) = (Vec::new(), None);
        for transmit in drain(&mut server, Time::ZERO) {
            match transmit {
                Transmit::Piece { piece, .. } if piece.id == id => {
                    sent.push((piece.offset, piece.offset + piece.bytes.len() as u32, piece.end));
                }
                Transmit::Message { message: ServerMessage::Refused(why), .. } => refused = Some(why.reason),
                _ => {}
            }
        }
        (sent, refused)
    };
    let bad = (Vec::new(), Some(RefusedReason::OutOfRange));
    for (offset, end) in [
        (length, None),
        (length + 1, None),
        (u32::MAX, Some(u32::MAX)),
        (0, Some(0)),
        (0, Some(length + 1)),
        (200, Some(200)),
        (200, Some(100)),
    ] {
        assert_eq!(ask(offset, end), bad, "{offset} to {end:?} of {length}");
    }
    assert_eq!(ask(0, Some(300)), (vec![(0, 300, 300)], None));
    assert_eq!(ask(0, Some(200)), (vec![], None), "sent already");
    // Bytes that were sent are not sent again, even if the client's offset is lower.
    assert_eq!(ask(100, Some(400)), (vec![(300, 400, 400)], None));
    assert_eq!(ask(500, None), (vec![(500, length, length)], None));
    assert_eq!(ask(0, None), (vec![], None));
}

#[test]
fn urgent_requests_overtake_bulk_at_two_megabits() {
    let scene = MemoryScene::new(1, 1, 6);
    let mut server = session(&scene, ServerConfig::websocket(Some(2 * MBIT)));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    let bulk = (0..1000).map(|c| Want::whole(BlobId::chunk(0, c), 1 << 24)).collect();
    server.handle_message(Time::ZERO, ClientMessage::Want(bulk));
    let urgent = BlobId::chunk(0, 1200);
    let mut now = Time::ZERO;
    let mut asked = None;
    loop {
        if now > Time::from_ms(500) && asked.is_none() {
            asked = Some(now);
            let want = Want::whole(urgent, 1 << 30);
            server.handle_message(now, ClientMessage::Want(vec![want]));
        }
        if begun(&drain(&mut server, now)).contains(&urgent) {
            break;
        }
        now = server.poll_timeout().unwrap();
    }
    assert!(now.since(asked.unwrap()) < Duration::from_millis(15), "{now:?}");
}

#[test]
fn cancelled_blobs_stop_in_the_middle() {
    let scene = MemoryScene::new(1, 1, 3);
    let config = ServerConfig { piece_bytes: 100, ..ServerConfig::websocket(Some(MBIT)) };
    let mut server = session(&scene, config);
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    let mut now = Time::ZERO;
    while server.requests.scheduler.begun().next().is_none() {
        assert!(server.poll_transmit(now).is_some());
        now = now + Duration::from_millis(1);
    }
    let Some((_, Unit::Blob(id))) = server.requests.scheduler.begun().next() else {
        panic!("no blob has begun")
    };
    server.handle_message(now, ClientMessage::Cancel(vec![id]));
    assert_eq!(server.poll_transmit(now), Some(Transmit::Abandon(id)));
    let later = drain(&mut server, now + Duration::from_secs(60));
    assert!(!later.iter().any(|t| matches!(t, Transmit::Piece { piece, .. } if piece.id == id)));
}

#[test]
fn requests_beyond_the_queue_or_the_scene_are_refused() {
    let scene = MemoryScene::new(1, 1, 6);
    let config = ServerConfig { max_queued: 100, ..ServerConfig::quic(Some(1000)) };
    let mut server = session(&scene, config);
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    let wants = (0..300).map(|c| Want::whole(BlobId::chunk(0, c), 3));
    let missing = [BlobId::chunk(0, 9999), BlobId::base(7), BlobId::texture(0, 0, 0)];
    let wants = wants.chain(missing.map(|id| Want::whole(id, 1))).collect();
    server.handle_message(Time::ZERO, ClientMessage::Want(wants));
    let refused: Vec<_> = drain(&mut server, Time::ZERO)
        .into_iter()
        .filter_map(|t| match t {
            Transmit::Message { message: ServerMessage::RefusedMany(many), .. } => Some(many),
            _ => None,
        })
        .flatten()
        .map(|refused| refused.reason)
        .collect();
    assert!(refused.iter().filter(|r| **r == RefusedReason::QueueFull).count() >= 190);
    assert_eq!(refused.iter().filter(|r| **r == RefusedReason::NotFound).count(), 3);
}

#[test]
fn waiting_bytes_count_what_is_not_handed_over() {
    let scene = MemoryScene::new(1, 1, 3);
    let mut server = session(&scene, ServerConfig::websocket(None));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    drain(&mut server, Time::ZERO);
    assert!(server.nothing_waits() && server.waiting_bytes() == 0);
    let ids = [1, 2].map(|chunk| BlobId::chunk(0, chunk));
    for id in ids {
        server.handle_message(Time::ZERO, ClientMessage::Cancel(vec![id]));
    }
    let lengths = ids.map(|id| scene.blob_len(&id).unwrap());
    let part = Want { offset: 1, end: Some(3), ..Want::whole(ids[1], 8) };
    server.handle_message(Time::ZERO, ClientMessage::Want(vec![Want::whole(ids[0], 9), part]));
    assert!(!server.nothing_waits());
    assert_eq!(server.waiting_bytes(), u64::from(lengths[0]) + 2);
    // A pong waits among the messages.
    server.handle_message(Time::ZERO, ClientMessage::Ping(1));
    assert!(server.waiting_bytes() > u64::from(lengths[0]) + 2);
    drain(&mut server, Time::ZERO);
    assert!(server.nothing_waits() && server.waiting_bytes() == 0);
}
