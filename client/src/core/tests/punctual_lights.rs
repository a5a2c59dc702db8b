//! Punctual lights: few come with the scene, many in pages that the view wants; base meshes wait for none.

use lodestream_protocol::frame::ServerFrame;
use lodestream_protocol::message::{CloseCode, ServerMessage};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::punctual_lights::{PunctualLight, PunctualLights};
use lodestream_scene::view::View;

use super::{Change, Loopback, TestScene};
use crate::core::punctual_light_pages::PunctualLightPages;

fn punctual_light(x: f64, z: f64) -> PunctualLight {
    PunctualLight { position: [x, 1.0, z], intensity: [40.0, 30.0, 10.0], range: 4.0, spot: None }
}

/// A number of lights close together before the camera, then as many far behind it.
fn before_and_behind(count: u32) -> Vec<PunctualLight> {
    let row =
        |z: f64| (0..count).map(move |n| punctual_light(f64::from(n % 9) * 0.2, z + f64::from(n / 9) * 0.01));
    row(-1.0).chain(row(5000.0)).collect()
}

fn punctual_lights_sent(link: &Loopback) -> Vec<BlobId> {
    link.sent.iter().copied().filter(|id| matches!(id, BlobId::PunctualLights(_))).collect()
}

/// The punctual lights that the renderer received, by page. Fails if a page comes before the number of lights.
fn told(changes: &[Change]) -> Vec<(u32, usize)> {
    let mut count = None;
    let mut pages = Vec::new();
    for change in changes {
        match change {
            Change::Scene(_) => count = None,
            Change::PunctualLights { count: all } => count = Some(*all),
            Change::PunctualLightPage { page, punctual_lights } => {
                assert!(count.is_some(), "a page before the scene was said to have punctual lights");
                pages.push((*page, punctual_lights.len()));
            }
            _ => {}
        }
    }
    pages
}

/// A client of a scene whose picture is settled.
fn settled(scene: TestScene) -> Loopback {
    let mut link = Loopback::new(scene, |_| {});
    link.connect();
    link.settle();
    link
}

#[test]
fn few_punctual_lights_arrive_before_the_first_frame_without_requests() {
    let mut link = Loopback::new(
        TestScene::new(1).lit_by(&[punctual_light(0.0, 0.0), punctual_light(900.0, 900.0)]),
        |_| {},
    );
    link.connect();
    link.settle();
    assert_eq!((link.core.punctual_light_count(), link.core.punctual_lights().count()), (2, 2));
    assert_eq!(punctual_lights_sent(&link), []);
    let changes = link.core.take_changes(link.now, usize::MAX);
    assert_eq!(told(&changes), [(0, 2)]);
    let place = |wanted: fn(&Change) -> bool| changes.iter().position(wanted).unwrap();
    let first = place(|change| matches!(change, Change::FirstFrame));
    assert!(place(|change| matches!(change, Change::PunctualLightPage { .. })) < first);
}

#[test]
fn light_pages_follow_the_base_meshes_and_only_visible_ones_are_fetched() {
    // Three pages before the camera and three behind it: `PunctualLights` contains the directory.
    let punctual_lights = before_and_behind(192);
    let mut link = settled(TestScene::new(2).lit_by(&punctual_lights));
    let mut sent = punctual_lights_sent(&link);
    sent.sort();
    assert_eq!(sent, [0, 1, 2].map(BlobId::punctual_light_page));
    let last_base = link.sent.iter().rposition(|id| id.part() == Some(BlobPart::Base)).unwrap();
    let first_page = link.sent.iter().position(|id| matches!(id, BlobId::PunctualLights(_))).unwrap();
    assert!(last_base < first_page, "{:?}", link.sent);
    assert_eq!((link.core.punctual_light_count(), link.core.punctual_lights().count()), (384, 192));
    // After a half turn the other pages come too, each once.
    let back = View::look_at([0.0, 2.0, 3.0], [0.0, 2.0, 9.0], [0.0, 1.0, 0.0], 0.9, [640, 360]);
    link.core.set_view(link.now, View { target_px: 0.1, ..back });
    link.run(50);
    link.settle();
    assert_eq!(link.core.punctual_lights().count(), 384);
    assert!(link.times_sent().values().all(|times| *times == 1), "{:?}", link.times_sent());
    let mut pages = told(&link.core.take_changes(link.now, usize::MAX));
    pages.sort_unstable();
    assert_eq!(pages, [0, 1, 2, 3, 4, 5].map(|page| (page, 64)));
}

