//! The client session's records, and misbehaving servers.

use proptest::prelude::*;

use super::downloads::{MAX_PARTIAL, Pending};
use super::early::MAX_EARLY;
use super::*;
use crate::frame::BlobPiece;
use crate::message::{
    ClientMessage, Close, CloseCode, Refused, RefusedReason, ServerMessage, Token, VERSIONS, Want, Welcome,
};
use crate::source::SceneSource;
use crate::testing::{MemoryScene, contents};
use crate::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::limits::MAX_BLOB_BYTES;
use lodestream_scene::view::View;
use lodestream_select::{State, Wanted};

fn welcome(scene: &MemoryScene) -> ServerMessage {
    ServerMessage::Welcome(Welcome {
        version: *VERSIONS.end(),
        session: 1,
        rate_bits_per_s: 8_000_000,
        idle_timeout_ms: 30_000,
        scene: scene.header.clone(),
    })
}

fn connected() -> (ClientSession, std::sync::Arc<MemoryScene>) {
    let scene = MemoryScene::new(2, 1, 4);
    let mut client = ClientSession::new(ClientConfig::default(), None, Resume::default(), Time::ZERO);
    client.handle_message(Time::ZERO, welcome(&scene));
    client.handle_message(Time::ZERO, ServerMessage::ScenePage((*scene.page(0).unwrap()).clone()));
    while client.poll_event().is_some() {}
    assert!(matches!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Hello(_))));
    assert!(matches!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Ping(_))));
    assert_eq!(client.poll_transmit(Time::ZERO), None);
    (client, scene)
}

fn wanted(id: BlobId, bytes: u32) -> Wanted {
    Wanted::whole(id, 1 << 30, Some(bytes), State::Absent)
}

fn piece(id: BlobId, offset: u32, total: u32, length: u32) -> BlobPiece {
    let bytes = contents(&id, total).slice(offset as usize..(offset + length) as usize);
    BlobPiece { id, offset, end: total, total, bytes }
}

fn closed(client: &mut ClientSession) -> Option<Close> {
    std::iter::from_fn(|| client.poll_event()).find_map(|event| match event {
        ClientEvent::Closed(close) => Some(close),
        _ => None,
    })
}

#[test]
fn requests_in_flight_cover_the_bandwidth_delay_product() {
    let (mut client, _) = connected();
    client.handle_message(Time::from_ms(50), ServerMessage::Pong(1));
    let list: Vec<_> = (0..2000).map(|c| wanted(BlobId::chunk(0, c), 1000)).collect();
    let asked = client.set_wanted(Time::from_ms(50), &list, &[]);
    // 1 MB/s over 50 ms and the reaction time, times 1.25: about 190 KB.
    assert!((150..230).contains(&asked.len()), "{}", asked.len());
    assert_eq!(client.set_wanted(Time::from_ms(50), &list, &[]), []);
    let Some(ClientMessage::Want(wants)) = client.poll_transmit(Time::from_ms(50)) else { panic!("no Want") };
    assert_eq!(wants.len(), asked.len());
    client.handle_piece(Time::from_ms(60), piece(asked[0], 0, 1000, 1000));
    assert_eq!(client.set_wanted(Time::from_ms(60), &list[1..], &[]).len(), 1);
}

#[test]
fn less_urgent_blobs_in_flight_do_not_delay_requests() {
    let (mut client, _) = connected();
    client.handle_message(Time::from_ms(50), ServerMessage::Pong(1));
    let now = Time::from_ms(50);
    let list = |asset, priority| -> Vec<_> {
        (0..2000).map(|c| Wanted { priority, ..wanted(BlobId::chunk(asset, c), 1000) }).collect()
    };
    let middle = client.set_wanted(now, &list(0, 1 << 30), &[]).len();
    assert!(middle > 100);
    // As much again of more urgent blobs, and none of less urgent ones.
    let all = [list(1, 1 << 31), list(0, 1 << 30), list(2, 1 << 29)].concat();
    let asked = client.set_wanted(now, &all, &[]);
    assert_eq!(asked.len(), middle);
    assert!(asked.iter().all(|id| id.asset() == Some(1)));
    // The total is bounded.
    let mut in_flight = 2 * middle;
    for (asset, priority) in (3..).zip((1..1000).map(|step| (1 << 31) + step)) {
        in_flight += client.set_wanted(now, &list(asset, priority), &[]).len();
    }
    let most = ClientConfig::default().max_in_flight_bytes as usize / 1000;
    assert!((most..most + 2).contains(&in_flight), "{in_flight}");
}

