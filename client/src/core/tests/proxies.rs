//! Proxies: drawn instead of instances that are small on the screen, and replaced piece by piece.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::{Camera, Instance};
use lodestream_scene::parts::{PartTransform, ScenePart};
use lodestream_scene::proxy::{Cut, Proxy};
use lodestream_scene::view::View;

use super::{Change, Loopback, TestScene, view};

/// A root for all instances of a row with one child for each half; the halves' error is a fifth of the root's.
pub(super) fn street(count: u32) -> [Proxy; 3] {
    let of = |parent, first_instance, instance_count, error| Proxy {
        parent,
        first_instance,
        instance_count,
        error,
        ..Proxy::default()
    };
    let half = count / 2;
    [Proxy { child_count: 2, ..of(0, 0, count, 0.5) }, of(1, 0, half, 0.1), of(1, half, count - half, 0.1)]
}

/// Numbers of the proxies' assets in [`street`].
const ROOT: u32 = 4;

/// What a renderer draws.
#[derive(Default)]
struct Picture {
    instances: Vec<Instance>,
    proxies: Vec<Proxy>,
    meshes: BTreeMap<u32, bool>,
    cut: Cut,
    whole: bool,
}

impl Picture {
    fn take(&mut self, link: &mut Loopback, max_bytes: usize) {
        for change in link.core.take_changes(link.now, max_bytes) {
            match change {
                Change::Instances(list) => self.instances.extend(list),
                Change::Proxies(list) => self.proxies.extend(list),
                Change::Asset(new) => {
                    self.meshes.insert(new.asset, false);
                }
                Change::Mesh(change) => {
                    self.meshes.insert(change.asset, true);
                }
                Change::Cut(cut) => self.cut = cut,
                Change::FirstFrame => self.whole = true,
                _ => {}
            }
        }
        self.check();
    }

    /// Each instance is drawn once, by itself or by a proxy, and what is drawn has a mesh.
    fn check(&self) {
        if !self.whole {
            return;
        }
        let mut times = vec![0; self.instances.len()];
        for &number in &self.cut.proxies {
            let proxy = &self.proxies[number as usize];
            assert!(self.meshes[&proxy.asset], "proxy {number} has a mesh");
            let parts = (0..proxy.instance_count).filter(|part| !self.cut.hides(number, *part));
            parts.for_each(|part| times[(proxy.first_instance + part) as usize] += 1);
        }
        for (number, instance) in (0_u32..).zip(&self.instances).filter(|(number, _)| self.cut.draws(*number))
        {
            assert!(self.meshes[&instance.asset], "instance {number} has a mesh");
            times[number as usize] += 1;
        }
        assert!(times.iter().all(|times| *times == 1), "{times:?} {:?}", self.cut);
    }

    fn settle(&mut self, link: &mut Loopback) {
        for _ in 0..60_000 {
            link.run(1);
            self.take(link, 2000);
            if link.core.is_settled() && !link.core.has_changes() {
                return;
            }
        }
        panic!("not settled: {:?}", link.core.stats());
    }
}

/// A view along the row from so far that all instances are in view.
fn from(distance: f64) -> View {
    let camera =
        Camera { eye: [4.5, 1.0, distance], target: [4.5, 0.0, 0.0], up: [0.0, 1.0, 0.0], fov_y: 0.9 };
    view(camera, 1.0)
}

fn link_from(distance: f64) -> Loopback {
    let mut link = Loopback::new(TestScene::new(4).with_proxies(&street(4)), |_| {});
    link.core.set_view(link.now, from(distance));
    link.connect();
    link
}

fn bases_sent(link: &Loopback) -> BTreeSet<u32> {
    let base = |id: &BlobId| (id.part() == Some(BlobPart::Base)).then(|| id.asset()).flatten();
    link.sent.iter().filter_map(base).collect()
}

#[test]
fn from_afar_only_the_root_is_sent_and_drawn() {
    let mut link = link_from(2000.0);
    let mut picture = Picture::default();
    picture.settle(&mut link);
    assert_eq!(picture.cut, Cut { proxies: vec![0], instances: 4, covered: vec![[0, 4]], ..Cut::default() });
    assert_eq!(bases_sent(&link), BTreeSet::from([ROOT]));
    let stats = link.core.stats();
    assert!(stats.counters.max_screen_error_px <= 1.0, "{stats:?}");
    assert_eq!((stats.counters.visible_instances, stats.counters.drawable_instances), (1, 1));
}

