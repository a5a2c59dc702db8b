//! A scene that is stated again to a renderer that has lost everything.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use lodestream_scene::animation::AnimatedModel;
use lodestream_scene::blob::BlobId;
use lodestream_scene::proxy::Cut;
use lodestream_scene::punctual_lights::PunctualLight;

use super::{Change, Config, Loopback, TestScene, finest};
use crate::core::{TexturePixels, Vertex};

/// What a renderer has after some changes; they compare equal if it draws the same.
#[derive(Debug, Default, PartialEq)]
struct Drawn {
    scenes: u32,
    instances: Vec<String>,
    cut: Cut,
    assets: BTreeMap<u32, String>,
    vertices: BTreeMap<(u32, u32), Vertex>,
    faces: BTreeMap<(u32, u16, u32), [u32; 3]>,
    textures: BTreeMap<(u32, u16, u8), Vec<u8>>,
    heights: BTreeMap<(i64, i64), String>,
    lights: BTreeMap<u32, usize>,
    animations: BTreeMap<u32, Arc<AnimatedModel>>,
    light_count: Option<u32>,
    first_frames: u32,
}

impl Drawn {
    fn add(&mut self, change: Change) {
        match change {
            Change::Scene(_) => *self = Self { scenes: self.scenes + 1, ..Self::default() },
            Change::PunctualLights { count } => self.light_count = Some(count),
            Change::PunctualLightPage { page, punctual_lights } => {
                self.lights.insert(page, punctual_lights.len());
            }
            Change::Proxies(some) => self.instances.extend(some.iter().map(|one| format!("{one:?}"))),
            Change::Cut(cut) => self.cut = cut,
            Change::Instances(some) => self.instances.extend(some.iter().map(|one| format!("{one:?}"))),
            Change::Asset(asset) => {
                let old = self.assets.insert(asset.asset, format!("{asset:?}"));
                assert_eq!(old, None, "an asset comes once");
            }
            Change::Mesh(mesh) => {
                assert!(self.assets.contains_key(&mesh.asset), "a mesh before its asset");
                for (first, run) in mesh.vertices {
                    self.vertices.extend((first..).map(|slot| (mesh.asset, slot)).zip(run));
                }
                for run in mesh.indices {
                    let slots = (run.first..).map(|slot| (mesh.asset, run.material, slot));
                    self.faces.extend(slots.zip(run.faces));
                }
            }
            Change::FirstFrame => {
                assert!(!self.faces.is_empty(), "the first frame has its meshes");
                self.first_frames += 1;
            }
            Change::Texture(texture) => {
                let TexturePixels::Rgba8(texels) = &*texture.pixels else { panic!("a colour texture") };
                let level = (texture.asset, texture.texture, texture.level);
                self.textures.insert(level, texels.clone());
            }
            Change::Animation { number, model } => drop(self.animations.insert(number, model)),
            Change::TileRemoved { .. } => panic!("no level of these textures is cut"),
            Change::HeightOverrides { x, y, overrides } => {
                self.heights.insert((x, y), format!("{overrides:?}"));
            }
        }
    }

    /// Forgets unused entries of index lists, and vertices without a face.
    fn forget_unused(&mut self) {
        self.faces.retain(|_, face| *face != [0; 3]);
        let used = self.faces.iter().flat_map(|(&(asset, ..), face)| face.map(|slot| (asset, slot)));
        let used: BTreeSet<_> = used.collect();
        self.vertices.retain(|slot, _| used.contains(slot));
    }

    /// Takes changes in small steps until the core is settled.
    fn take_all(&mut self, link: &mut Loopback) {
        loop {
            link.settle();
            if !link.core.has_changes() {
                break;
            }
            for change in link.core.take_changes(link.now, 5000) {
                self.add(change);
            }
        }
    }
}

