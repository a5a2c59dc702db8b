//! Lookups of parts: on demand, each blob once, and always an answer.

use lodestream_protocol::frame::ServerFrame;
use lodestream_protocol::message::ServerMessage;
use lodestream_scene::blob::BlobId;
use lodestream_scene::parts::{PartInfo, PartTable, ScenePart};
use lodestream_scene::placement::Placement;

use super::{Loopback, TestScene};
use crate::core::{PartAbsence, PartAnswer};

fn part(instance: u32, part: u32) -> ScenePart {
    ScenePart { instance, part }
}

fn called(number: u32) -> PartInfo {
    PartInfo {
        name: format!("part {number}"),
        path: "site/floor".into(),
        extras: Some(format!("{{\"number\":{number}}}")),
        in_file: Placement::at([f64::from(number), 0.5, 0.0]),
    }
}

/// Two instances of one part and a batch of 300 between them.
fn house() -> TestScene {
    TestScene::new(3).of_parts(&[1, 300, 1], &(0..302).map(called).collect::<Vec<_>>())
}

fn settled(scene: TestScene) -> Loopback {
    let mut link = Loopback::new(scene, |_| {});
    link.connect();
    link.settle();
    link
}

fn part_blobs(link: &Loopback) -> Vec<BlobId> {
    link.sent.iter().copied().filter(|id| matches!(id, BlobId::Parts(_))).collect()
}

/// Looks up a part and waits for the answer, at most a minute of virtual time.
fn look_up(link: &mut Loopback, id: ScenePart) -> Result<PartInfo, PartAbsence> {
    let was_settled = link.core.is_settled();
    link.core.look_up_part(link.now, id);
    for _ in 0..60_000 {
        if let Some(answer) = link.core.take_part() {
            assert_eq!(answer.id, id);
            assert!(!was_settled || link.core.is_settled(), "a lookup changes nothing that is drawn");
            return answer.info;
        }
        link.run(1);
    }
    panic!("no answer");
}

#[test]
fn names_come_on_demand_and_each_page_once() {
    let mut link = settled(house());
    assert_eq!(part_blobs(&link), [], "nothing is pushed");
    link.run(100);
    let selections = link.core.stats().selections;
    assert_eq!(look_up(&mut link, part(1, 17)), Ok(called(18)));
    assert_eq!(part_blobs(&link), [BlobId::part_directory(0), BlobId::part_page(0)]);
    // Without a byte from the network: at once.
    for (id, record) in [(part(0, 0), 0), (part(1, 0), 1), (part(1, 254), 255)] {
        link.core.look_up_part(link.now, id);
        let answer = PartAnswer { id, info: Ok(called(record)) };
        assert_eq!(link.core.take_part(), Some(answer));
    }
    for (id, record) in [(part(1, 255), 256), (part(1, 299), 300), (part(2, 0), 301)] {
        assert_eq!(look_up(&mut link, id), Ok(called(record)));
    }
    assert_eq!(part_blobs(&link).len(), 3, "{:?}", part_blobs(&link));
    link.run(100);
    assert_eq!(link.core.stats().selections, selections, "nothing that is drawn changes");
    assert!(link.core.is_settled());
}

#[test]
fn a_lookup_takes_two_round_trips_although_refinements_wait() {
    let mut link = Loopback::new(house(), |_| {});
    link.connect();
    while !link.core.has_changes() {
        link.run(1);
    }
    assert!(!link.core.is_settled());
    let asked = link.now;
    assert_eq!(look_up(&mut link, part(1, 3)), Ok(called(4)));
    // 40 ms each, and what is in flight at 8 Mbit/s.
    assert!(link.now.since(asked).as_millis() <= 200, "{:?}", link.now.since(asked));
}

#[test]
fn parts_that_do_not_exist_are_named_so() {
    let mut link = settled(house());
    for id in [part(0, 1), part(1, 300), part(3, 0), part(u32::MAX, u32::MAX)] {
        assert_eq!(look_up(&mut link, id), Err(PartAbsence::NoSuchPart), "{id:?}");
    }
}