#[test]
fn an_approaching_camera_sees_each_instance_once_at_each_step() {
    let mut link = link_from(2000.0);
    let mut picture = Picture::default();
    picture.settle(&mut link);
    let mut cuts = BTreeSet::new();
    for distance in [2000.0, 700.0, 150.0, 90.0, 40.0, 10.0, 40.0, 150.0, 2000.0] {
        link.core.set_view(link.now, from(distance));
        picture.settle(&mut link);
        cuts.insert(picture.cut.proxies.clone());
        assert!(
            link.core.stats().counters.max_screen_error_px <= 1.01,
            "{distance}: {:?}",
            link.core.stats()
        );
    }
    assert_eq!(cuts, BTreeSet::from([vec![], vec![0], vec![1, 2]]));
    assert!(link.times_sent().values().all(|times| *times == 1), "{:?}", link.times_sent());
}

/// Each base mesh replaces a part of the proxy as soon as it is there; to a renderer that cannot leave parts out, all at
/// once.
#[test]
fn a_proxy_is_replaced_piece_by_piece() {
    for partial in [true, false] {
        let mut link = Loopback::new(TestScene::new(4).with_proxies(&street(4)), |config| {
            config.select.partial_proxies = partial;
        });
        link.rate_bits_per_s = 200_000;
        link.core.set_view(link.now, from(2000.0));
        link.connect();
        let mut picture = Picture::default();
        picture.settle(&mut link);
        link.core.set_view(link.now, from(10.0));
        let mut cuts = Vec::new();
        while !link.core.is_settled() || link.core.has_changes() {
            link.run(1);
            picture.take(&mut link, 2000);
            if cuts.last() != Some(&picture.cut) {
                cuts.push(picture.cut.clone());
            }
        }
        assert_eq!(cuts.last().unwrap().proxies, []);
        let drawn = |cut: &Cut| (0..4).filter(|instance| cut.draws(*instance)).count();
        let counts: Vec<usize> = cuts.iter().map(drawn).collect();
        assert!(counts.is_sorted(), "{counts:?}");
        let in_part = cuts.iter().filter(|cut| !cut.partial.is_empty()).count();
        assert_eq!(in_part >= 2, partial, "{cuts:?}");
    }
}

/// Where a root is made for the start camera, base meshes would often look worse.
#[test]
fn a_root_for_the_start_camera_stands_until_what_replaces_it_is_as_fine() {
    let mut base = usize::MAX;
    for root_slope in [0.0, 0.005] {
        let mut scene = TestScene::new(4).with_proxies(&street(4));
        scene.header.root_slope = root_slope;
        scene.header.camera =
            Camera { fov_y: 0.9, up: [0.0, 1.0, 0.0], eye: from(10.0).eye, target: [4.5, 0.0, 0.0] };
        let mut link = Loopback::new(scene, |_| {});
        link.rate_bits_per_s = 200_000;
        link.core.set_view(link.now, from(2000.0));
        link.connect();
        let mut picture = Picture::default();
        picture.settle(&mut link);
        link.core.set_view(link.now, from(10.0));
        // Faces of each instance when it is first drawn.
        let mut faces: BTreeMap<u32, usize> = BTreeMap::new();
        while !link.core.is_settled() || link.core.has_changes() {
            link.run(1);
            picture.take(&mut link, 2000);
            let cut = link.core.scene.cut().clone();
            for instance in (0..4).filter(|instance| cut.draws(*instance)) {
                let now = link.core.mesh(instance).unwrap().face_count();
                faces.entry(instance).or_insert(now);
            }
        }
        assert_eq!(picture.cut.proxies, []);
        assert!(!faces.is_empty());
        if root_slope > 0.0 {
            assert!(faces.values().all(|&faces| faces > base), "{faces:?}, as a base mesh {base}");
        } else {
            base = faces.values().copied().min().unwrap();
        }
    }
}

#[test]
fn no_proxy_stands_for_a_pinned_instance() {
    let mut link = link_from(2000.0);
    let mut picture = Picture::default();
    picture.settle(&mut link);
    link.core.pin_instances(&[2]);
    picture.settle(&mut link);
    assert_eq!(picture.cut, Cut { proxies: vec![1], instances: 4, covered: vec![[0, 2]], ..Cut::default() });
    link.core.pin_instances(&[]);
    picture.settle(&mut link);
    assert_eq!(picture.cut.proxies, [0]);
}

