//! A core reads a published scene over range requests, from good hosts and bad ones.

use lodestream_protocol::message::CloseCode;
use lodestream_scene::description::Camera;
use lodestream_scene::parts::{PartInfo, ScenePart};
use lodestream_scene::punctual_lights::PunctualLight;

use super::testing::{Fault, RangeLoopback};
use super::{Object, RangeRequest};
use crate::core::PartAbsence;
use crate::core::testing::{Loopback, TestScene};

fn link() -> RangeLoopback {
    RangeLoopback::new(&TestScene::new(3), |_| {})
}

const fn is_pack(request: &RangeRequest) -> bool {
    matches!(request.object, Object::Pack(..))
}

/// The meshes that a server's session ends with.
fn meshes_from_a_server(scene: TestScene) -> Vec<(usize, usize)> {
    let mut link = Loopback::new(scene, |_| {});
    link.connect();
    link.settle();
    meshes(&link.core, 3)
}

fn meshes(core: &crate::core::ClientCore, assets: u32) -> Vec<(usize, usize)> {
    (0..assets)
        .map(|asset| core.mesh(asset).map_or((0, 0), |mesh| (mesh.face_count(), mesh.applied_count())))
        .collect()
}

#[test]
fn a_published_scene_settles_to_the_meshes_of_a_server() {
    let mut link = link();
    link.settle();
    assert_eq!(meshes(&link.core, 3), meshes_from_a_server(TestScene::new(3)), "{}", link.closed());
    assert_eq!(link.core.stats().requests, link.requests.len() as u64);
    // One round trip, then the base meshes at 2 Mbit/s.
    let first = link.core.milestones().first_frame.unwrap();
    assert!(first.after.as_millis() < 120, "{first:?}");
    assert_eq!(link.requests[0].range.start, 0);
}

#[test]
fn few_requests_bring_little_more_than_a_server_sends() {
    let mut server = Loopback::new(TestScene::new(3), |_| {});
    server.connect();
    server.settle();
    let sent: u64 = server.sent_bytes.values().sum();
    let mut link = link();
    link.settle();
    assert!(link.requests.len() <= 24, "{} requests: {:#?}", link.requests.len(), link.requests);
    assert!(link.received as f64 <= 1.25 * sent as f64, "{} bytes, not {sent}", link.received);
}

#[test]
fn terrain_and_lights_come_by_ranges_too() {
    let light = |n: u32| PunctualLight {
        position: [f64::from(n % 20), 1.0, f64::from(n / 20)],
        intensity: [5.0; 3],
        range: 3.0,
        spot: None,
    };
    let lights: Vec<_> = (0..400).map(light).collect();
    let scene = TestScene::new(3).lit_by(&lights);
    let mut link = RangeLoopback::new(&scene, |_| {});
    link.settle();
    assert!(link.core.is_settled(), "{}", link.closed());
    assert_eq!(link.core.punctual_light_count(), 400);
    assert!(link.core.punctual_lights().count() > 64);
}

#[test]
fn requests_for_what_the_view_left_are_aborted_and_made_again_on_return() {
    // Short requests, so that chunks and textures are in different ones: only chunks are cancelled.
    let mut link = RangeLoopback::new(&TestScene::new(3), |config| config.ranges.request_bytes = [512, 512]);
    let pack = |link: &RangeLoopback| link.requests.iter().filter(|request| is_pack(request)).count();
    while pack(&link) < 12 {
        link.run(1);
    }
    let view = link.core.view().unwrap();
    let away = Camera { target: [0.0, 1e6, 0.0], up: [1.0, 0.0, 0.0], ..TestScene::new(1).camera() };
    link.core.set_view(link.now, away.view([640, 360], 1.0));
    link.settle();
    assert!(!link.cancelled.is_empty(), "nothing was aborted");
    let before = pack(&link);
    link.run(500);
    assert_eq!(pack(&link), before, "nothing is in view");
    link.core.set_view(link.now, view);
    link.settle();
    assert_eq!(meshes(&link.core, 3), meshes_from_a_server(TestScene::new(3)));
}

#[test]
fn at_most_the_set_number_of_requests_are_in_flight() {
    let mut link = RangeLoopback::new(&TestScene::new(3), |config| {
        config.ranges.max_requests = 2;
        config.ranges.request_bytes = [512, 512];
    });
    link.faults = Box::new(|request| is_pack(request).then_some(Fault::Silent));
    link.run(3000);
    assert_eq!(link.requests.iter().filter(|request| is_pack(request)).count(), 2);
}

