//! Both sessions in virtual time, and the server against peers that misbehave.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::blob::BlobPart;
use crate::client::Resume;
use crate::limits::MAX_IDS_PER_MESSAGE;
use crate::pair::Pair;
use crate::scene::SceneHeader;
use crate::select::{State, max_screen_error_px};
use crate::testing::MemoryScene;

const MBIT: u64 = 1_000_000;

fn session(scene: &Arc<MemoryScene>, config: ServerConfig) -> ServerSession {
    ServerSession::new(Arc::new(config), Arc::clone(scene) as _, 1, Time::ZERO)
}

fn hello(scene: &SceneHeader) -> Hello {
    let view = Some(scene.camera.view([1280, 720], 1.0));
    Hello { view, max_blob_bytes: 1 << 20, ..Hello::new("") }
}

/// Everything that an open-ended poll gives at one moment.
fn drain(session: &mut ServerSession, now: Time) -> Vec<Transmit> {
    std::iter::from_fn(|| session.poll_transmit(now)).collect()
}

fn begun(transmits: &[Transmit]) -> Vec<BlobId> {
    transmits
        .iter()
        .filter_map(|t| match t {
            Transmit::Piece { piece, .. } if piece.offset == 0 => Some(piece.id),
            _ => None,
        })
        .collect()
}

fn last_close(transmits: &[Transmit]) -> Option<&Close> {
    match transmits.last() {
        Some(Transmit::Message(ServerMessage::Close(close))) => Some(close),
        _ => None,
    }
}

#[test]
fn a_scene_streams_and_settles_on_both_transports() {
    let scene = MemoryScene::new(3, 4, 5);
    for config in [ServerConfig::quic(Some(2 * MBIT)), ServerConfig::websocket(Some(2 * MBIT))] {
        let mut pair = Pair::new(&scene, config, Resume::default());
        pair.run_until(Time::from_ms(20_000));
        let world = &pair.world;
        assert!(pair.selector.last().counters.settled, "{:?}", pair.selector.last().counters);
        assert!(max_screen_error_px(&pair.view, &world.instances, &world.assets) <= 1.0);
        assert!(world.done.is_some() && world.closed.is_none());
        assert_eq!(pair.client.stats().in_flight_bytes, 0);
        let mut counts = HashMap::new();
        for (_, id) in &world.blobs {
            *counts.entry(*id).or_insert(0) += 1;
        }
        assert!(counts.values().all(|n| *n == 1), "a blob was sent twice");
    }
}

#[test]
fn a_camera_that_moves_on_settles_where_it_stops_without_waste() {
    let scene = MemoryScene::new(3, 3, 6);
    let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(2 * MBIT)), Resume::default());
    for step in 1..=10 {
        pair.run_until(Time::from_ms(step * 300));
        let z = 4.0 - step as f64;
        pair.view = View::look_at([0.0, 0.4, z], [0.5, 0.0, z - 2.0], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
        pair.client.set_view(pair.now, pair.view);
    }
    pair.run_until(Time::from_ms(60_000));
    let world = &pair.world;
    assert!(world.closed.is_none() && pair.selector.last().counters.settled);
    assert!(max_screen_error_px(&pair.view, &world.instances, &world.assets) <= 1.0);
    let distinct: HashSet<_> = world.blobs.iter().map(|(_, id)| *id).collect();
    let again = world.blobs.len() - distinct.len();
    assert!(again * 20 <= world.blobs.len(), "{again} of {} came twice", world.blobs.len());
}

#[test]
fn first_frame_comes_after_bytes_at_rate_and_little_more() {
    let scene = MemoryScene::new(5, 4, 5);
    for rate in [2, 8, 16] {
        let config = ServerConfig::websocket(Some(rate * MBIT));
        let mut pair = Pair::new(&scene, config, Resume::default());
        pair.run_until(Time::from_ms(3000));
        let first_frame = pair.world.first_frame.unwrap();
        let arrivals = pair.world.arrivals.iter().filter(|(at, _)| *at <= first_frame);
        let bytes: u64 = arrivals.map(|(_, bytes)| *bytes as u64).sum();
        let ideal = pair.latency + Duration::from_nanos(bytes * 8000 / rate);
        let late = first_frame.since(Time::from(ideal));
        assert!(late < Duration::from_millis(15), "{rate} Mbit/s: {bytes} bytes, {late:?} late");
        // Base meshes and pages, and next to nothing else, come before it.
        let bases: u64 =
            pair.scene.pages.iter().flat_map(|p| &p.assets).map(|a| u64::from(a.base_bytes)).sum();
        assert!(bytes < bases + 6000, "{bytes} bytes for {bases}");
        assert!(pair.world.bases_sent.is_some());
    }
}

