//! Animated models: requested once something is drawn, and followed by picking.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use lodestream_scene::animation::{
    AnimatedModel, AnimatedNode, AnimatedPart, Channel, Clip, Interpolation, Moment, Property, Rest,
};
use lodestream_scene::blob::BlobId;
use lodestream_scene::parts::{PartTransform, ScenePart};

use super::{Loopback, TestScene};
use crate::core::{Change, Ray};

/// An instance rises by 8 in two seconds.
fn rising(instance: u32) -> AnimatedModel {
    let values = vec![0.0, 0.0, 0.0, 0.0, 0.0, 8.0];
    let channel = Channel {
        node: 0,
        property: Property::Translation,
        interpolation: Interpolation::Linear,
        timeline: 0,
        values,
    };
    let (to_node, from_model) = (DAffine3::IDENTITY, DAffine3::IDENTITY);
    AnimatedModel {
        nodes: vec![AnimatedNode { parent: None, to_parent: DAffine3::IDENTITY, rest: Rest::default() }],
        parts: vec![AnimatedPart { node: 0, to_node, from_model }],
        skins: Vec::new(),
        places: vec![vec![instance]],
        timelines: vec![vec![0.0, 2.0]],
        clips: vec![Clip { name: "rise".into(), channels: vec![channel] }],
    }
}

fn at(time_s: f64) -> Option<Moment> {
    Some(Moment { clip: "rise".into(), time_s })
}

fn settled(scene: TestScene) -> Loopback {
    let mut link = Loopback::new(scene, |_| {});
    link.connect();
    link.settle();
    link
}

fn sent(link: &Loopback) -> Vec<BlobId> {
    link.sent.iter().copied().filter(|id| matches!(id, BlobId::Animation(_))).collect()
}

/// Height at which a ray from above meets an instance.
fn height(link: &Loopback, instance: u32) -> f64 {
    let part = ScenePart { instance, part: 0 };
    let centre = link.core.part_bounds(part).unwrap().centre;
    let ray = Ray { origin: DVec3::new(centre.x, centre.y, 1000.0), direction: DVec3::NEG_Z };
    let hit = link.core.pick(ray, |part| part.instance != instance).unwrap();
    assert_eq!(hit.scene_part(), Some(part));
    hit.place.z
}

#[test]
fn models_come_once_after_the_first_frame_and_are_followed() {
    let mut link = settled(TestScene::new(3).animated(&[rising(1), rising(2)]));
    assert_eq!(sent(&link), [BlobId::Animation(0), BlobId::Animation(1)]);
    let first = link.sent.iter().position(|id| matches!(id, BlobId::Animation(_))).unwrap();
    assert!((0..3).all(|asset| link.sent[..first].contains(&BlobId::base(asset))), "{:?}", link.sent);
    let changes = link.core.take_changes(link.now, usize::MAX);
    let models = changes.iter().filter(|change| matches!(change, Change::Animation { .. })).count();
    assert_eq!(models, 2);
    let still = [0, 1].map(|instance| height(&link, instance));
    link.core.animate(at(0.5));
    assert!((height(&link, 1) - still[1] - 2.0).abs() < 1e-6);
    assert!((height(&link, 0) - still[0]).abs() < 1e-9, "it is no instance of a model");
    // What else moves it comes before.
    let up = PartTransform::by(DVec3::Z).unwrap();
    link.core.move_parts(&[(ScenePart { instance: 1, part: 0 }, up)].into());
    assert!((height(&link, 1) - still[1] - 3.0).abs() < 1e-6);
    link.core.move_parts(&[].into());
    link.core.animate(None);
    assert!((height(&link, 1) - still[1]).abs() < 1e-9);
    // A renderer that has lost its device gets them again, without a request.
    link.core.restate(link.now);
    link.settle();
    let again = link.core.take_changes(link.now, usize::MAX);
    assert!(
        again
            .iter()
            .any(|change| matches!(change, Change::Animation { number: 1, model } if **model == rising(2)))
    );
    assert_eq!(sent(&link).len(), 2);
}

#[test]
fn scenes_without_animations_request_none_and_another_scene_forgets_them() {
    let mut link = settled(TestScene::new(3));
    link.core.animate(at(0.5));
    link.settle();
    assert!(sent(&link).is_empty() && link.core.animations().is_none());
}

#[test]
fn models_that_are_damaged_or_move_what_is_not_there_are_left_out() {
    let mut damaged = TestScene::new(2).animated(&[rising(1)]);
    damaged.damage(BlobId::Animation(0));
    for scene in [damaged, TestScene::new(2).animated(&[rising(2)])] {
        let mut link = Loopback::new(scene, |_| {});
        link.connect();
        // All attempts.
        link.run(120_000);
        assert!(link.core.animations().is_some_and(|models| models.is_empty()));
        assert_eq!(link.core.lacking_blobs().collect::<Vec<_>>(), [BlobId::Animation(0)]);
        link.core.animate(at(0.5));
        assert!(link.core.stats().decode_failures > 0);
    }
}

#[test]
fn a_model_is_shared_not_copied() {
    let link = settled(TestScene::new(2).animated(&[rising(1)]));
    let (_, model) = link.core.animations().unwrap().models().next().unwrap();
    assert!(Arc::strong_count(model) <= 2);
}
