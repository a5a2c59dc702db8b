//! Tiles of textures: those that a view shows, once, within the bound on texels.

use std::collections::BTreeSet;

use lodestream_scene::blob::{BlobId, BlobPart, Tile};
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;

use super::{Change, TestScene, view};
use crate::core::testing::Loopback;

/// A view of a corner of the first asset from so near that the finest level shows there.
fn near(x: f64, z: f64) -> View {
    let camera = Camera { eye: [x, 0.6, z + 0.01], target: [x, 0.0, z], ..TestScene::tiled(1).camera() };
    view(camera, 1.0)
}

/// What a renderer has: assets with their tiles.
#[derive(Default)]
struct Drawn {
    tiles: BTreeSet<(u32, Tile)>,
    removed: usize,
}

impl Drawn {
    fn take(&mut self, link: &mut Loopback) {
        for change in link.core.take_changes(link.now, usize::MAX) {
            match change {
                Change::Texture(change) => {
                    let Some(tile) = change.tile else { continue };
                    assert_eq!(change.pixels.bytes(), 260 * 260 * 4);
                    let tile = Tile { texture: change.texture, level: change.level, tile };
                    assert!(self.tiles.insert((change.asset, tile)), "{tile:?} twice");
                }
                Change::TileRemoved { asset, tile } => {
                    assert!(self.tiles.remove(&(asset, tile)), "{tile:?} was not there");
                    self.removed += 1;
                }
                _ => {}
            }
        }
    }

    fn finest(&self) -> Vec<u16> {
        self.tiles.iter().filter(|(_, tile)| tile.level == 3).map(|(_, tile)| tile.tile).collect()
    }
}

fn tiles_sent(link: &Loopback) -> Vec<BlobId> {
    link.sent.iter().copied().filter(|id| matches!(id.part(), Some(BlobPart::Tile(_)))).collect()
}

fn settled(scene: TestScene, adapt: impl FnOnce(&mut crate::core::Config)) -> (Loopback, Drawn) {
    let mut link = Loopback::new(scene, adapt);
    link.core.set_view(link.now, near(-0.8, 0.8));
    link.connect();
    link.settle();
    let mut drawn = Drawn::default();
    drawn.take(&mut link);
    (link, drawn)
}

fn visit(link: &mut Loopback, drawn: &mut Drawn, x: f64, z: f64) {
    link.core.set_view(link.now, near(x, z));
    link.settle();
    drawn.take(link);
}

#[test]
fn a_view_gets_its_tiles_and_a_swing_back_costs_nothing() {
    let (mut link, mut drawn) = settled(TestScene::tiled(1), |_| {});
    // u and v are least at x = −1 and z = −1; rows begin at v = 1.
    assert!(drawn.finest().contains(&0) && !drawn.finest().contains(&15), "{:?}", drawn.finest());
    visit(&mut link, &mut drawn, 0.8, -0.8);
    assert!(drawn.finest().contains(&15), "{:?}", drawn.finest());
    let sent = tiles_sent(&link).len();
    for _ in 0..3 {
        visit(&mut link, &mut drawn, -0.8, 0.8);
        visit(&mut link, &mut drawn, 0.8, -0.8);
    }
    assert_eq!((tiles_sent(&link).len(), drawn.removed), (sent, 0));
    assert!(link.times_sent().values().all(|n| *n == 1), "{:?}", link.times_sent());
    assert_eq!(link.times_sent()[&BlobId::texture_regions(0)], 1);
}

#[test]
fn tiles_give_way_to_others_and_come_back_from_the_cache() {
    // Room for the whole levels and eight tiles.
    let most = 128 * 128 + 256 * 256 + 8 * 260 * 260;
    let (mut link, mut drawn) = settled(TestScene::tiled(1), |config| config.select.max_texels = most);
    for (x, z) in [(0.8, -0.8), (0.8, 0.8), (-0.8, -0.8), (-0.8, 0.8), (0.8, -0.8)] {
        visit(&mut link, &mut drawn, x, z);
        assert!(drawn.tiles.len() <= 8, "{:?}", drawn.tiles);
        let stats = link.core.stats();
        assert!(stats.counters.texels <= most, "{stats:?}");
    }
    assert!(drawn.removed > 4, "{}", drawn.removed);
    assert!(link.times_sent().values().all(|n| *n == 1), "from the cache: {:?}", link.times_sent());
    assert_eq!(link.core.stats().counters.texels, most - (8 - drawn.tiles.len() as u64) * 260 * 260);
}