#[test]
fn hosts_without_ranges_and_missing_scenes_end_with_what_to_do() {
    for (status, code, says) in [
        (200, CloseCode::Protocol, "does not answer range requests"),
        (404, CloseCode::NoSuchScene, "not there (status 404)"),
        (403, CloseCode::Unauthorised, "refuses access"),
        (416, CloseCode::Protocol, "truncated"),
        (500, CloseCode::Lost, "status 500"),
    ] {
        let mut link = link();
        link.faults = Box::new(move |_| Some(Fault::Status(status)));
        link.settle();
        let closed = link.core.closed().unwrap();
        assert!(closed.code == code && closed.reason.contains(says), "{status}: {closed}");
        assert_eq!(link.requests.len(), 1, "{status}");
    }
}

#[test]
fn other_files_and_truncated_scenes_end_with_what_to_do() {
    let mut other = link();
    other.objects.insert(None, b"<html>not found</html>".repeat(9));
    other.settle();
    assert!(other.closed().contains("not a published scene"), "{}", other.closed());
    let mut older = link();
    older.objects.get_mut(&None).unwrap()[8] = 2;
    older.settle();
    assert!(older.closed().contains("version 2"), "{}", older.closed());
    let whole = link().objects[&None].clone();
    for bytes in [1, 39, 40, 100, 400, whole.len() / 2, whole.len() - 1] {
        let mut link = link();
        link.objects.insert(None, whole[..bytes].to_vec());
        link.settle();
        assert!(!link.core.is_settled() && link.core.closed().is_some(), "{bytes} bytes");
    }
}

/// Each byte of the published scene is under a hash or checked; so are chunks and textures.
#[test]
fn a_changed_byte_is_never_decoded() {
    let whole = link().objects[&None].clone();
    for at in (0..whole.len()).step_by(whole.len() / 97) {
        let mut link = link();
        link.objects.get_mut(&None).unwrap()[at] ^= 0x10;
        for _ in 0..12_000 {
            link.run(1);
            if link.core.is_settled() || link.core.closed().is_some() || link.core.trouble().is_some() {
                break;
            }
        }
        let stats = link.core.stats();
        assert_eq!(stats.decode_failures, 0, "at {at}");
        // A byte that no view of this scene needs may go unread.
        assert!(
            stats.settled || !link.closed().is_empty() || link.core.trouble().is_some(),
            "at {at}: {stats:?}"
        );
    }
}

#[test]
fn a_damaged_chunk_is_fetched_again_past_caches_and_then_reported() {
    let mut link = link();
    let name = link.objects.keys().flatten().next().unwrap().clone();
    let pack = link.objects.get_mut(&Some(name.clone())).unwrap();
    for byte in pack.iter_mut().skip(64).step_by(7) {
        *byte ^= 1;
    }
    link.run(20_000);
    let stats = link.core.stats();
    assert!(link.requests.iter().any(|request| request.reload && is_pack(request)));
    assert!(stats.lacking_blobs > 0 && !stats.settled && stats.decode_failures == 0, "{stats:?}");
    assert!(link.requests.len() < 200, "a storm of {} requests", link.requests.len());
    let trouble = link.core.trouble().unwrap_or_default();
    assert!(trouble.contains(&name) && trouble.contains("publish the scene again"), "{trouble}");
}

#[test]
fn a_missing_or_shorter_pack_is_named_and_the_rest_is_shown() {
    for shorter in [false, true] {
        let mut link = link();
        let name = link.objects.keys().flatten().next().unwrap().clone();
        if shorter {
            link.objects.get_mut(&Some(name.clone())).unwrap().truncate(100);
        } else {
            link.objects.remove(&Some(name.clone()));
        }
        let mut troubles = Vec::new();
        for _ in 0..4000 {
            link.run(5);
            troubles.extend(link.core.trouble().map(str::to_owned));
        }
        let stats = link.core.stats();
        assert!(stats.lacking_blobs > 0 && link.core.closed().is_none(), "{stats:?}");
        assert!(troubles.iter().any(|why| why.contains(&name)), "{troubles:?}");
        let (shown, whole) = (meshes(&link.core, 3), meshes_from_a_server(TestScene::new(3)));
        let others =
            |missing| (0..3).filter(|asset| *asset != missing).all(|asset| shown[asset] == whole[asset]);
        assert!((0..3).any(others), "{shown:?} of {whole:?}");
        assert!(link.requests.len() < 200, "a storm of {} requests", link.requests.len());
    }
}