/// Even if the instance is out of view, since its parts may be in it.
#[test]
fn no_proxy_stands_for_an_instance_with_moved_parts_and_it_is_refined_where_they_are() {
    let mut link = link_from(2000.0);
    let mut picture = Picture::default();
    picture.settle(&mut link);
    let faces = |link: &Loopback| link.core.mesh(2).map(|mesh| mesh.face_count());
    assert_eq!(faces(&link), None);
    let mut move_by = |link: &mut Loopback, by: Option<DVec3>| {
        let moved = by.map(|by| (ScenePart { instance: 2, part: 0 }, PartTransform::by(by).unwrap()));
        link.core.move_parts(&moved.into_iter().collect());
        picture.settle(link);
        picture.cut.clone()
    };
    let cut = Cut { proxies: vec![1], instances: 4, covered: vec![[0, 2]], ..Cut::default() };
    assert_eq!(move_by(&mut link, Some(DVec3::X)), cut);
    let afar = faces(&link);
    // Near the eye.
    let eye = DVec3::from(from(2000.0).eye);
    let target = DVec3::from(from(40.0).eye);
    assert_eq!(move_by(&mut link, Some(eye - target)), cut);
    assert!(faces(&link) > afar, "{afar:?}, {:?}", faces(&link));
    assert_eq!(move_by(&mut link, None).proxies, [0]);
}

#[test]
fn a_near_view_gets_its_instances_without_their_proxies() {
    let mut link = link_from(10.0);
    let mut picture = Picture::default();
    picture.settle(&mut link);
    assert_eq!(picture.cut, Cut { proxies: vec![], instances: 4, covered: vec![], ..Cut::default() });
    assert_eq!(bases_sent(&link), (0..ROOT).collect());
}

/// It is absent as in a scene without proxies, and the client says what is lacking.
#[test]
fn an_instance_that_cannot_be_had_does_not_keep_others_coarse() {
    let mut scene = TestScene::new(4).with_proxies(&street(4));
    scene.missing.insert(BlobId::base(1));
    let mut link = Loopback::new(scene, |_| {});
    link.core.set_view(link.now, from(2000.0));
    link.connect();
    Picture::default().settle(&mut link);
    link.core.set_view(link.now, from(10.0));
    link.run(5000);
    let stats = link.core.stats();
    assert_eq!((stats.counters.visible_instances, stats.counters.drawable_instances), (4, 3), "{stats:?}");
    assert_eq!(stats.lacking, [BlobId::base(1)]);
}

#[test]
fn proxies_that_do_not_fit_end_the_session() {
    for wrong in [Proxy { instance_count: 9, ..street(4)[0] }, Proxy { parent: 7, ..street(4)[1] }] {
        let mut link = Loopback::new(TestScene::new(4).with_proxies(&[wrong]), |_| {});
        link.connect();
        link.run(500);
        assert!(link.core.closed().is_some(), "{wrong:?}");
    }
}

#[test]
fn picking_finds_instances_through_their_proxy() {
    let mut link = link_from(2000.0);
    let mut picture = Picture::default();
    picture.settle(&mut link);
    let ray = crate::core::Ray { origin: glam::DVec3::new(0.1, 50.0, 0.1), direction: glam::DVec3::NEG_Y };
    let far = link.core.pick(ray, |_| false).unwrap();
    // Which part that is, the proxy does not know.
    assert_eq!((far.instance, far.part), (0, None));
    let part = ScenePart { instance: 0, part: 0 };
    assert_eq!(link.core.pick(ray, |other| other == part), None);
    assert!(link.core.part_bounds(part).is_some());
    link.core.pin_instances(&[0]);
    picture.settle(&mut link);
    assert_eq!(link.core.pick(ray, |_| false).unwrap().scene_part(), Some(part));
    // Without the pin a proxy stands for it again, but its mesh is known.
    link.core.pin_instances(&[]);
    picture.settle(&mut link);
    let hit = link.core.pick(ray, |_| false).unwrap();
    assert_eq!(hit.scene_part(), Some(part));
}
