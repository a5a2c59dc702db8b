//! Blobs that are damaged, missing, refused or lost, and arrive later.

use bytes::Bytes;
use lodestream_protocol::message::CloseCode;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::Camera;
use lodestream_scene::terrain::OverridePatch;
use lodestream_select::State;

use super::{Change, Loopback, TestScene, finest, prepared, view};

/// A client that requests all of an asset, one of whose chunks is damaged; and that chunk.
fn damaged() -> (Loopback, BlobId) {
    let mut scene = TestScene::new(1);
    let bad = BlobId::chunk(0, 1);
    scene.damage(bad);
    let mut link = Loopback::new(scene, |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    (link, bad)
}

#[test]
fn damaged_blobs_are_requested_a_few_times_and_affect_no_others() {
    let (mut link, bad) = damaged();
    link.run(20_000);
    let stats = link.core.stats();
    assert_eq!(link.times_sent()[&bad], 4, "no storm");
    assert_eq!(stats.decode_failures, 4);
    assert_eq!(
        (stats.settled, stats.lacking_blobs),
        (false, 1),
        "a picture that lacks a chunk is not settled"
    );
    assert!(!link.core.mesh(0).unwrap().is_applied(1));
    assert!(link.core.mesh(0).unwrap().is_applied(0));

    // The missing blob counts only in views that need it.
    let camera = TestScene::new(1).camera();
    let away = Camera { target: [0.0, 1e6, 0.0], up: [1.0, 0.0, 0.0], ..camera };
    link.core.set_view(link.now, view(away, 1e-4));
    link.run(2000);
    let stats = link.core.stats();
    assert_eq!((stats.counters.visible_instances, stats.settled, stats.lacking_blobs), (0, true, 0));
    link.core.set_view(link.now, finest());
    link.run(2000);
    assert!(link.core.lacking_blobs().eq([bad]) && !link.core.is_settled());
}

/// An empty chunk cannot be decoded, and the server sends no other bytes of it: the chunk is reported as missing
/// instead of being wanted forever.
#[test]
fn an_empty_chunk_before_its_index_page_is_reported_as_missing() {
    let mut scene = TestScene::new(1);
    let bad = BlobId::chunk(0, 0);
    scene.damaged.insert(bad, Bytes::new());
    let mut link = Loopback::new(scene, |_| {});
    link.connect();
    link.run(20_000);
    let stats = link.core.stats();
    let told = stats.lacking.contains(&bad) || link.core.closed().is_some();
    assert!(told && stats.decode_failures > 0, "neither lacking nor closed: {stats:?}");
}

#[test]
fn an_asset_without_its_base_mesh_is_missing_and_requests_nothing_else() {
    for damaged in [false, true] {
        let bad = BlobId::base(1);
        let mut scene = TestScene::new(2);
        if damaged {
            scene.damage(bad);
        } else {
            scene.missing.insert(bad);
        }
        let mut link = Loopback::new(scene, |_| {});
        link.core.set_view(link.now, finest());
        link.connect();
        link.run(20_000);
        let stats = link.core.stats();
        assert_eq!((stats.settled, &stats.lacking[..]), (false, &[bad][..]), "damaged: {damaged}: {stats:?}");
        assert!(stats.milestones.first_frame.is_none() && link.core.mesh(1).is_none());
        let all = prepared().1.chunks.len() as u64;
        assert_eq!(stats.applied_chunks, all, "the other asset is whole");
    }
}

/// The server can read the blob again after any number of refusals: the client still requests it and decodes the valid
/// bytes.
#[test]
fn a_refused_blob_arrives_once_it_can_be_read() {
    let scene = TestScene::new(1);
    scene.unreadable.lock().unwrap().insert(BlobId::chunk(0, 0));
    let mut link = Loopback::new(scene, |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    link.run(600_000);
    let stats = link.core.stats();
    assert_eq!((stats.settled, stats.lacking_blobs), (false, 1), "{stats:?}");
    assert!((4..=30).contains(&stats.refused), "asked for again, without a storm: {}", stats.refused);
    link.source.unreadable.lock().unwrap().clear();
    link.settle();
    assert_eq!(link.core.stats().applied_chunks, prepared().1.chunks.len() as u64);
    assert_eq!(link.core.stats().lacking_blobs, 0);
}

#[test]
fn a_blob_that_is_repaired_is_used() {
    let (mut link, _) = damaged();
    while link.core.stats().decode_failures == 0 {
        link.run(1);
    }
    // The server restarts with an undamaged pack.
    link.cut();
    link.source = std::sync::Arc::new(TestScene::new(1));
    link.connect();
    link.settle();
    assert_eq!(link.core.stats().applied_chunks, prepared().1.chunks.len() as u64);
}

/// The server restarts with another scene, whose base mesh arrives before `Welcome`: it must not be taken for the asset
/// of the same number in the old scene.
#[test]
fn a_base_mesh_before_welcome_is_not_used_for_the_previous_scene() {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.connect();
    link.settle();
    link.cut();
    link.source = std::sync::Arc::new(TestScene::compressed().with_fingerprint(9));
    link.connect_overtaken();
    // The old scene's picture counts as settled until the server has announced the new scene.
    while !link.core.is_open() {
        link.run(1);
    }
    link.settle();
    assert_eq!(link.core.scene().unwrap().fingerprint, [9; 16]);
    assert!(link.core.mesh(0).is_some(), "the new scene's asset never came");
    assert!(link.times_sent().values().all(|n| *n <= 2), "{:?}", link.times_sent());
}

#[test]
fn a_lost_connection_keeps_the_picture_and_fetches_only_what_is_missing() {
    let mut link = Loopback::new(TestScene::new(2), |_| {});
    link.connect();
    while link.core.stats().applied_chunks < 3 {
        link.run(1);
    }
    let before = link.core.stats();
    link.cut();
    assert!(link.core.closed().is_some());
    link.run(500);
    assert!(link.core.stats().applied_chunks >= before.applied_chunks);
    let sent = link.sent.len();
    let here = |link: &Loopback, id: BlobId| matches!(link.core.state(id), State::Cached | State::Applied);
    let held: Vec<BlobId> = link.sent.iter().copied().filter(|id| here(&link, *id)).collect();
    link.connect();
    link.settle();
    let stats = link.core.stats();
    assert_eq!(stats.connections, 2);
    assert!(stats.counters.max_screen_error_px <= 1.0);
    let again: Vec<&BlobId> = link.sent[sent..].iter().filter(|id| held.contains(id)).collect();
    assert!(again.is_empty(), "{again:?} came again");
    assert!(link.sent.len() > sent, "what was under way still came");
}

#[test]
fn a_chunk_that_the_server_lacks_is_given_up_and_the_rest_comes() {
    let mut hills = TestScene::new(1);
    hills.missing.insert(BlobId::chunk(0, 0));
    let mut link = Loopback::new(hills, |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    for _ in 0..60_000 {
        link.run(1);
        if link.core.lacking_blobs().next().is_some() {
            break;
        }
    }
    assert!(link.core.lacking_blobs().eq([BlobId::chunk(0, 0)]) && !link.core.is_settled());
    let mesh = link.core.mesh(0).unwrap();
    assert!(!mesh.is_applied(0));
    assert!(mesh.face_count() < prepared().0.faces.len());
    assert_eq!(link.core.state(BlobId::chunk(0, 0)), State::Failed);
}

#[test]
fn a_patch_outside_the_world_ends_the_session_only() {
    let patch = |x: i32, y: i32| OverridePatch { x, y, bytes: 100, error: 900 };
    let run = |listed: &[OverridePatch]| {
        let mut link = Loopback::new(TestScene::new(1).on_terrain(4, listed), |_| {});
        link.connect();
        link.run(200);
        (link.core.closed().cloned(), link.core.take_changes(link.now, usize::MAX))
    };
    // The terrain extends from -16 to 15 along both axes.
    let (closed, _) = run(&[patch(-16, 15), patch(15, -16)]);
    assert_eq!(closed, None);
    for (x, y) in [(16, 0), (0, 16), (-17, 0), (0, -17), (i32::MAX, 0), (0, i32::MIN)] {
        let (closed, changes) = run(&[patch(0, 0), patch(x, y)]);
        let closed = closed.expect("the session goes on");
        assert_eq!(closed.code, CloseCode::Protocol);
        assert!(closed.reason.contains(&format!("({x}, {y})")), "{closed}");
        assert!(!changes.iter().any(|change| matches!(change, Change::HeightOverrides { .. })));
    }
}