#[test]
fn large_priority_changes_are_sent() {
    let (mut client, _) = connected();
    let id = BlobId::chunk(0, 5);
    client.set_wanted(Time::ZERO, &[wanted(id, 900)], &[]);
    assert!(client.poll_transmit(Time::ZERO).is_some());
    let small = Wanted { priority: (1 << 30) + 1000, ..wanted(id, 900) };
    client.set_wanted(Time::ZERO, &[small], &[]);
    assert_eq!(client.poll_transmit(Time::ZERO), None);
    let large = Wanted { priority: (1 << 30) + (1 << 23), ..wanted(id, 900) };
    client.set_wanted(Time::ZERO, &[large], &[]);
    let want = Want::whole(id, large.priority);
    assert_eq!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Want(vec![want])));
}

#[test]
fn cancelled_blobs_free_their_bytes_in_flight() {
    let (mut client, _) = connected();
    let id = BlobId::chunk(0, 5);
    client.set_wanted(Time::ZERO, &[wanted(id, 900)], &[]);
    assert_eq!(client.stats().in_flight_bytes, 900);
    client.poll_transmit(Time::ZERO);
    client.handle_piece(Time::ZERO, piece(id, 0, 900, 300));
    assert_eq!(client.stats().in_flight_bytes, 600);
    client.set_wanted(Time::ZERO, &[], &[id]);
    assert_eq!(client.stats().in_flight_bytes, 0);
    assert_eq!(client.set_wanted(Time::ZERO, &[wanted(id, 900)], &[]), [id]);
    assert_eq!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Cancel(vec![id])));
    assert!(matches!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Want(_))));
    // Pieces that were under way are ignored; then the blob comes whole.
    client.handle_piece(Time::ZERO, piece(id, 300, 900, 300));
    client.handle_piece(Time::ZERO, piece(id, 0, 900, 600));
    client.handle_piece(Time::ZERO, piece(id, 600, 900, 300));
    let bytes = contents(&id, 900);
    assert_eq!(client.poll_event(), Some(ClientEvent::Blob { id, offset: 0, total: 900, bytes }));
    assert_eq!(client.stats().in_flight_bytes, 0);
}

#[test]
fn part_is_requested_first_and_the_rest_when_wanted() {
    let (mut client, _) = connected();
    let id = BlobId::chunk(0, 5);
    let run = |offset: u32, end: u32, length: u32| BlobPiece { end, ..piece(id, offset, 900, length) };
    let beginning = Wanted { end: Some(500), ..wanted(id, 900) };
    assert_eq!(client.set_wanted(Time::ZERO, &[beginning], &[]), [id]);
    let asked =
        |offset, end| Some(ClientMessage::Want(vec![Want { offset, end, ..Want::whole(id, 1 << 30) }]));
    assert_eq!(client.poll_transmit(Time::ZERO), asked(0, Some(500)));
    assert_eq!(client.stats().in_flight_bytes, 500);
    client.handle_piece(Time::ZERO, run(0, 500, 300));
    // More is wanted meanwhile: what is under way is not requested twice.
    assert!(client.set_wanted(Time::ZERO, &[wanted(id, 900)], &[]).is_empty());
    client.handle_piece(Time::ZERO, run(300, 500, 200));
    let whole = contents(&id, 900);
    let event = |offset: u32, end: u32| {
        let bytes = whole.slice(offset as usize..end as usize);
        Some(ClientEvent::Blob { id, offset, total: 900, bytes })
    };
    assert_eq!(client.poll_event(), event(0, 500));
    assert_eq!(client.set_wanted(Time::ZERO, &[Wanted { held: 500, ..wanted(id, 900) }], &[]), [id]);
    assert_eq!(client.poll_transmit(Time::ZERO), asked(500, None));
    assert_eq!(client.stats().in_flight_bytes, 400);
    client.handle_piece(Time::ZERO, run(500, 900, 400));
    assert_eq!(client.poll_event(), event(500, 900));
    assert_eq!(client.stats().in_flight_bytes, 0);
    // A run beyond its blob ends the session.
    client.handle_piece(Time::ZERO, run(0, 901, 10));
    assert!(matches!(client.poll_event(), Some(ClientEvent::Closed(_))));
}