#[test]
fn light_pages_below_the_target_error_are_not_fetched() {
    // At a distance of 5000, a radius of 60 covers 5 pixels of 640 × 360.
    let far: Vec<PunctualLight> =
        (0..20).map(|n| PunctualLight { range: 30.0, ..punctual_light(f64::from(n), -5000.0) }).collect();
    for (target_px, pages) in [(20.0, 0), (1.0, 1)] {
        let source = TestScene::new(1).lit_by(&far);
        let view = source.camera().view([640, 360], target_px);
        let mut link = Loopback::new(source, |_| {});
        link.core.set_view(link.now, View { eye: [0.0, 0.0, 3.0], rotation: [0.0, 0.0, 0.0, 1.0], ..view });
        link.connect();
        link.settle();
        assert_eq!(punctual_lights_sent(&link).len(), pages, "{target_px} px");
    }
}

#[test]
fn the_directory_of_many_punctual_lights_is_requested() {
    let punctual_lights = before_and_behind(1024);
    let link = settled(TestScene::new(1).lit_by(&punctual_lights));
    let sent = punctual_lights_sent(&link);
    assert_eq!((sent[0], sent.len()), (BlobId::punctual_light_directory(0), 1 + 16));
    assert_eq!(link.core.punctual_lights().count(), 1024);
}

#[test]
fn a_missing_light_page_leaves_the_picture_incomplete() {
    let mut source = TestScene::new(1).lit_by(&before_and_behind(128));
    source.missing.insert(BlobId::punctual_light_page(1));
    let mut link = Loopback::new(source, |_| {});
    link.connect();
    for _ in 0..60_000 {
        link.run(1);
        if link.core.lacking_blobs().next().is_some() {
            break;
        }
    }
    assert!(link.core.lacking_blobs().eq([BlobId::punctual_light_page(1)]) && !link.core.is_settled());
    assert_eq!(link.core.punctual_lights().count(), 64);
}

#[test]
fn a_damaged_light_page_is_requested_again_and_then_given_up() {
    let mut source = TestScene::new(1).lit_by(&before_and_behind(64));
    source.damage(BlobId::punctual_light_page(0));
    let mut link = Loopback::new(source, |_| {});
    link.connect();
    for _ in 0..60_000 {
        link.run(1);
        if link.core.lacking_blobs().next().is_some() {
            break;
        }
    }
    assert_eq!(link.times_sent()[&BlobId::punctual_light_page(0)], 4);
    assert_eq!((link.core.punctual_lights().count(), link.core.stats().decode_failures), (0, 4));
}

#[test]
fn punctual_lights_are_kept_across_connections() {
    let mut link = settled(TestScene::new(1).lit_by(&before_and_behind(128)));
    let sent = punctual_lights_sent(&link).len();
    link.cut();
    link.run(50);
    link.connect();
    link.settle();
    assert_eq!((punctual_lights_sent(&link).len(), link.core.punctual_lights().count()), (sent, 128));
}

#[test]
fn invalid_punctual_lights_end_the_session() {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.connect();
    link.settle();
    let none = ServerMessage::PunctualLights(PunctualLights { count: u32::MAX, first: Vec::new() });
    link.core.handle_frame(link.now, ServerFrame::Message(none));
    link.run(1);
    let closed = link.core.closed().expect("the session goes on");
    assert_eq!(closed.code, CloseCode::Protocol);
    assert!(closed.reason.contains("1 to 262144"), "{closed}");
    assert_eq!((link.core.punctual_light_count(), link.core.punctual_lights().count()), (0, 0));
}

#[test]
fn the_most_punctual_lights_take_at_most_64_bytes_each() {
    let said = PunctualLights { count: 1 << 18, first: Vec::new() };
    let (pages, came) = PunctualLightPages::new(&said).unwrap();
    assert!(came.is_none() && pages.received().next().is_none());
    assert!(size_of::<PunctualLight>() <= 64);
}
