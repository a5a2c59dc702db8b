//! Peers that misbehave, and any sequence of messages.

use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::message::{ClientMessage, CloseCode, Want};
use crate::server::outbox::MAX_QUEUED_BYTES;
use lodestream_scene::limits::MAX_IDS_PER_MESSAGE;
use lodestream_scene::view::View;

#[test]
fn wrong_order_or_version_closes_with_a_reason() {
    let scene = MemoryScene::new(1, 1, 2);
    let good = hello(&scene.header);
    let cases = [
        (vec![ClientMessage::Want(Vec::new())], CloseCode::Protocol),
        (vec![ClientMessage::Hello(good.clone()), ClientMessage::Hello(good.clone())], CloseCode::Protocol),
        (
            vec![ClientMessage::Hello(Hello { version_min: 7, version_max: 9, ..good.clone() })],
            CloseCode::Version,
        ),
        (vec![ClientMessage::Hello(Hello { scene: "moon".into(), ..good.clone() })], CloseCode::NoSuchScene),
    ];
    for (messages, code) in cases {
        let mut server = session(&scene, ServerConfig::quic(None));
        for message in messages {
            server.handle_message(Time::ZERO, message);
        }
        let sent = drain(&mut server, Time::ZERO);
        let close = last_close(&sent).unwrap();
        assert_eq!(close.code, code);
        assert!(!close.reason.is_empty() && server.is_closed());
        assert_eq!(server.poll_timeout(), None);
    }
    let mut server = session(&scene, ServerConfig::quic(None));
    server.handle_message(Time::ZERO, ClientMessage::Hello(good));
    server.handle_message(Time::ZERO, ClientMessage::Bye);
    assert!(server.is_closed());
    assert!(drain(&mut server, Time::ZERO).is_empty());
}

#[test]
fn silent_idle_and_stalled_peers_time_out() {
    let scene = MemoryScene::new(1, 1, 3);
    let mut silent = session(&scene, ServerConfig::quic(None));
    drain(&mut silent, Time::ZERO);
    let at = silent.poll_timeout().unwrap();
    assert_eq!(at, Time::from_ms(10_000));
    silent.handle_timeout(at);
    assert_eq!(silent.close_reason().unwrap().code, CloseCode::Timeout);

    let mut idle = session(&scene, ServerConfig::quic(None));
    idle.handle_message(Time::from_ms(5), ClientMessage::Hello(hello(&scene.header)));
    drain(&mut idle, Time::from_ms(5));
    let at = idle.poll_timeout().unwrap();
    assert_eq!(at, Time::from_ms(30_005));
    idle.handle_timeout(at);
    assert!(idle.close_reason().unwrap().reason.contains("no message from the client"));

    let mut stalled = session(&scene, ServerConfig::quic(None));
    stalled.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    for second in 0..29 {
        stalled.handle_message(Time::from_ms(second * 1000), ClientMessage::Ping(1));
        stalled.handle_timeout(Time::from_ms(second * 1000));
    }
    assert!(stalled.close_reason().is_none());
    stalled.handle_timeout(Time::from_ms(30_001));
    assert!(stalled.close_reason().unwrap().reason.contains("the transport has accepted nothing"));
}

#[test]
fn peers_that_read_no_answers_are_closed() {
    let scene = MemoryScene::new(1, 1, 2);
    let mut server = session(&scene, ServerConfig::quic(None));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    for nonce in 0..10_000 {
        server.handle_message(Time::ZERO, ClientMessage::Ping(nonce));
    }
    assert_eq!(server.close_reason().unwrap().code, CloseCode::Limit);
    assert!(matches!(server.control.pop(), Some(ServerMessage::Close(_))) && server.control.is_empty());
}