#[test]
fn evicted_blobs_are_cancelled_so_that_they_are_sent_again() {
    let (mut client, _) = connected();
    let id = BlobId::chunk(0, 5);
    client.handle_piece(Time::ZERO, piece(id, 0, 900, 900));
    client.evicted(Time::ZERO, &[id]);
    client.set_wanted(Time::ZERO, &[wanted(id, 900)], &[]);
    assert_eq!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Cancel(vec![id])));
    assert!(matches!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Want(_))));
}

#[test]
fn pushed_blobs_are_accepted() {
    let (mut client, _) = connected();
    let id = BlobId::base(1);
    client.handle_piece(Time::ZERO, piece(id, 0, 1000, 400));
    client.handle_piece(Time::ZERO, piece(id, 400, 1000, 600));
    assert!(matches!(client.poll_event(), Some(ClientEvent::Blob { id: got, .. }) if got == id));
}

/// After a restart, another scene's blob must not be taken for one of the previous scene.
#[test]
fn blob_before_welcome_is_reported_after_it() {
    let scene = MemoryScene::new(1, 1, 1);
    let mut client = ClientSession::new(ClientConfig::default(), None, Resume::default(), Time::ZERO);
    let id = BlobId::base(0);
    client.handle_piece(Time::ZERO, piece(id, 0, 900, 900));
    assert_eq!(client.poll_event(), None, "nobody knows yet what scene this is of");
    client.handle_message(Time::ZERO, welcome(&scene));
    assert!(matches!(client.poll_event(), Some(ClientEvent::Connected(_))));
    assert!(matches!(client.poll_event(), Some(ClientEvent::Blob { id: told, .. }) if told == id));
}

#[test]
fn blobs_before_welcome_are_bounded() {
    let config = ClientConfig { max_in_flight_bytes: 5000, ..ClientConfig::default() };
    for (config, held) in [(ClientConfig::default(), MAX_EARLY), (config, 50)] {
        let mut client = ClientSession::new(config, None, Resume::default(), Time::ZERO);
        for chunk in 0..300 {
            client.handle_piece(Time::ZERO, piece(BlobId::chunk(0, chunk), 0, 100, 100));
        }
        assert_eq!(client.early.len(), held);
        let sent = std::iter::from_fn(|| client.poll_transmit(Time::ZERO));
        let given_back: usize =
            sent.map(|m| if let ClientMessage::Cancel(ids) = m { ids.len() } else { 0 }).sum();
        assert_eq!(given_back, 300 - held);
        client.handle_lost(Time::ZERO, "cut");
        assert!(client.early.len() == 0);
    }
}

#[test]
fn blobs_of_another_length_than_announced_end_the_session() {
    for (asked, announced) in
        [(Some(wanted(BlobId::chunk(0, 1), 900)), BlobId::chunk(0, 1)), (None, BlobId::base(0))]
    {
        let (mut client, _) = connected();
        client.set_wanted(Time::ZERO, asked.as_slice(), &[]);
        client.handle_piece(Time::ZERO, piece(announced, 0, 901, 100));
        let close = closed(&mut client).unwrap();
        assert_eq!(close.code, CloseCode::Protocol);
        assert!(close.reason.contains("announced"), "{close}");
        assert_eq!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Bye));
        assert!(client.is_closed());
    }
}