/// The link, what was drawn, and the blobs that were sent again because of the second statement.
fn same_after_restating(scene: TestScene, adapt: impl FnOnce(&mut Config)) -> (Loopback, Drawn, Vec<BlobId>) {
    let mut link = Loopback::new(scene, adapt);
    link.core.set_view(link.now, finest());
    link.connect();
    let mut before = Drawn::default();
    before.take_all(&mut link);
    let sent = link.sent.len();
    link.core.restate(link.now);
    assert!(!link.core.is_settled(), "the textures are to be drawn again");
    let mut after = Drawn::default();
    after.take_all(&mut link);
    link.core.check_states();
    before.forget_unused();
    after.forget_unused();
    assert!(after.vertices.keys().eq(before.vertices.keys()), "other vertices");
    for (slot, vertex) in &before.vertices {
        assert_eq!(after.vertices[slot], *vertex, "{slot:?}");
    }
    assert!(after.faces == before.faces, "other faces");
    assert!(after.textures == before.textures, "other texture levels");
    assert!(after == before, "other lights, heights, assets or instances");
    let again = link.sent[sent..].to_vec();
    (link, after, again)
}

#[test]
fn a_restated_scene_draws_as_the_first_one_and_nothing_is_sent_again() {
    let (_, drawn, again) = same_after_restating(TestScene::new(2).sharing_textures(), |_| {});
    assert_eq!((drawn.scenes, drawn.first_frames, drawn.assets.len()), (1, 1, 2));
    assert!(drawn.vertices.values().any(|vertex| vertex.level > 1), "refined meshes");
    assert_eq!((drawn.textures.len(), again), (6, vec![]));
}

#[test]
fn only_evicted_texture_levels_are_requested_again() {
    // Smaller than the texture levels together.
    let (link, drawn, mut again) = same_after_restating(TestScene::new(1), |config| config.cache_bytes = 200);
    assert_eq!(drawn.textures.len(), 3);
    again.sort_unstable();
    let levels = [0, 1, 2].map(|level| BlobId::texture(0, 0, level));
    assert!(!again.is_empty() && again.iter().all(|id| levels.contains(id)), "{again:?}");
    assert!(again.windows(2).all(|pair| pair[0] != pair[1]), "once each: {again:?}");
    assert!(link.core.stats().cached_bytes <= 300, "the cache was to be too small");
}

#[test]
fn punctual_lights_are_stated_again() {
    let light = |x| PunctualLight { position: [x, 1.0, 0.0], intensity: [40.0; 3], range: 4.0, spot: None };
    let lights: Vec<_> = (0..400).map(|number| light(f64::from(number) * 0.01)).collect();
    let (_, drawn, _) = same_after_restating(TestScene::new(1).lit_by(&lights), |_| {});
    assert_eq!(drawn.light_count, Some(400));
    assert_eq!(drawn.lights.values().sum::<usize>(), 400);
}

#[test]
fn what_the_renderer_had_not_taken_is_stated_once() {
    let mut link = Loopback::new(TestScene::new(2), |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    let mut drawn = Drawn::default();
    // The device is lost every few steps, before the first frame too, and once before anything has arrived.
    for round in 0..400 {
        link.run(1);
        if round % 29 == 0 {
            link.core.restate(link.now);
        }
        for change in link.core.take_changes(link.now, 3000) {
            drawn.add(change);
        }
    }
    drawn.take_all(&mut link);
    link.core.check_states();
    assert_eq!((drawn.first_frames, drawn.assets.len(), drawn.textures.len()), (1, 2, 6));
    for asset in 0..2 {
        let mesh = link.core.mesh(asset).unwrap();
        for (slot, face) in (0..).zip(mesh.indices(0)) {
            assert_eq!(drawn.faces[&(asset, 0, slot)], *face);
            assert!(
                face.iter().all(|&wedge| drawn.vertices[&(asset, wedge)].data == mesh.render_vertex(wedge))
            );
        }
    }
    assert!(link.times_sent().values().all(|&times| times == 1), "{:?}", link.times_sent());
}

#[test]
fn a_restated_scene_draws_the_same_proxies() {
    let (_, drawn, _) =
        same_after_restating(TestScene::new(2).with_proxies(&super::proxies::street(2)), |_| {});
    assert!(drawn.cut.instances == 2 && drawn.instances.len() > 2, "{:?}", drawn.cut);
}
