//! The bound on texels of texture levels in use.

use super::*;

fn two_in_view() -> ([AssetState; 2], [Instance; 2]) {
    let near = Instance::at(0, [0.0, 0.0, 0.0]);
    let far = Instance::at(1, [0.0, -8.0, 0.0]);
    ([textured(known_asset(2)), textured(known_asset(2))], [near, far])
}

fn with_room(max_texels: u64) -> Selector {
    Selector::new(SelectSettings { max_texels, ..SelectSettings::default() })
}

/// Levels in use of an asset.
fn levels_of(asset: &AssetState) -> usize {
    let applied = |level| asset.state(BlobPart::Texture { texture: 0, level }) == State::Applied;
    (0..4).filter(|level| applied(*level)).count()
}

#[test]
fn texture_levels_stay_within_their_bound_and_the_coarse_ones_come_first() {
    let view = above([0.0, 1.0, 0.5]);
    let mut unbounded = two_in_view();
    settle(&mut with_room(u64::MAX), &view, &unbounded.1, &mut unbounded.0);
    let all = [0, 1].map(|asset| levels_of(&unbounded.0[asset]));
    assert!(all[0] == 4 && all[1] > 0, "{all:?}");
    let side = |level: usize| [4_u64, 16, 64, 256][level];
    let texels = |levels: usize| (0..levels).map(|level| side(level).pow(2)).sum::<u64>();
    for max_texels in [0, 15, 16, 312, 4687, 9375, 62_500, 156_250] {
        let (mut assets, instances) = two_in_view();
        let mut selector = with_room(max_texels);
        settle(&mut selector, &view, &instances, &mut assets);
        let counters = selector.select(&view, &instances, &assets).counters;
        let held = [0, 1].map(|asset| levels_of(&assets[asset]));
        assert_eq!(counters.texels, held.map(texels).iter().sum::<u64>());
        assert!(counters.texels <= max_texels, "{held:?} with room for {max_texels}");
        assert!(counters.settled, "levels without room are not waited for");
        // Nothing that would fit is left out.
        let next = (0..2).filter(|&asset| held[asset] < all[asset]).map(|asset| side(held[asset]).pow(2));
        let next: Vec<_> = next.collect();
        assert!(next.iter().all(|next| counters.texels + next > max_texels), "{held:?} in {max_texels}");
        assert_eq!(counters.levels_without_room > 0, !next.is_empty());
    }
}

#[test]
fn shared_texels_count_once() {
    let (mut assets, instances) = two_in_view();
    let shared = vec![SharedTexture { texture: 0, asset: 0, of: 0 }];
    let entry = AssetEntry { shared, ..assets[1].entry().clone() };
    assets[1] = textured(known_asset_of(entry, 2));
    for asset in &mut assets {
        asset.set_state(BlobPart::Texture { texture: 0, level: 1 }, State::Applied);
    }
    let texels = |assets: &[AssetState]| {
        Selector::default().select(&above([0.0, 1.0, 0.5]), &instances, assets).counters.texels
    };
    assert_eq!(texels(&assets), 16 * 16);
    // The asset that it is requested for may lack it.
    assets[0].set_state(BlobPart::Texture { texture: 0, level: 1 }, State::Absent);
    assert_eq!(texels(&assets), 16 * 16);
}
