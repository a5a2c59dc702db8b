//! Textures that assets share: sent once, used by all of them.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_scene::blob::{BlobId, BlobPart};

use super::{finest, view};
use crate::core::testing::{Loopback, TestScene};
use crate::core::{Change, TexturePixels};

/// The texture levels that each asset received.
fn painted(link: &mut Loopback) -> BTreeMap<u32, BTreeSet<u8>> {
    let mut painted: BTreeMap<u32, BTreeSet<u8>> = BTreeMap::new();
    for change in link.core.take_changes(link.now, usize::MAX) {
        if let Change::Texture(texture) = change {
            assert!(painted.entry(texture.asset).or_default().insert(texture.level), "twice");
        }
    }
    painted
}

fn textures_sent(link: &Loopback) -> Vec<BlobId> {
    let is_texture = |id: &BlobId| matches!(id.part(), Some(BlobPart::Texture { .. }));
    link.sent.iter().copied().filter(is_texture).collect()
}

fn all_levels(asset: u32) -> (u32, BTreeSet<u8>) {
    (asset, BTreeSet::from([0, 1, 2]))
}

#[test]
fn shared_textures_are_sent_once_and_drawn_on_all_assets() {
    for (hills, copies) in [(TestScene::new(2), 2), (TestScene::new(2).sharing_textures(), 1)] {
        let mut link = Loopback::new(hills, |_| {});
        let near = view(link.source.camera(), 1e-4);
        link.core.set_view(link.now, near);
        link.connect();
        link.settle();
        assert_eq!(painted(&mut link), BTreeMap::from([0, 1].map(all_levels)));
        assert_eq!(textures_sent(&link).len(), 3 * copies, "{:?}", link.sent);
        assert!(link.times_sent().values().all(|n| *n == 1), "{:?}", link.times_sent());
        assert_eq!(link.core.stats().texture_levels, 3 * copies as u64);
    }
}

#[test]
fn shared_textures_are_pushed_once() {
    let mut link = Loopback::new(TestScene::new(2).sharing_textures(), |_| {});
    link.push_bytes = 1 << 20;
    link.connect();
    link.settle();
    let sent = textures_sent(&link);
    assert!(!sent.is_empty() && sent.iter().all(|id| id.asset() == Some(0)), "{sent:?}");
    assert!(link.times_sent().values().all(|n| *n == 1), "{:?}", link.times_sent());
}

#[test]
fn a_later_asset_uses_held_textures_or_requests_them_again() {
    for cache_bytes in [64 << 20, 0] {
        let mut link = Loopback::new(TestScene::new(2).sharing_textures(), |config| {
            config.cache_bytes = cache_bytes;
        });
        link.core.set_view(link.now, finest());
        link.source.unreadable.lock().unwrap().insert(BlobId::base(1));
        link.connect();
        link.run(3000);
        assert_eq!(painted(&mut link), BTreeMap::from([all_levels(0)]));
        link.source.unreadable.lock().unwrap().clear();
        link.settle();
        assert_eq!(painted(&mut link), BTreeMap::from([all_levels(1)]));
        let sent = textures_sent(&link);
        assert!(sent.iter().all(|id| id.asset() == Some(0)), "{sent:?}");
        assert_eq!(sent.len() > 3, cache_bytes == 0, "{sent:?}");
    }
}

#[test]
fn a_damaged_shared_level_is_missing_on_all_assets_and_requested_again() {
    let mut hills = TestScene::new(2).sharing_textures();
    hills.damage(BlobId::texture(0, 0, 1));
    let mut link = Loopback::new(hills, |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    link.run(60_000);
    let painted = painted(&mut link);
    assert_eq!(painted[&0], painted[&1]);
    assert!(painted[&0].contains(&0) && !painted[&0].contains(&1), "{painted:?}");
    assert!(link.times_sent()[&BlobId::texture(0, 0, 1)] > 1);
    assert_eq!(link.core.lacking_blobs().collect::<Vec<_>>(), [BlobId::texture(0, 0, 1)]);
}

#[test]
fn a_level_that_the_host_cannot_decode_counts_as_damaged_on_all_assets() {
    let mut link = Loopback::new(TestScene::new(2).sharing_textures(), |config| {
        config.host_decodes_textures = true;
    });
    link.core.set_view(link.now, finest());
    link.connect();
    link.settle();
    let changes = link.core.take_changes(link.now, usize::MAX);
    let is_file = |change: &Change| match change {
        Change::Texture(texture) => Some(matches!(*texture.pixels, TexturePixels::File { .. })),
        _ => None,
    };
    assert_eq!(changes.iter().filter_map(is_file).collect::<Vec<_>>(), [true; 6]);
    let id = BlobId::texture(0, 0, 1);
    link.core.handle_texture_failure(link.now, (0, 0), (1, None), "no such picture".into());
    assert!(!link.core.is_settled());
    assert_eq!(link.core.stats().decode_failures, 1);
    // Another attempt gives it to the host again, for both assets.
    link.settle();
    assert_eq!(link.times_sent()[&id], 2);
    assert_eq!(painted(&mut link), BTreeMap::from([0, 1].map(|asset| (asset, BTreeSet::from([1])))));
}

#[test]
fn after_a_reconnection_no_shared_texture_is_drawn_or_sent_twice() {
    let mut link = Loopback::new(TestScene::new(2).sharing_textures(), |_| {});
    link.core.set_view(link.now, finest());
    link.connect();
    link.run(60);
    link.cut();
    link.connect();
    link.settle();
    assert_eq!(painted(&mut link), BTreeMap::from([0, 1].map(all_levels)));
}
