//! Pushed units, before and after `Hello`.

use super::*;
use crate::message::{ClientMessage, Want};
use crate::server::Plans;
use lodestream_scene::blob::BlobPart;
use lodestream_scene::view::View;

#[test]
fn before_hello_only_the_push_budget_is_sent() {
    let scene = MemoryScene::new(12, 1, 3);
    let mut server = session(&scene, ServerConfig::quic(None));
    let pushed = drain(&mut server, Time::ZERO);
    assert!(matches!(&pushed[0], Transmit::Message { message: ServerMessage::Welcome(_), .. }));
    assert!(
        matches!(&pushed[1], Transmit::Message { message: ServerMessage::ScenePage(page), .. } if page.page == 0)
    );
    // The nearest plane comes first.
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
    // Seen from the far end, only the last planes are in view.
    hello.view = Some(View::look_at([0.0, 0.5, -29.0], [0.0, 0.0, -40.0], [0.0, 1.0, 0.0], 0.9, [640, 480]));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello));
    let after = drain(&mut server, Time::ZERO);
    let bases: Vec<_> = begun(&after).into_iter().filter(|id| id.part() == Some(BlobPart::Base)).collect();
    assert!(bases.iter().all(|id| id.asset() >= Some(9) && !before.contains(id)), "{bases:?}");
    assert!(bases.contains(&BlobId::base(11)));
    let told =
        after.iter().position(|t| matches!(t, Transmit::Message { message: ServerMessage::BasesSent, .. }));
    let last_base = after.iter().rposition(
        |t| matches!(t, Transmit::Piece { piece, .. } if piece.id.part() == Some(BlobPart::Base) && piece.is_last()),
    );
    assert!(told > last_base);
}

#[test]
fn a_page_that_no_first_frame_waits_for_has_the_priority_of_a_stream() {
    let scene = MemoryScene::new(24, 1, 2);
    let mut server = session(&scene, ServerConfig::quic(None));
    let mut hello = hello(&scene.header);
    // The planes of the first two pages are in view, those of the third are behind the camera.
    hello.view = Some(View::look_at([0.0, 0.5, -31.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.9, [640, 480]));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello));
    let page = |transmit: Transmit| match transmit {
        Transmit::Message { message: ServerMessage::ScenePage(page), page_priority, .. } => {
            Some((page.page, page_priority))
        }
        _ => None,
    };
    let mut pages: Vec<_> = drain(&mut server, Time::ZERO).into_iter().filter_map(page).collect();
    pages.sort_unstable_by_key(|(number, _)| *number);
    assert_eq!(pages[..2], [(0, None), (1, None)]);
    let last = pages[2].1.expect("it would overtake base meshes");
    assert!(pages.len() == 3 && last > 0 && !lodestream_select::priority::is_base(last), "{pages:?}");
}

fn chunks(transmits: &[Transmit]) -> Vec<BlobId> {
    begun(transmits).into_iter().filter(|id| matches!(id.part(), Some(BlobPart::Chunk(_)))).collect()
}