#[test]
fn stated_length_reserves_no_memory() {
    let (mut client, _) = connected();
    let id = BlobId::index_page(0, 0);
    client.handle_piece(Time::ZERO, piece(id, 0, MAX_BLOB_BYTES, 10));
    assert!(client.downloads.pending[&id].received.capacity() < 1000);
    let small = ClientConfig { max_blob_bytes: 5000, ..ClientConfig::default() };
    let mut client = ClientSession::new(small, None, Resume::default(), Time::ZERO);
    client.handle_piece(Time::ZERO, piece(id, 0, 5001, 10));
    assert_eq!(closed(&mut client).unwrap().code, CloseCode::Protocol);
}

#[test]
fn too_many_partial_blobs_end_the_session() {
    let (mut client, _) = connected();
    for chunk in 0..=MAX_PARTIAL as u32 {
        client.handle_piece(Time::ZERO, piece(BlobId::chunk(0, chunk), 0, 20, 10));
    }
    assert_eq!(closed(&mut client).unwrap().code, CloseCode::Protocol);
    assert!(client.downloads.pending.is_empty());
}

#[test]
fn wrong_order_or_version_of_a_server_ends_the_session() {
    let scene = MemoryScene::new(1, 1, 1);
    let ServerMessage::Welcome(good) = welcome(&scene) else { panic!("not a Welcome") };
    let newer = ServerMessage::Welcome(Welcome { version: 9, ..good });
    for (messages, code) in [
        (vec![ServerMessage::Done], CloseCode::Protocol),
        (vec![welcome(&scene), welcome(&scene)], CloseCode::Protocol),
        (vec![newer], CloseCode::Version),
        (vec![ServerMessage::Close(Close::new(CloseCode::Busy, "full"))], CloseCode::Busy),
    ] {
        let mut client = ClientSession::new(ClientConfig::default(), None, Resume::default(), Time::ZERO);
        for message in messages {
            client.handle_message(Time::ZERO, message);
        }
        assert_eq!(closed(&mut client).unwrap().code, code);
        assert_eq!(client.poll_timeout(), None);
    }
}

#[test]
fn silence_ends_the_session_and_pings_prevent_it() {
    let mut client = ClientSession::new(ClientConfig::default(), None, Resume::default(), Time::ZERO);
    while client.poll_transmit(Time::ZERO).is_some() {}
    client.handle_timeout(Time::from_ms(9_999));
    assert!(!client.is_closed());
    client.handle_timeout(Time::from_ms(10_000));
    assert_eq!(closed(&mut client).unwrap().code, CloseCode::Timeout);

    let (mut client, _) = connected();
    for seconds in 1..200 {
        let now = Time::from_ms(seconds * 1000);
        client.handle_timeout(now);
        while let Some(message) = client.poll_transmit(now) {
            let ClientMessage::Ping(nonce) = message else { panic!("{message:?}") };
            client.handle_message(now, ServerMessage::Pong(nonce));
        }
    }
    assert!(!client.is_closed());
    client.handle_timeout(Time::from_ms(230_000));
    assert_eq!(closed(&mut client).unwrap().code, CloseCode::Timeout);
    assert!(CloseCode::Timeout.worth_retrying() && !CloseCode::Version.worth_retrying());
}

#[test]
fn only_the_latest_view_is_sent_at_intervals() {
    let (mut client, scene) = connected();
    let at = |x: f64| View { eye: [x, 0.0, 0.0], ..scene.header.camera.view([64, 64], 1.0) };
    // `Hello` had no view, so the first view is sent at once.
    client.set_view(Time::ZERO, at(-1.0));
    assert_eq!(client.poll_transmit(Time::ZERO), Some(ClientMessage::SetView(at(-1.0))));
    for x in 0..50 {
        client.set_view(Time::ZERO, at(f64::from(x)));
    }
    assert_eq!(client.poll_transmit(Time::from_ms(50)), None);
    assert_eq!(client.poll_timeout(), Some(Time::from_ms(100)));
    assert_eq!(client.poll_transmit(Time::from_ms(100)), Some(ClientMessage::SetView(at(49.0))));
    client.set_view(Time::from_ms(101), View { fov_y: f32::NAN, ..at(1.0) });
    assert_eq!(client.poll_transmit(Time::from_ms(300)), None);
}