#[test]
fn a_pack_that_was_missing_for_a_while_is_read_later() {
    let mut link = link();
    let packs: Vec<_> = link.objects.extract_if(.., |name, _| name.is_some()).collect();
    link.run(3000);
    assert!(!link.core.is_settled());
    link.objects.extend(packs);
    link.settle();
    assert_eq!(meshes(&link.core, 3), meshes_from_a_server(TestScene::new(3)));
}

#[test]
fn lost_cut_and_silent_responses_are_asked_for_again_with_pauses() {
    for fault in [Fault::Refuse, Fault::Cut(1000), Fault::OtherRange, Fault::Status(503), Fault::Silent] {
        let mut link = link();
        let mut left = 12;
        let what = fault.clone();
        link.faults = Box::new(move |request| {
            let bad = request.id > 0 && left > 0;
            left -= u32::from(bad);
            bad.then(|| what.clone())
        });
        for _ in 0..200_000 {
            link.run(1);
            if link.core.is_settled() || link.core.closed().is_some() {
                break;
            }
        }
        assert!(link.core.is_settled(), "{fault:?}: {} {:?}", link.closed(), link.core.stats());
        assert!(link.now.as_ns() > 900_000_000, "{fault:?}: without a pause");
    }
}

#[test]
fn a_scene_that_is_published_anew_is_read_anew() {
    let mut link = link();
    while link.requests.len() < 3 {
        link.run(1);
    }
    let new = super::testing::publish(&TestScene::new(2).with_fingerprint(9));
    link.objects.retain(|name, _| name.is_none());
    link.objects.extend(new);
    // The packs of the old scene are gone and its object is another: what it still needs is reported, and a new session
    // reads the new scene.
    link.run(5000);
    link.core.handle_lost(link.now, "told to");
    link.core.connect_ranges(link.now);
    assert!(link.core.poll_request(link.now).is_some_and(|request| request.reload));
    link.core.connect_ranges(link.now);
    link.run(500);
    link.settle();
    assert_eq!(link.core.scene().unwrap().fingerprint, [9; 16], "{}", link.closed());
}

#[test]
fn a_new_session_with_the_same_scene_fetches_only_what_is_missing() {
    let mut link = link();
    link.settle();
    let (chunks, pack_bytes) = (meshes(&link.core, 3), |link: &RangeLoopback| {
        link.requests.iter().filter(|r| is_pack(r)).map(|r| r.range.end - r.range.start).sum::<u64>()
    });
    let before = pack_bytes(&link);
    link.core.handle_lost(link.now, "cut");
    link.core.connect_ranges(link.now);
    link.settle();
    assert_eq!((meshes(&link.core, 3), pack_bytes(&link)), (chunks, before));
}

#[test]
fn names_of_parts_come_by_ranges_on_demand() {
    let called = |n: u32| PartInfo { name: format!("part {n}"), ..PartInfo::default() };
    let scene = TestScene::new(3).of_parts(&[1, 300, 1], &(0..302).map(called).collect::<Vec<_>>());
    let mut link = RangeLoopback::new(&scene, |_| {});
    link.settle();
    let requests = link.core.stats().requests;
    for (instance, part, record) in [(1, 299, 300), (2, 0, 301), (1, 298, 299)] {
        link.core.look_up_part(link.now, ScenePart { instance, part });
        if record == 300 {
            link.run(2000);
        }
        let answer = link.core.take_part().unwrap();
        assert_eq!(answer.info, Ok(called(record)));
    }
    // The directory and the table of pages, then the page, unless they came with the beginning of the scene.
    let more = link.core.stats().requests - requests;
    assert!(more <= 3, "{more} requests");
    link.core.look_up_part(link.now, ScenePart { instance: 0, part: 0 });
    link.run(2000);
    assert_eq!(link.core.take_part().unwrap().info, Ok(called(0)));
    assert!(link.core.stats().requests - requests <= more + 1);
    // A scene that was published without a table.
    let mut link = RangeLoopback::new(&TestScene::new(1), |_| {});
    link.core.look_up_part(link.now, ScenePart { instance: 0, part: 0 });
    link.settle();
    assert_eq!(link.core.take_part().unwrap().info, Err(PartAbsence::NoNames));
}
