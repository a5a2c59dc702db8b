//! Slow stores: other blobs continue, and nothing is lost or sent twice.

use std::collections::BTreeMap;
use std::time::Duration;

use super::*;
use crate::client::Resume;
use crate::message::{ClientMessage, Want};
use crate::pair::Pair;
use crate::scheduler::MAX_READS;
use crate::source::{Reading, SceneSource as _};
use lodestream_scene::blob::BlobPart;
use lodestream_select::max_screen_error_px;

fn slow_session(scene: &Arc<MemoryScene>, is_slow: fn(&BlobId) -> bool) -> ServerSession {
    let source = crate::testing::SlowScene { scene: Arc::clone(scene), is_slow };
    let config = ServerConfig { push_after_hello_bytes: 0, ..ServerConfig::websocket(None) };
    ServerSession::new(Arc::new(config), Arc::new(source), 1, Time::ZERO)
}

/// One read takes five seconds and delays no other blob.
#[test]
fn slow_read_delays_no_other_blob() {
    let scene = MemoryScene::new(3, 2, 5);
    let config = ServerConfig::websocket(Some(4 * MBIT));
    let is_slow = |id: &BlobId| *id == BlobId::base(1);
    let mut plain = Pair::new(&scene, config.clone(), Resume::default());
    let mut pair = Pair::slow(&scene, config, is_slow);
    pair.read_time = Duration::from_secs(5);
    plain.run_until(Time::from_ms(4_900));
    pair.run_until(Time::from_ms(4_900));
    let without = |pair: &Pair| {
        let others = pair.client_state.blobs.iter().filter(|(_, id)| id.asset() != Some(1));
        others.map(|(_, id)| *id).collect::<std::collections::BTreeSet<_>>()
    };
    assert_eq!(without(&pair), without(&plain));
    assert!(without(&plain).len() > 50);
    assert!(pair.client_state.bases_sent.is_none() && !pair.selector.last().counters.settled);
    pair.run_until(Time::from_ms(20_000));
    assert!(pair.client_state.bases_sent.is_some() && pair.selector.last().counters.settled);
    assert!(pair.client_state.done.is_some() && pair.client_state.closed.is_none());
}

/// Every read takes 40 ms: each blob arrives once, and outstanding reads are bounded.
#[test]
fn slow_store_sends_each_blob_once() {
    let scene = MemoryScene::new(3, 4, 5);
    for config in [ServerConfig::quic(Some(2 * MBIT)), ServerConfig::websocket(Some(16 * MBIT))] {
        let mut pair = Pair::slow(&scene, config, |_| true);
        pair.run_until(Time::from_ms(60_000));
        let client_state = &pair.client_state;
        assert!(pair.selector.last().counters.settled, "{:?}", pair.selector.last().counters);
        assert!(max_screen_error_px(&pair.view, &client_state.instances, &client_state.assets) <= 1.0);
        assert!(client_state.done.is_some() && client_state.closed.is_none());
        let mut counts = BTreeMap::new();
        for (_, id) in &client_state.blobs {
            *counts.entry(*id).or_insert(0) += 1;
        }
        assert!(counts.values().all(|n| *n == 1), "a blob was sent twice");
        assert!((4..=2 * MAX_READS).contains(&pair.most_reads), "{}", pair.most_reads);
        assert!(pair.reads.is_empty());
    }
}

/// The server reads the index pages for the pushed refinement without blocking.
#[test]
fn pushed_refinement_waits_for_its_index_pages() {
    let scene = MemoryScene::new(1, 1, 6);
    let is_page = |id: &BlobId| matches!(id.part(), Some(BlobPart::IndexPage(_)));
    let mut pair = Pair::slow(&scene, ServerConfig::websocket(Some(16 * MBIT)), is_page);
    pair.asks = false;
    pair.run_until(Time::from_ms(3000));
    let chunks = |pair: &Pair| {
        pair.client_state.blobs.iter().filter(|(_, id)| matches!(id.part(), Some(BlobPart::Chunk(_)))).count()
    };
    assert!(chunks(&pair) > 10, "{}", chunks(&pair));
    let mut plain = Pair::new(&scene, ServerConfig::websocket(Some(16 * MBIT)), Resume::default());
    plain.asks = false;
    plain.run_until(Time::from_ms(3000));
    assert!(chunks(&pair) * 10 >= chunks(&plain) * 9, "{} of {}", chunks(&pair), chunks(&plain));
}

#[test]
fn closed_session_drops_outstanding_reads() {
    let scene = MemoryScene::new(2, 1, 4);
    let mut server = slow_session(&scene, |_| true);
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    drain(&mut server, Time::ZERO);
    let wants = (0..40).map(|chunk| Want::whole(BlobId::chunk(0, chunk), 9)).collect();
    server.handle_message(Time::ZERO, ClientMessage::Want(wants));
    drain(&mut server, Time::ZERO);
    let reads: Vec<_> = std::iter::from_fn(|| server.poll_read()).collect();
    assert_eq!(reads.len(), MAX_READS);
    server.handle_message(Time::ZERO, ClientMessage::Bye);
    assert!(server.is_closed());
    let bytes = scene.read(&reads[0]);
    for id in reads {
        server.handle_read(Time::ZERO, id, &scene.read(&id));
    }
    assert!(server.requests.scheduler.is_empty());
    assert_eq!((drain(&mut server, Time::ZERO), server.poll_read()), (Vec::new(), None));
    // Only the test holds the bytes.
    assert!(bytes.unwrap().is_unique());
}

/// A session whose blobs are all being read is not stalled.
#[test]
fn waiting_for_the_store_is_not_a_client_stall() {
    let scene = MemoryScene::new(1, 1, 3);
    let mut server = slow_session(&scene, |id| matches!(id.part(), Some(BlobPart::Chunk(_))));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    drain(&mut server, Time::ZERO);
    let id = BlobId::chunk(0, 0);
    server.handle_message(Time::ZERO, ClientMessage::Want(vec![Want::whole(id, 9)]));
    drain(&mut server, Time::ZERO);
    assert_eq!(server.poll_read(), Some(id));
    for second in 1..100 {
        let now = Time::from_ms(second * 1000);
        server.handle_message(now, ClientMessage::Ping(1));
        server.handle_timeout(now);
        let said = drain(&mut server, now);
        assert!(matches!(said[..], [Transmit::Message { message: ServerMessage::Pong(_), .. }]), "{said:?}");
    }
    let now = Time::from_ms(100_000);
    server.handle_read(now, id, &scene.read(&id));
    assert_eq!(begun(&drain(&mut server, now)), [id]);
    assert!(matches!(scene.try_read(&id), Ok(Reading::Ready(_))), "stores in memory read at once");
}
