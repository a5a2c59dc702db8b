//! Textures and index pages of occluded assets.

use std::sync::Arc;

use super::*;
use crate::priority::is_hidden;

/// A square with a side of 2 × `half`, about the origin in the xz plane, which hides what is below it.
fn flat(half: f32) -> Arc<Occluder> {
    let corner = |x: f32, z: f32| [x * half, 0.0, z * half];
    let corners = vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    Arc::new(Occluder::new(corners, vec![[0, 1, 2], [0, 2, 3]]))
}

fn hiding(mut asset: AssetState, half: f32) -> AssetState {
    asset.set_occluder(flat(half));
    asset
}

/// Two planes with a texture each, and a roof over the first.
fn roofed() -> ([AssetState; 3], [Instance; 3]) {
    let mut roof = AssetState::new(plane_entry("roof", &[], 1000));
    roof.set_state(BlobPart::Base, State::Applied);
    let textured = || hiding(textured(known_asset(2)), 1.0);
    let instances = [
        Instance::at(0, [-3.0, 0.0, 0.0]),
        Instance::at(1, [3.0, 0.0, 0.0]),
        Instance::at(2, [-3.0, 3.0, 0.0]),
    ];
    ([textured(), textured(), hiding(roof, 2.5)], instances)
}

fn levels(wanted: &[Wanted]) -> Vec<Wanted> {
    let is_texture = |w: &&Wanted| matches!(w.id.part(), Some(BlobPart::Texture { .. }));
    wanted.iter().filter(is_texture).copied().collect()
}

#[test]
fn hidden_textures_come_after_visible_shapes() {
    let (assets, instances) = roofed();
    let view = above([0.0, 12.0, 0.5]);
    let wanted = Selector::default().select(&view, &instances, &assets).wanted.clone();
    let found = levels(&wanted);
    assert!(found.iter().any(|w| w.id.asset() == Some(0)), "{found:?}");
    for level in &found {
        assert_eq!(is_hidden(level.priority), level.id.asset() == Some(0), "{level:?}");
    }
    let last_seen = wanted.iter().rposition(|w| !is_hidden(w.priority)).unwrap();
    assert!(wanted[..last_seen].iter().all(|w| !is_hidden(w.priority)));
    // All chunks are applied: only textures are wanted.
    let mut refined = assets.clone();
    for asset in &mut refined[..2] {
        (0..5).for_each(|chunk| asset.set_state(BlobPart::Chunk(chunk), State::Applied));
    }
    let found = levels(&Selector::default().select(&view, &instances, &refined).wanted);
    assert!(
        found.iter().all(|level| is_hidden(level.priority) == (level.id.asset() == Some(0))),
        "{found:?}"
    );
    // Without the occlusion test nothing is hidden.
    let settings = SelectSettings { hidden_last: false, ..SelectSettings::default() };
    let found = levels(&Selector::new(settings).select(&view, &instances, &assets).wanted);
    assert!(found.iter().all(|level| !is_hidden(level.priority)));
}

#[test]
fn texture_is_visible_if_one_instance_is() {
    let (assets, [hidden, seen, roof]) = roofed();
    let both = [hidden, seen, roof, Instance::at(0, [0.0, 0.0, 3.0])];
    let view = above([0.0, 12.0, 0.5]);
    let found = levels(&Selector::default().select(&view, &both, &assets).wanted);
    assert!(found.iter().all(|level| !is_hidden(level.priority)), "{found:?}");
    // The texture is visible if it is shared with an asset in view.
    let shared = vec![SharedTexture { texture: 0, asset: 0, of: 0 }];
    let sharing = AssetEntry { shared, ..assets[1].entry().clone() };
    let [first, _, last] = assets;
    let sharing = [first, hiding(textured(known_asset_of(sharing, 2)), 1.0), last];
    let found = levels(&Selector::default().select(&view, &[hidden, seen, roof], &sharing).wanted);
    assert!(found.iter().all(|level| level.id.asset() == Some(0) && !is_hidden(level.priority)), "{found:?}");
}

/// Index pages of an asset that a roof covers come after visible chunks.
#[test]
fn index_pages_of_hidden_assets_come_last() {
    let mut roof = AssetState::new(plane_entry("roof", &[], 1000));
    roof.set_state(BlobPart::Base, State::Applied);
    let unknown = || {
        let mut asset = AssetState::new(plane_entry("plane", &plane(2), 1000));
        asset.set_state(BlobPart::Base, State::Applied);
        hiding(asset, 1.0)
    };
    let assets = [unknown(), unknown(), hiding(roof, 2.5)];
    let [hidden, seen, over] = [
        Instance::at(0, [-3.0, 0.0, 0.0]),
        Instance::at(1, [3.0, 0.0, 0.0]),
        Instance::at(2, [-3.0, 3.0, 0.0]),
    ];
    let view = above([0.0, 12.0, 0.5]);
    let of = |instances: &[Instance], settings: SelectSettings| {
        let wanted = Selector::new(settings).select(&view, instances, &assets).wanted.clone();
        let priority = |asset| wanted.iter().find(|w| w.id == BlobId::index_page(asset, 0)).unwrap().priority;
        [0, 1].map(|asset| is_hidden(priority(asset)))
    };
    let usual = SelectSettings::default();
    assert_eq!(of(&[hidden, seen, over], usual), [true, false]);
    // Nothing is hidden without the roof, with another instance in view, or without the occlusion test.
    assert_eq!(of(&[hidden, seen], usual), [false, false]);
    assert_eq!(of(&[hidden, seen, over, Instance::at(0, [0.0, 0.0, 3.0])], usual), [false, false]);
    assert_eq!(of(&[hidden, seen, over], SelectSettings { hidden_last: false, ..usual }), [false, false]);
    // Base meshes are never wanted last, even if they are covered.
    let mut bare = assets.clone();
    bare[0].set_state(BlobPart::Base, State::Absent);
    let wanted = Selector::new(usual).select(&view, &[hidden, seen, over], &bare).wanted.clone();
    assert!(wanted.iter().any(|w| w.id == BlobId::base(0) && !is_hidden(w.priority)), "{wanted:?}");
}
