//! Chunks applied up to a truncation point: only the rest is fetched, and they are undone like others.

use lodestream_scene::blob::BlobId;
use lodestream_scene::description::Camera;
use lodestream_select::Share;

use super::{Config, Loopback, TestScene, finest, prepared, view};

/// A link whose client ignores attribute errors and receives nothing unrequested.
fn frugal(source: TestScene, truncation_points: bool, adapt: impl FnOnce(&mut Config)) -> Loopback {
    let mut link = Loopback::new(source, |config: &mut Config| {
        config.select.attribute_share = Share::NONE;
        config.select.truncation_points = truncation_points;
        adapt(config);
    });
    link.push_bytes = 0;
    link
}

fn at_truncation_points(link: &Loopback) -> usize {
    let mesh = link.core.mesh(0).unwrap();
    (0..prepared().1.chunks.len() as u32).filter(|&chunk| mesh.applied_truncation(chunk).is_some()).count()
}

#[test]
fn chunks_are_fetched_up_to_a_truncation_point_and_continued_for_a_nearer_view() {
    let camera = TestScene::new(1).camera();
    let run = |truncation_points: bool| {
        let mut link = frugal(TestScene::new(1), truncation_points, |_| {});
        link.connect();
        let (mut received, mut stopped) = (Vec::new(), 0);
        for eye in [12.0, 9.0, 7.0, 5.0, 3.5] {
            link.core.set_view(link.now, view(Camera { eye: [0.0, eye * 0.6, eye], ..camera }, 1.0));
            link.run(50);
            link.settle();
            let counters = link.core.stats().counters;
            assert!(counters.max_screen_error_px <= 1.0 || !truncation_points, "{counters:?}");
            received.push(link.sent_bytes.values().sum::<u64>());
            stopped += at_truncation_points(&link);
        }
        assert_eq!(stopped > 0, truncation_points);
        // In the end every chunk is whole, as without truncation points, and no byte was sent twice.
        link.core.set_view(link.now, finest());
        link.run(50);
        link.settle();
        assert_eq!(at_truncation_points(&link), 0);
        assert_eq!(link.core.mesh(0).unwrap().face_count(), prepared().0.faces.len());
        for (chunk, payload) in (0..).zip(&prepared().1.chunks) {
            assert_eq!(link.sent_bytes[&BlobId::chunk(0, chunk)], payload.len() as u64, "chunk {chunk}");
        }
        received
    };
    let (with, without) = (run(true), run(false));
    println!("{with:?} bytes with truncation points, {without:?} without");
    assert!(with.iter().zip(&without).all(|(a, b)| a <= b), "{with:?} against {without:?}");
    assert!(
        with.iter().sum::<u64>() * 100 < without.iter().sum::<u64>() * 95,
        "{with:?} against {without:?}"
    );
}

#[test]
fn truncated_chunks_are_undone_and_reapplied_from_the_cache() {
    let camera = TestScene::new(1).camera();
    let near = view(Camera { eye: [0.0, 4.2, 7.0], ..camera }, 1.0);
    let mut link = frugal(TestScene::new(1), true, |config| config.select.keep_out_of_view = Share::NONE);
    link.core.set_view(link.now, near);
    link.connect();
    link.settle();
    let (stats, stopped, sent) = (link.core.stats(), at_truncation_points(&link), link.sent_bytes.clone());
    assert!(stopped > 0);
    link.core.set_view(link.now, view(Camera { eye: [0.0, 2.0, 900.0], ..camera }, 1.0));
    link.run(200);
    link.settle();
    assert_eq!(link.core.stats().applied_chunks, 0);
    link.core.set_view(link.now, near);
    link.run(200);
    link.settle();
    assert_eq!((link.core.stats().faces, at_truncation_points(&link)), (stats.faces, stopped));
    assert_eq!(link.sent_bytes, sent, "nothing is fetched twice");
}

#[test]
fn small_camera_movements_keep_truncation_points() {
    let camera = TestScene::new(1).camera();
    let at = |eye: f64| view(Camera { eye: [0.0, eye * 0.6, eye], ..camera }, 1.0);
    let mut link = frugal(TestScene::new(1), true, |_| {});
    link.core.set_view(link.now, at(7.0));
    link.connect();
    link.settle();
    let (faces, sent) = (link.core.stats().faces, link.sent_bytes.clone());
    for eye in [7.6, 7.0, 7.8, 7.0] {
        link.core.set_view(link.now, at(eye));
        link.run(100);
        link.settle();
        assert_eq!((link.core.stats().faces, &link.sent_bytes), (faces, &sent));
    }
}

/// A valid beginning does not prove that the rest is valid: if the rest is damaged, both are dropped and fetched again.
#[test]
fn a_chunk_with_a_damaged_rest_is_fetched_again_from_its_start() {
    let camera = TestScene::new(1).camera();
    let mut link = frugal(TestScene::new(1), true, |_| {});
    link.core.set_view(link.now, view(Camera { eye: [0.0, 4.2, 7.0], ..camera }, 1.0));
    link.connect();
    link.settle();
    let mesh = link.core.mesh(0).unwrap();
    let bad = (0..).find(|&chunk| mesh.applied_truncation(chunk).is_some()).unwrap();
    let mut scene = TestScene::new(1);
    scene.damage(BlobId::chunk(0, bad));
    link.cut();
    link.source = std::sync::Arc::new(scene);
    link.connect();
    link.core.set_view(link.now, finest());
    while link.core.stats().decode_failures == 0 {
        link.run(1);
    }
    assert!(!link.core.mesh(0).unwrap().is_applied(bad));
    link.cut();
    link.source = std::sync::Arc::new(TestScene::new(1));
    link.connect();
    link.settle();
    assert_eq!(link.core.mesh(0).unwrap().face_count(), prepared().0.faces.len());
}