#[test]
fn a_flight_among_a_hundred_textures_of_4096_texels_stays_within_the_bound() {
    // Room for the whole levels of all and 60 of their 34,000 tiles. What lies behind is not missed.
    let most = 100 * (128 * 128 + 256 * 256) + 60 * 260 * 260;
    let mut link = Loopback::new(TestScene::tiled_of(100, 4096), |config| config.select.max_texels = most);
    link.connect();
    let mut drawn = Drawn::default();
    for stop in 0..5 {
        let x = 60.0 * f64::from(stop);
        visit(&mut link, &mut drawn, x, 0.3);
        let sent = tiles_sent(&link).len();
        assert!(link.core.stats().counters.texels <= most, "{:?}", link.core.stats());
        assert!(drawn.tiles.len() as u64 * 260 * 260 <= most && !drawn.tiles.is_empty());
        // Nothing moves to and fro while the view rests, or along a small swing.
        let (tiles, removed) = (drawn.tiles.clone(), drawn.removed);
        visit(&mut link, &mut drawn, x, 0.3);
        assert_eq!((&drawn.tiles, drawn.removed, tiles_sent(&link).len()), (&tiles, removed, sent));
        visit(&mut link, &mut drawn, x + 0.1, 0.3);
        let swung = tiles_sent(&link).len();
        visit(&mut link, &mut drawn, x, 0.3);
        visit(&mut link, &mut drawn, x + 0.1, 0.3);
        assert_eq!(tiles_sent(&link).len(), swung);
    }
    assert!(drawn.removed > 100, "{}", drawn.removed);
    assert!(link.times_sent().values().all(|n| *n == 1), "each tile once: {:?}", link.times_sent().len());
}

#[test]
fn tiles_that_left_the_cache_are_fetched_again() {
    let most = 128 * 128 + 256 * 256 + 8 * 260 * 260;
    let (mut link, mut drawn) = settled(TestScene::tiled(1), |config| {
        config.select.max_texels = most;
        config.cache_bytes = 0;
    });
    for _ in 0..2 {
        visit(&mut link, &mut drawn, 0.8, -0.8);
        visit(&mut link, &mut drawn, -0.8, 0.8);
        assert!(drawn.finest().contains(&0), "{:?}", drawn.finest());
    }
    assert!(link.times_sent().values().any(|n| *n > 1));
}

#[test]
fn shared_tiles_are_sent_once_and_drawn_and_removed_on_all_assets() {
    let most = 128 * 128 + 256 * 256 + 8 * 260 * 260;
    let (mut link, mut drawn) = settled(TestScene::tiled(2).sharing_textures(), |config| {
        config.select.max_texels = most;
    });
    for (x, z) in [(0.8, -0.8), (2.2, 0.8), (3.8, -0.8)] {
        visit(&mut link, &mut drawn, x, z);
        let of = |asset| {
            let own = drawn.tiles.iter().filter(|(other, _)| *other == asset);
            own.map(|(_, tile)| *tile).collect::<BTreeSet<_>>()
        };
        assert_eq!(of(0), of(1));
    }
    assert!(drawn.removed > 0 && tiles_sent(&link).iter().all(|id| id.asset() == Some(0)));
    assert!(link.times_sent().values().all(|n| *n == 1), "{:?}", link.times_sent());
}

#[test]
fn damaged_regions_and_tiles_leave_what_is_coarser() {
    let mut scene = TestScene::tiled(1);
    scene.damage(BlobId::texture_regions(0));
    let mut link = Loopback::new(scene, |_| {});
    link.core.set_view(link.now, near(-0.8, 0.8));
    link.connect();
    link.run(20_000);
    assert!(tiles_sent(&link).is_empty() && link.core.stats().texture_levels == 2);
    assert_eq!(link.core.lacking_blobs().collect::<Vec<_>>(), [BlobId::texture_regions(0)]);

    let mut scene = TestScene::tiled(1);
    let damaged = BlobId::tile(0, Tile { texture: 0, level: 2, tile: 0 });
    scene.damage(damaged);
    let mut link = Loopback::new(scene, |_| {});
    link.core.set_view(link.now, near(-0.8, 0.8));
    link.connect();
    link.run(20_000);
    let mut drawn = Drawn::default();
    drawn.take(&mut link);
    assert!(drawn.finest().contains(&0), "finer ones are drawn without it");
    assert_eq!(link.core.lacking_blobs().collect::<Vec<_>>(), [damaged]);
}