#[test]
fn repeated_start_view_and_page_requests_do_not_stop_the_push() {
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
fn websocket_refines_the_start_view_within_its_first_window() {
    let scene = MemoryScene::new(3, 1, 5);
    let mut server = session(&scene, ServerConfig::websocket(None));
    let first = drain(&mut server, Time::ZERO);
    assert!(!chunks(&first).is_empty());
    let bytes = server.stats().blob_bytes;
    assert!((10_000..=14_000).contains(&bytes), "{bytes} bytes");
    // On QUIC, bytes before `Hello` are for base meshes.
    let mut server = session(&scene, ServerConfig::quic(None));
    assert_eq!(chunks(&drain(&mut server, Time::ZERO)), []);
}

#[test]
fn changed_view_withdraws_the_push_and_gets_its_own() {
    let scene = MemoryScene::new(12, 1, 4);
    let far = View::look_at([0.0, 0.5, -29.0], [0.0, 0.0, -40.0], [0.0, 1.0, 0.0], 0.9, [640, 480]);
    let in_far_view = |id: &BlobId| id.asset() >= Some(9);
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

#[test]
fn blobs_of_a_returning_client_are_not_pushed() {
    let scene = MemoryScene::new(4, 1, 3);
    let have = vec![BlobId::base(0), BlobId::base(2), BlobId::base(99)];
    for (fingerprint, expected) in [([3; 16], 2), ([4; 16], 4)] {
        let config = ServerConfig { push_before_hello_bytes: 0, ..ServerConfig::quic(None) };
        let mut server = session(&scene, config);
        let hello = Hello { fingerprint, have: have.clone(), ..hello(&scene.header) };
        server.handle_message(Time::ZERO, ClientMessage::Hello(hello));
        let sent = begun(&drain(&mut server, Time::ZERO));
        let bases = sent.iter().filter(|id| id.part() == Some(BlobPart::Base)).count();
        assert_eq!(bases, expected, "{sent:?}");
    }
}

/// A client that requests height overrides may not know any chunk yet.
#[test]
fn requests_for_height_overrides_do_not_stop_the_push() {
    let scene = MemoryScene::new(12, 1, 4);
    let far = View::look_at([0.0, 0.5, -29.0], [0.0, 0.0, -40.0], [0.0, 1.0, 0.0], 0.9, [640, 480]);
    let mut server = session(&scene, ServerConfig::quic(None));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    drain(&mut server, Time::ZERO);
    let points = vec![Want::whole(BlobId::height_overrides(0), 9)];
    server.handle_message(Time::ZERO, ClientMessage::Want(points));
    server.handle_message(Time::ZERO, ClientMessage::SetView(far));
    let pushed = chunks(&drain(&mut server, Time::ZERO));
    assert!(pushed.len() > 5, "{pushed:?}");
}

/// Sixteen units are moved to the queue at a time; those that do not fit must not be dropped.
#[test]
fn queue_shorter_than_the_push_loses_no_page() {
    let scene = MemoryScene::new(1, 400, 2);
    let pages = scene.header.page_count;
    assert!(pages > 40);
    for max_queued in [1, 5, 15] {
        let config = ServerConfig { max_queued, ..ServerConfig::quic(None) };
        let mut server = session(&scene, config);
        server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
        let mut told: Vec<u32> = pages_of(&drain(&mut server, Time::ZERO));
        told.sort_unstable();
        assert_eq!(told, (0..pages).collect::<Vec<_>>(), "a queue of {max_queued}");
        // Pages requested again are not lost either.
        server.handle_message(Time::ZERO, ClientMessage::WantScenePages((0..pages).collect()));
        let mut told = pages_of(&drain(&mut server, Time::ZERO));
        told.sort_unstable();
        assert_eq!(told, (0..pages).collect::<Vec<_>>(), "again, with a queue of {max_queued}");
    }
}

fn pages_of(transmits: &[Transmit]) -> Vec<u32> {
    let page = |transmit: &Transmit| match transmit {
        Transmit::Message { message: ServerMessage::ScenePage(page), .. } => Some(page.page),
        _ => None,
    };
    transmits.iter().filter_map(page).collect()
}

/// A scene that counts the reads of its pages.
struct Watched {
    scene: Arc<MemoryScene>,
    looks: std::sync::atomic::AtomicUsize,
}

impl crate::source::SceneSource for Watched {
    fn header(&self) -> &SceneHeader {
        self.scene.header()
    }

    fn page(&self, page: u32) -> Option<Arc<lodestream_scene::description::ScenePage>> {
        self.looks.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        self.scene.page(page)
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.scene.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<bytes::Bytes, crate::source::SourceError> {
        self.scene.read(id)
    }
}

#[test]
fn flight_for_the_start_view_is_computed_once() {
    let scene = MemoryScene::new(4, 400, 2);
    let pages = scene.pages.len();
    let watched = Arc::new(Watched { scene, looks: Default::default() });
    let (plans, config) = (Plans::new(), Arc::new(ServerConfig::quic(None)));
    let alone = drain(&mut session(&watched.scene, ServerConfig::quic(None)), Time::ZERO);
    for n in 0..100 {
        let source = Arc::clone(&watched) as Arc<dyn crate::source::SceneSource>;
        let mut server =
            ServerSession::with_plans(Arc::clone(&plans), Arc::clone(&config), source, 1, Time::ZERO);
        assert_eq!(drain(&mut server, Time::ZERO), alone, "session {n}");
    }
    let looks = watched.looks.load(std::sync::atomic::Ordering::Relaxed);
    assert!(looks < pages + 100 * 20, "{looks} looks at {pages} pages");
}

#[test]
fn reordering_is_less_frequent_for_large_scenes() {
    let mut scene = MemoryScene::new(1, 40, 2);
    Arc::get_mut(&mut scene).unwrap().header.instance_count = 1_000_000;
    let mut server = session(&scene, ServerConfig::quic(Some(100_000)));
    server.handle_message(Time::ZERO, ClientMessage::Hello(hello(&scene.header)));
    let view = |n: u64| View { eye: [n as f64, 1.0, 4.0], ..scene.header.camera.view([1280, 720], 1.0) };
    let mut orderings = std::collections::BTreeSet::new();
    for n in 1..50 {
        let now = Time::from_ms(100 * n);
        server.handle_message(now, ClientMessage::SetView(view(n)));
        orderings.extend(server.push.replan_at());
        server.handle_timeout(now);
    }
    assert!((4..=6).contains(&orderings.len()), "{orderings:?}");
}