#[test]
fn the_link_does_not_idle_while_something_is_wanted() {
    let scene = MemoryScene::new(2, 2, 6);
    for (rate, latency) in [(2, 25), (16, 25), (8, 150)] {
        let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(rate * MBIT)), Resume::default());
        pair.latency = Duration::from_millis(latency);
        pair.run_until(Time::from_ms(30_000));
        let last = pair.world.blobs.last().unwrap().0;
        let bytes: usize = pair.world.arrivals.iter().map(|(_, bytes)| bytes).sum();
        let busy = Duration::from_nanos(bytes as u64 * 8000 / rate);
        let round_trip = pair.latency * 2;
        let allowed = busy.mul_f64(1.06) + round_trip * 3;
        assert!(last.since(Time::ZERO) < allowed, "{rate} Mbit/s: {last:?} for {busy:?} of bytes");
    }
}

#[test]
fn refinement_begins_without_a_round_trip_of_silence() {
    let scene = MemoryScene::new(1, 1, 6);
    for latency in [25, 100] {
        let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(2 * MBIT)), Resume::default());
        pair.latency = Duration::from_millis(latency);
        pair.run_until(Time::from_ms(1500));
        let first = pair.world.arrivals.first().unwrap().0;
        assert!(first.since(Time::ZERO) < pair.latency + Duration::from_millis(5));
        let gaps = pair.world.arrivals.windows(2).map(|pair| (pair[1].0.since(pair[0].0), pair[0].0));
        let after_hello = gaps.filter(|(_, at)| at.since(Time::ZERO) > pair.latency * 3);
        let longest = after_hello.max().unwrap();
        assert!(longest.0 < Duration::from_millis(25), "latency {latency} ms: {longest:?}");
    }
}

#[test]
fn every_window_of_a_saturated_session_is_within_five_percent_of_the_rate() {
    let scene = MemoryScene::new(3, 1, 7);
    for rate in [2, 8, 16] {
        let mut server = session(&scene, ServerConfig::quic(Some(rate * MBIT)));
        server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
        let chunks = (0..3).flat_map(|a| (0..5461).map(move |c| BlobId::chunk(a, c)));
        let mut chunks = chunks.cycle();
        let mut sent = Vec::new();
        let mut now = Time::ZERO;
        while now < Time::from_ms(8000) {
            if server.scheduler.queued() < 500 {
                let ids: Vec<_> = chunks.by_ref().take(900).collect();
                server.handle_message(now, ClientMessage::Cancel(ids.clone()));
                let wants = ids.iter().map(|&id| Want::whole(id, 5)).collect();
                server.handle_message(now, ClientMessage::Want(wants));
            }
            let before = server.stats().wire_bytes;
            drain(&mut server, now);
            sent.push((now, server.stats().wire_bytes - before));
            let at = server.poll_timeout().unwrap();
            // Drivers wake up late, in whole milliseconds.
            now = Time::from_ms(at.as_ns() / 1_000_000 + 1);
        }
        for start in (500..4900).step_by(61) {
            let window = Time::from_ms(start)..Time::from_ms(start + 3000);
            let bits: u64 = sent.iter().filter(|(at, _)| window.contains(at)).map(|(_, b)| b * 8).sum();
            let ratio = bits as f64 / (3 * rate * MBIT) as f64;
            assert!((0.95..=1.05).contains(&ratio), "{rate} Mbit/s from {start} ms: {ratio}");
        }
    }
}

#[test]
fn before_hello_only_the_push_budget_is_sent() {
    let scene = MemoryScene::new(12, 1, 3);
    let mut server = session(&scene, ServerConfig::quic(None));
    let pushed = drain(&mut server, Time::ZERO);
    assert!(matches!(&pushed[0], Transmit::Message(ServerMessage::Welcome(_))));
    assert!(matches!(&pushed[1], Transmit::Message(ServerMessage::ScenePage(page)) if page.page == 0));
    // The nearest plane first.
    assert_eq!(begun(&pushed).first(), Some(&BlobId::base(0)));
    let bytes = server.stats().blob_bytes;
    assert!((500..=3000).contains(&bytes), "{bytes} bytes");
    assert!(server.poll_timeout().unwrap() >= Time::from_ms(10_000), "nothing to wake up for");

    let config = ServerConfig::websocket(None);
    let mut server = session(&scene, config);
    let everything = begun(&drain(&mut server, Time::ZERO));
    assert_eq!(everything.len(), 12);
}