#[test]
fn a_scene_without_a_table_says_that_no_names_are_known() {
    let mut link = Loopback::new(TestScene::new(1), |_| {});
    link.core.look_up_part(link.now, part(0, 0));
    link.connect();
    link.settle();
    let answer = PartAnswer { id: part(0, 0), info: Err(PartAbsence::NoNames) };
    assert_eq!(link.core.take_part(), Some(answer));
    assert_eq!(part_blobs(&link), []);
}

#[test]
fn lookups_before_the_scene_is_known_wait_for_it() {
    let mut link = Loopback::new(house(), |_| {});
    link.core.look_up_part(link.now, part(2, 0));
    link.run(10);
    assert_eq!(link.core.take_part(), None);
    link.connect();
    link.run(500);
    assert_eq!(link.core.take_part().unwrap().info, Ok(called(301)));
}

#[test]
fn damaged_pages_are_requested_again_and_then_given_up() {
    let mut scene = house();
    scene.damage(BlobId::part_page(0));
    let mut link = settled(scene);
    assert_eq!(look_up(&mut link, part(0, 0)), Err(PartAbsence::Unreadable));
    assert_eq!(link.times_sent()[&BlobId::part_page(0)], 4);
    // The other page is not affected, and neither is the picture.
    assert_eq!(look_up(&mut link, part(2, 0)), Ok(called(301)));
    link.settle();
}

#[test]
fn pages_that_the_server_does_not_have_are_unreadable() {
    let mut scene = house();
    scene.missing.insert(BlobId::part_directory(0));
    let mut link = settled(scene);
    assert_eq!(look_up(&mut link, part(0, 0)), Err(PartAbsence::Unreadable));
}

#[test]
fn lookups_outlive_a_connection_but_not_the_scene() {
    let mut link = settled(house());
    link.core.look_up_part(link.now, part(1, 1));
    link.cut();
    link.run(50);
    assert_eq!(link.core.take_part(), None);
    link.connect();
    link.run(500);
    assert_eq!(link.core.take_part().unwrap().info, Ok(called(2)));
    // Answered without a byte although the connection is gone.
    let sent = part_blobs(&link).len();
    link.cut();
    assert_eq!(look_up(&mut link, part(1, 2)), Ok(called(3)));
    link.core.look_up_part(link.now, part(2, 0));
    link.source = TestScene::new(3).with_fingerprint(9).into();
    link.connect();
    link.run(500);
    assert_eq!(link.core.take_part().unwrap().info, Err(PartAbsence::OtherScene));
    assert_eq!(look_up(&mut link, part(1, 2)), Err(PartAbsence::NoNames));
    assert_eq!(part_blobs(&link).len(), sent);
}

#[test]
fn with_the_smallest_cache_lookups_are_still_answered() {
    let mut link = Loopback::new(house(), |config| config.cache_bytes = 1);
    link.connect();
    link.settle();
    for (id, record) in [(part(1, 0), 1), (part(2, 0), 301), (part(0, 0), 0)] {
        assert_eq!(look_up(&mut link, id), Ok(called(record)));
    }
    link.settle();
}

#[test]
fn too_many_lookups_are_answered_at_once() {
    let mut link = settled(house());
    for _ in 0..1025 {
        link.core.look_up_part(link.now, part(0, 0));
    }
    assert_eq!(link.core.take_part().unwrap().info, Err(PartAbsence::TooMany));
    link.run(500);
    let answers: Vec<_> = std::iter::from_fn(|| link.core.take_part()).collect();
    assert!(answers.len() == 1024 && answers.iter().all(|answer| answer.info == Ok(called(0))));
    assert_eq!(part_blobs(&link).len(), 2);
}

#[test]
fn a_second_or_invalid_table_changes_nothing() {
    for records in [0, u32::MAX] {
        let mut link = settled(house());
        let said = ServerMessage::Parts(PartTable { records });
        assert!(lodestream_protocol::frame::encode_server(&said).is_err());
        link.core.handle_frame(link.now, ServerFrame::Message(said));
        // The scene's own table stays.
        assert_eq!(look_up(&mut link, part(0, 0)), Ok(called(0)));
    }
}