#[test]
fn escape_codes_of_a_close_reason_are_replaced() {
    let (mut client, _) = connected();
    let reason = "\x1b[2J\x1b]0;mine\x07full\r\nagain\u{9b}31m \u{202e}txt";
    client.handle_message(
        Time::ZERO,
        ServerMessage::Close(Close { code: CloseCode::Busy, reason: reason.into() }),
    );
    let close = closed(&mut client).unwrap();
    assert!(!close.reason.chars().any(char::is_control) && !close.reason.contains('\u{202e}'), "{close:?}");
    assert!(close.reason.contains("full") && close.reason.ends_with("txt"), "{close:?}");
    assert_eq!(close.to_string().lines().count(), 1);
    assert_eq!(Close::new(CloseCode::Busy, "voll – 満員 ✓").reason, "voll – 満員 ✓");
    assert!(
        Close::new(CloseCode::Busy, "\x1b".repeat(300)).reason.len()
            <= lodestream_scene::limits::MAX_REASON_BYTES
    );
}

proptest! {
    /// For any messages, the sum of bytes in flight stays right and nothing panics.
    #[test]
    fn bytes_in_flight_match_the_pending_blobs(steps in prop::collection::vec((0..7_u8, 0..6_u32, 0..4_u32), 0..200)) {
        let (mut client, _) = connected();
        let total = 1000;
        for (n, (what, chunk, part)) in steps.into_iter().enumerate() {
            let now = Time::from_ms(n as u64);
            let id = BlobId::chunk(0, chunk);
            match what {
                0 | 1 => {
                    let part = Wanted {
                        bytes: (part > 0).then_some(total),
                        held: part / 2 * 250,
                        end: (part == 2).then_some(500),
                        ..wanted(id, total)
                    };
                    client.set_wanted(now, &[part], &[]);
                }
                2 => { client.set_wanted(now, &[], &[id]); }
                3 | 4 => client.handle_piece(now, piece(id, part * 250, total, 250)),
                5 => client.handle_abandoned(now, id),
                _ => client.handle_message(now, ServerMessage::Refused(Refused { id, reason: RefusedReason::QueueFull })),
            }
            let left: u64 = client.downloads.pending.values().filter(|p| p.requested.is_some()).map(Pending::remaining_bytes).sum();
            prop_assert_eq!(client.downloads.in_flight_bytes, left);
            while client.poll_transmit(now).is_some() {}
            while let Some(event) = client.poll_event() {
                if let ClientEvent::Blob { id, offset, bytes, .. } = event {
                    let whole = contents(&id, total);
                    prop_assert_eq!(&bytes, &whole[offset as usize..offset as usize + bytes.len()]);
                }
            }
        }
    }
}

#[test]
fn token_is_sent_before_hello_and_a_newer_one_at_once() {
    let token = |text: &str| Token(text.into());
    let config = ClientConfig { token: Some(token("first")), ..ClientConfig::default() };
    let mut client = ClientSession::new(config, None, Resume::default(), Time::ZERO);
    assert_eq!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Token(token("first"))));
    assert!(matches!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Hello(_))));
    assert!(matches!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Ping(_))));
    client.set_token(token("second"));
    assert_eq!(client.poll_transmit(Time::ZERO), Some(ClientMessage::Token(token("second"))));
    assert_eq!(client.poll_transmit(Time::ZERO), None);
    assert_eq!(format!("{:?}", token("second")), "Token of 6 bytes", "its text is for nobody's log");
}