#[test]
fn hello_with_another_view_reorders_what_was_not_sent() {
    let scene = MemoryScene::new(12, 1, 3);
    let mut server = session(&scene, ServerConfig::quic(None));
    let before = begun(&drain(&mut server, Time::ZERO));
    let mut hello = hello(&scene.header);
    // From the far end, looking on: only the last planes are in view.
    hello.view = Some(View::look_at([0.0, 0.5, -29.0], [0.0, 0.0, -40.0], [0.0, 1.0, 0.0], 0.9, [640, 480]));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello));
    let after = drain(&mut server, Time::ZERO);
    let bases: Vec<_> = begun(&after).into_iter().filter(|id| id.part == BlobPart::Base).collect();
    assert!(bases.iter().all(|id| id.asset >= 9 && !before.contains(id)), "{bases:?}");
    assert!(bases.contains(&BlobId::base(11)));
    let told = after.iter().position(|t| matches!(t, Transmit::Message(ServerMessage::BasesSent)));
    let last_base = after.iter().rposition(
        |t| matches!(t, Transmit::Piece { piece, .. } if piece.id.part == BlobPart::Base && piece.is_last()),
    );
    assert!(told > last_base);
}

fn chunks(transmits: &[Transmit]) -> Vec<BlobId> {
    begun(transmits).into_iter().filter(|id| matches!(id.part, BlobPart::Chunk(_))).collect()
}

#[test]
fn a_client_that_repeats_the_start_view_and_asks_for_pages_is_still_pushed_chunks() {
    let scene = MemoryScene::new(1, 1, 6);
    let mut server = session(&scene, ServerConfig::quic(None));
    drain(&mut server, Time::ZERO);
    let hello = Hello { view: None, ..hello(&scene.header) };
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello));
    server.poll_transmit(Time::ZERO);
    let pages = vec![Want::whole(BlobId::index_page(0, 0), 9), Want::whole(BlobId::index_page(0, 1), 9)];
    server.handle_message(Time::ZERO, ClientMessage::Want(pages));
    let view = scene.header.camera.view([1280, 720], 1.0);
    server.handle_message(Time::ZERO, ClientMessage::SetView(view));
    let pushed = chunks(&drain(&mut server, Time::ZERO));
    assert!(pushed.len() > 10, "{pushed:?}");
}

#[test]
fn websocket_refines_the_start_view_with_its_first_window_and_no_more() {
    let scene = MemoryScene::new(3, 1, 5);
    let mut server = session(&scene, ServerConfig::websocket(None));
    let first = drain(&mut server, Time::ZERO);
    assert!(!chunks(&first).is_empty());
    let bytes = server.stats().blob_bytes;
    assert!((10_000..=14_000).contains(&bytes), "{bytes} bytes");
    // QUIC's is kept for base meshes.
    let mut server = session(&scene, ServerConfig::quic(None));
    assert_eq!(chunks(&drain(&mut server, Time::ZERO)), []);
}

#[test]
fn another_view_stops_the_push_at_once_and_gets_its_own() {
    let scene = MemoryScene::new(12, 1, 4);
    let far = View::look_at([0.0, 0.5, -29.0], [0.0, 0.0, -40.0], [0.0, 1.0, 0.0], 0.9, [640, 480]);
    let in_far_view = |id: &BlobId| id.asset >= 9;
    for late in [false, true] {
        let mut server = session(&scene, ServerConfig::websocket(None));
        let mut sent = begun(&drain(&mut server, Time::ZERO));
        assert!(!in_far_view(&sent[0]));
        if late {
            // In the middle of what is pushed for the start view.
            server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
            let more: Vec<_> = (0..20).filter_map(|_| server.poll_transmit(Time::ZERO)).collect();
            assert!(chunks(&more).iter().any(|id| !in_far_view(id)));
            sent.extend(begun(&more));
            server.handle_message(Time::ZERO, ClientMessage::SetView(far));
        } else {
            server.handle_message(
                Time::ZERO,
                ClientMessage::Hello(Hello { view: Some(far), ..hello(&scene.header) }),
            );
        }
        let after = begun(&drain(&mut server, Time::ZERO));
        assert!(after.len() > 5 && after.iter().all(in_far_view), "{after:?}");
        assert!(after.iter().all(|id| !sent.contains(id)), "nothing is pushed twice");
    }
}