#[test]
fn refusals_to_a_client_that_reads_nothing_are_bounded() {
    let scene = MemoryScene::new(1, 1, 2);
    let mut server = session(&scene, ServerConfig::quic(None));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    drain(&mut server, Time::ZERO);
    let bogus = |n: u32| ClientMessage::Want(vec![Want::whole(BlobId::chunk(7, n), 1); MAX_IDS_PER_MESSAGE]);
    server.handle_message(Time::ZERO, bogus(0));
    assert!(server.close_reason().is_none(), "one message is refused, not punished");
    let refusals = drain(&mut server, Time::ZERO);
    assert_eq!(refusals.iter().filter(|t| matches!(t, Transmit::Message { message: ServerMessage::RefusedMany(many), .. } if many.len() == MAX_IDS_PER_MESSAGE)).count(), 1);
    for n in 0..4 {
        server.handle_message(Time::ZERO, bogus(n));
        assert!(server.control.bytes() <= MAX_QUEUED_BYTES);
    }
    assert_eq!(server.close_reason().unwrap().code, CloseCode::Limit);
}

fn any_message() -> impl Strategy<Value = ClientMessage> {
    let id = prop_oneof![
        (0..3_u32).prop_map(BlobId::base),
        (0..3_u32, 0..9_u32).prop_map(|(a, p)| BlobId::index_page(a, p)),
        (0..3_u32, 0..400_u32).prop_map(|(a, c)| BlobId::chunk(a, c)),
        (0..3_u32, any::<u16>(), any::<u8>()).prop_map(|(a, t, l)| BlobId::texture(a, t, l)),
    ];
    let view = prop::array::uniform3(-20.0..20.0_f64)
        .prop_map(|eye| View::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.9, [800, 600]));
    let scene = MemoryScene::new(1, 1, 1);
    let wants = (id.clone(), any::<u32>()).prop_map(|(id, priority)| Want::whole(id, priority));
    prop_oneof![
        1 => Just(ClientMessage::Hello(hello(&scene.header))),
        8 => prop::collection::vec(wants, 0..MAX_IDS_PER_MESSAGE / 8).prop_map(ClientMessage::Want),
        4 => prop::collection::vec(id, 0..50).prop_map(ClientMessage::Cancel),
        2 => view.prop_map(ClientMessage::SetView),
        2 => prop::collection::vec(0..9_u32, 0..9).prop_map(ClientMessage::WantScenePages),
        2 => any::<u32>().prop_map(ClientMessage::Ping),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// For any messages in any order, the session does not panic, stays within its bounds, and ends or continues to
    /// send.
    #[test]
    fn any_sequence_of_messages_is_survived(
        steps in prop::collection::vec((any_message(), 0..300_u64, 0..40_usize), 0..60),
        greet in any::<bool>(),
        rate in prop_oneof![Just(None), (1..20_u64).prop_map(|m| Some(m * 100_000))],
    ) {
        let scene = MemoryScene::new(2, 3, 4);
        let config = ServerConfig { max_queued: 200, ..ServerConfig::quic(rate) };
        let mut server = session(&scene, config);
        let mut now = Time::ZERO;
        if greet {
            server.handle_message(now, ClientMessage::Hello(hello(&scene.header)));
        }
        for (message, wait_ms, takes) in steps {
            now = now + Duration::from_millis(wait_ms);
            // A second Hello ends the session: once is enough of that.
            if !(greet && matches!(message, ClientMessage::Hello(_)) && wait_ms > 20) {
                server.handle_message(now, message);
            }
            server.handle_timeout(now);
            for _ in 0..takes {
                if let Some(Transmit::Piece { piece, .. }) = server.poll_transmit(now) {
                    prop_assert!(!piece.bytes.is_empty() && piece.bytes.len() <= 1200);
                }
            }
            prop_assert!(server.requests.scheduler.queued() <= 200);
            prop_assert!(server.requests.scheduler.begun().count() <= 9);
            prop_assert!(server.control.bytes() <= MAX_QUEUED_BYTES);
            prop_assert!(server.requests.abandoned_count() <= 9 * 60);
            prop_assert!(server.requests.sent_count() <= 2 * (85 + 2 + 1) + 2);
            prop_assert!(server.push.queued() <= scene.pages.len() + 2);
        }
        // Without further messages and with a free transport, it becomes idle.
        for _ in 0..1_000_000 {
            drain(&mut server, now);
            if !server.has_work() {
                break;
            }
            let at = server.poll_timeout().unwrap();
            prop_assert!(at > now);
            now = at;
        }
        prop_assert!(!server.has_work());
    }
}
