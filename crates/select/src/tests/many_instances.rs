//! Selection with and without the hierarchy of instances.

use std::num::NonZeroUsize;
use std::sync::Arc;

use super::*;

/// Planes all over, those of a quarter of one asset; some hide what is behind them.
fn scene(count: u32) -> (Vec<Instance>, Vec<AssetState>) {
    let place = |number: u32| {
        let f = f64::from(number);
        let at = [(f * 0.37).sin() * 60.0, (f * 0.11).cos() * 3.0, (f * 0.23).cos() * 60.0];
        let quarter = 2 * u32::from(at[0] > 0.0) + u32::from(at[2] > 0.0);
        let scale = 0.2 + f32::from(u8::try_from(number % 7).unwrap()) * 0.4;
        Instance { asset: 4 * quarter + number % 4, placement: Placement { scale, ..Placement::at(at) } }
    };
    let fresh = AssetState::new(plane_entry("plane", &plane(6), 1000));
    let mut hiding = known_asset(5);
    let corners = vec![[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]];
    let faces = vec![[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    hiding.set_occluder(Arc::new(Occluder::new(corners, faces)));
    let mut paged = AssetState::new(plane_entry("plane", &plane(8), 1000));
    paged.set_state(BlobPart::Base, State::Applied);
    let assets = (0..4).flat_map(|_| [known_asset(4), hiding.clone(), paged.clone(), fresh.clone()]);
    ((0..count).map(place).collect(), assets.collect())
}

#[test]
fn hierarchy_does_not_change_the_selection() {
    let (instances, mut assets) = scene(3000);
    let entries: Vec<AssetEntry> = assets.iter().map(|asset| asset.entry().clone()).collect();
    let trees = [0, 100, 1777, 3000].map(|known| {
        let known = instances[..known].iter();
        InstanceTree::new(known, |number| entries.get(number as usize))
    });
    let selector = || {
        let max_wanted = NonZeroUsize::new(1 << 20).unwrap();
        let settings = SelectSettings { shadows: true, max_wanted, ..SelectSettings::default() };
        let mut selector = Selector::new(settings);
        selector.set_to_sun(Some([0.3, 0.6, 0.4]));
        selector
    };
    let mut plain = selector();
    let mut others = [(); 4].map(|()| selector());
    let (mut wanted, mut cast, mut undone) = (0, 0, 0);
    for turn in 0..30_u32 {
        let angle = f64::from(turn) * 0.4;
        let eye = [angle.cos() * 50.0, 4.0 + f64::from(turn % 3) * 10.0, angle.sin() * 40.0];
        let target = [(angle * 2.0).sin() * 30.0, 0.0, angle.cos() * 10.0];
        let view = View::look_at(eye, target, [0.0, 1.0, 0.0], 0.4, [1280, 720]);
        let max_faces = if turn % 3 == 2 { 20_000 } else { 8_000_000 };
        for selector in others.iter_mut().chain([&mut plain]) {
            selector.settings_mut().max_faces = max_faces;
        }
        let expected = plain.select(&view, &instances, &assets).clone();
        for (other, tree) in others.iter_mut().zip(&trees) {
            let found = other.select_among(&view, Instances::new(&instances, tree), &assets);
            assert_eq!(*found, expected, "{} of 3000 known", tree.len());
        }
        cast += expected.counters.shadow_bytes;
        undone += expected.undo.len();
        wanted += expected.wanted.len();
        for id in &expected.undo {
            apply(&mut assets, *id, State::Cached);
        }
        for next in expected.wanted.iter().take(100) {
            if matches!(next.id, BlobId::Asset { part: BlobPart::Chunk(_), .. }) {
                apply(&mut assets, next.id, State::Applied);
            }
        }
    }
    assert!(
        wanted > 1000 && cast > 0 && undone > 0,
        "{wanted} wanted, {cast} bytes of shadows, {undone} undone"
    );
}