/// A client whose wish goes further than what was pushed asks on when it has that: a run behind the run on
/// its way would come before there is a wish for it, and be passed over.
#[test]
fn wishes_that_meet_a_pushed_part_wait_for_the_client_to_ask_on() {
    let scene = MemoryScene::new(2, 2, 5);
    let mut server = session(&scene, ServerConfig::quic(None));
    // From far away, where beginnings of chunks suffice.
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
fn what_a_returning_client_has_is_not_pushed() {
    let scene = MemoryScene::new(4, 1, 3);
    let have = vec![BlobId::base(0), BlobId::base(2), BlobId::base(99)];
    for (fingerprint, expected) in [([3; 16], 2), ([4; 16], 4)] {
        let config = ServerConfig { push_before_hello_bytes: 0, ..ServerConfig::quic(None) };
        let mut server = session(&scene, config);
        let hello = Hello { fingerprint, have: have.clone(), ..hello(&scene.header) };
        server.handle_message(Time::ZERO, ClientMessage::Hello(hello));
        let sent = begun(&drain(&mut server, Time::ZERO));
        let bases = sent.iter().filter(|id| id.part == BlobPart::Base).count();
        assert_eq!(bases, expected, "{sent:?}");
    }
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
                Transmit::Message(ServerMessage::Refused(why)) => refused = Some(why.reason),
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
    // What the client does not say it has, but was sent, is not sent again.
    assert_eq!(ask(100, Some(400)), (vec![(300, 400, 400)], None));
    assert_eq!(ask(500, None), (vec![(500, length, length)], None));
    assert_eq!(ask(0, None), (vec![], None));
}

/// A view is refined to where chunks' beginnings suffice; coming nearer fetches what is left of them, and
/// nothing twice (the pair's client takes nothing that it has).
#[test]
fn stops_save_bytes_and_nearer_views_fetch_the_rest_only() {
    let scene = MemoryScene::new(2, 2, 5);
    let run = |stops: bool| {
        let config = ServerConfig { push_after_hello_bytes: 0, ..ServerConfig::websocket(Some(4 * MBIT)) };
        let mut pair = Pair::new(&scene, config, Resume::default());
        pair.selector.settings_mut().stops = stops;
        let mut received = Vec::new();
        for eye in [[0.0, 12.0, 30.0], [0.0, 9.0, 22.0], [0.0, 6.0, 12.0], [0.0, 3.0, 6.0]] {
            pair.view = View { eye, ..pair.view };
            pair.run_until(pair.now + Duration::from_secs(10));
            let counters = pair.selector.last().counters;
            assert!(counters.settled, "{counters:?}");
            let worst = max_screen_error_px(&pair.view, &pair.world.instances, &pair.world.assets);
            let complete =
                pair.world.assets.iter().all(|a| a.chunk_states().iter().all(|s| *s == State::Applied));
            assert!(worst <= 1.0 || complete, "{worst} px left");
            received.push(pair.world.received_bytes);
        }
        let held: u64 = pair
            .world
            .assets
            .iter()
            .flat_map(|asset| {
                (0..asset.chunks().len() as u32).map(|chunk| u64::from(asset.held_bytes(chunk)))
            })
            .sum();
        let rest: u64 = (0..2)
            .map(|asset| {
                let pages = (0..).map_while(|page| scene.blob_len(&BlobId::index_page(asset, page)));
                u64::from(scene.blob_len(&BlobId::base(asset)).unwrap()) + pages.map(u64::from).sum::<u64>()
            })
            .sum();
        assert!(*received.last().unwrap() <= held + rest, "{received:?}, {held} held");
        received
    };
    let (with, without) = (run(true), run(false));
    assert!(with.iter().zip(&without).all(|(a, b)| a <= b), "{with:?} against {without:?}");
    assert!(with[0] * 100 < without[0] * 90, "{with:?} against {without:?}");
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
fn cancelled_blobs_stop_half_way() {
    let scene = MemoryScene::new(1, 1, 3);
    let config = ServerConfig { piece_bytes: 100, ..ServerConfig::websocket(Some(MBIT)) };
    let mut server = session(&scene, config);
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    let mut now = Time::ZERO;
    while server.scheduler.begun().next().is_none() {
        assert!(server.poll_transmit(now).is_some());
        now = now + Duration::from_millis(1);
    }
    let Some((_, Unit::Blob(id))) = server.scheduler.begun().next() else { panic!("no blob has begun") };
    server.handle_message(now, ClientMessage::Cancel(vec![id]));
    assert_eq!(server.poll_transmit(now), Some(Transmit::Abandon(id)));
    let later = drain(&mut server, now + Duration::from_secs(60));
    assert!(!later.iter().any(|t| matches!(t, Transmit::Piece { piece, .. } if piece.id == id)));
}

#[test]
fn peers_out_of_turn_or_version_get_a_reasoned_close() {
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
    assert!(idle.close_reason().unwrap().reason.contains("nothing heard"));

    let mut stalled = session(&scene, ServerConfig::quic(None));
    stalled.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    for second in 0..29 {
        stalled.handle_message(Time::from_ms(second * 1000), ClientMessage::Ping(1));
        stalled.handle_timeout(Time::from_ms(second * 1000));
    }
    assert!(stalled.close_reason().is_none());
    stalled.handle_timeout(Time::from_ms(30_001));
    assert!(stalled.close_reason().unwrap().reason.contains("nothing taken"));
}

#[test]
fn pings_keep_a_settled_session_alive() {
    let scene = MemoryScene::new(1, 1, 2);
    let mut pair = Pair::new(&scene, ServerConfig::websocket(Some(8 * MBIT)), Resume::default());
    pair.run_until(Time::from_ms(300_000));
    assert!(pair.world.closed.is_none() && !pair.server.is_closed());
    assert_eq!(pair.client.stats().rtt.map(|rtt| rtt.as_millis()), Some(50));
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
            Transmit::Message(ServerMessage::Refused(refused)) => Some(refused.reason),
            _ => None,
        })
        .collect();
    assert!(refused.iter().filter(|r| **r == RefusedReason::QueueFull).count() >= 190);
    assert_eq!(refused.iter().filter(|r| **r == RefusedReason::NotFound).count(), 3);
}

#[test]
fn peers_that_take_no_answers_are_closed() {
    let scene = MemoryScene::new(1, 1, 2);
    let mut server = session(&scene, ServerConfig::quic(None));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    for nonce in 0..10_000 {
        server.handle_message(Time::ZERO, ClientMessage::Ping(nonce));
    }
    assert_eq!(server.close_reason().unwrap().code, CloseCode::Limit);
    assert!(server.control.len() <= 1);
}

#[test]
fn ceilings_are_shared_fairly() {
    let scene = MemoryScene::new(1, 1, 6);
    let ceiling = crate::limiter::SharedCeiling::new(4 * MBIT);
    let mut sessions: Vec<_> = (0..4)
        .map(|_| {
            let mut server = session(&scene, ServerConfig::quic(Some(16 * MBIT)));
            server.set_ceiling(ceiling.join());
            server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
            let wants = (0..1000).map(|c| Want::whole(BlobId::chunk(0, c), 3)).collect();
            server.handle_message(Time::ZERO, ClientMessage::Want(wants));
            server
        })
        .collect();
    for ms in 0..1000 {
        for server in &mut sessions {
            drain(server, Time::from_ms(ms));
        }
    }
    let sent: Vec<u64> = sessions.iter().map(|s| s.stats().wire_bytes).collect();
    for bytes in &sent {
        assert!((110_000..150_000).contains(bytes), "{sent:?}");
    }
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

    /// Whatever a peer says and whenever, the session neither panics nor grows beyond its bounds, and it
    /// always ends or goes on sending.
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
            prop_assert!(server.scheduler.queued() <= 200);
            prop_assert!(server.scheduler.begun().count() <= 9);
            prop_assert!(server.control.len() <= MAX_CONTROL_QUEUED + 1);
            prop_assert!(server.abandoned.len() <= 9 * 60);
            prop_assert!(server.handed.len() <= 2 * (85 + 2 + 1) + 2);
            prop_assert!(server.push.len() <= scene.pages.len() + 2);
        }
        // Left alone with a transport that takes everything, it comes to rest.
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
