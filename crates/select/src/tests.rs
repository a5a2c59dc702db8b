//! The selection on synthetic planes.

use std::collections::HashSet;

use proptest::prelude::*;

use super::*;
use crate::testing::{plane, plane_entry};
use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, Sphere, decode_stated_page, encode_pages};
use lodestream_scene::asset::{
    AssetDescription, Material, TextureFormat, TextureInfo, TextureKind, TextureLevel,
};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::placement::Placement;
use lodestream_scene::shared::SharedTexture;
use lodestream_scene::view::View;

mod hidden_textures;
mod many_instances;
mod shadows;
mod texels;
mod tiles;

/// An asset whose base is applied and whose index is known.
fn known_asset(levels: u8) -> AssetState {
    known_asset_of(plane_entry("plane", &plane(levels), 1000), levels)
}

fn known_asset_of(entry: AssetEntry, levels: u8) -> AssetState {
    let chunks = plane(levels);
    let mut asset = AssetState::new(entry);
    asset.set_state(BlobPart::Base, State::Applied);
    for (page, infos) in (0..).zip(chunks.chunks(CHUNKS_PER_PAGE)) {
        asset.add_index_page(page, infos.to_vec()).unwrap();
    }
    asset
}

fn above(eye: [f64; 3]) -> View {
    View::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.9, [1280, 720])
}

fn apply(assets: &mut [AssetState], id: BlobId, state: State) {
    let BlobId::Asset { asset, part } = id else { panic!("{id} is of no asset") };
    assets[asset as usize].set_state(part, state);
}

/// Applies wanted chunks a few at a time and undoes what is to be undone, until settled.
fn settle(selector: &mut Selector, view: &View, instances: &[Instance], assets: &mut [AssetState]) {
    for _ in 0..10_000 {
        let selection = selector.select(view, instances, assets).clone();
        if selection.wanted.is_empty() && selection.undo.is_empty() {
            return;
        }
        for id in selection.undo {
            apply(assets, id, State::Cached);
        }
        for wanted in selection.wanted.iter().take(20) {
            apply(assets, wanted.id, State::Applied);
        }
        assert_closed(assets);
    }
    panic!("the selection does not settle");
}

/// Every applied chunk's parents are applied.
fn assert_closed(assets: &[AssetState]) {
    for asset in assets {
        for chunk in asset.chunks().iter().flatten().filter(|chunk| chunk.state() == State::Applied) {
            for &parent in &chunk.info().parents {
                assert_eq!(asset.state(BlobPart::Chunk(parent)), State::Applied);
            }
        }
    }
}

fn applied(asset: &AssetState) -> HashSet<usize> {
    let is_applied = |chunk: &Chunk| chunk.state() == State::Applied;
    (0..).zip(asset.chunks()).filter(|(_, c)| c.as_ref().is_some_and(is_applied)).map(|(i, _)| i).collect()
}

#[test]
fn selection_settles_at_the_target() {
    let instances = [Instance::at(0, [0.0; 3])];
    for eye in [[0.0, 3.0, 4.0], [0.3, 0.2, 0.9], [0.0, 40.0, 90.0]] {
        let mut assets = [known_asset(6)];
        let mut selector = Selector::default();
        let view = above(eye);
        let before = max_screen_error_px(&view, &instances, &assets);
        settle(&mut selector, &view, &instances, &mut assets);
        let after = max_screen_error_px(&view, &instances, &assets);
        let finest = applied(&assets[0]).len() == assets[0].chunks().len();
        assert!(after <= 1.0 || finest, "{before} px became {after} px");
        assert!(selector.last().counters.settled);
        assert_eq!(selector.last().counters.max_screen_error_px, after);
    }
}

#[test]
fn distant_views_undo_chunks() {
    let instances = [Instance::at(0, [0.0; 3])];
    let mut assets = [known_asset(6)];
    let mut selector = Selector::default();
    settle(&mut selector, &above([0.0, 2.0, 3.0]), &instances, &mut assets);
    let near = applied(&assets[0]).len();
    settle(&mut selector, &above([0.0, 40.0, 60.0]), &instances, &mut assets);
    let far = applied(&assets[0]).len();
    assert!(far * 4 < near, "{near} chunks near, {far} far");
    settle(&mut selector, &above([0.0, 4000.0, 6000.0]), &instances, &mut assets);
    assert_eq!(applied(&assets[0]).len(), 0);
}

#[test]
fn small_camera_movements_change_nothing() {
    let instances = [Instance::at(0, [0.0; 3])];
    let mut assets = [known_asset(6)];
    let mut selector = Selector::default();
    let (near, far) = (above([0.0, 5.0, 10.0]), above([0.0, 5.5, 11.0]));
    settle(&mut selector, &near, &instances, &mut assets);
    let settled = applied(&assets[0]);
    for _ in 0..3 {
        settle(&mut selector, &far, &instances, &mut assets);
        assert_eq!(applied(&assets[0]), settled);
        settle(&mut selector, &near, &instances, &mut assets);
        assert_eq!(applied(&assets[0]), settled);
    }
}

#[test]
fn chunks_out_of_view_are_undone_only_near_the_budget() {
    let instances = [Instance::at(0, [0.0; 3])];
    let mut assets = [known_asset(6)];
    let mut selector = Selector::default();
    settle(&mut selector, &above([0.0, 1.0, 2.0]), &instances, &mut assets);
    let settled = applied(&assets[0]);
    let away = View::look_at([0.0, 1.0, 2.0], [0.0, 1.0, 9.0], [0.0, 1.0, 0.0], 0.9, [1280, 720]);
    settle(&mut selector, &away, &instances, &mut assets);
    assert_eq!(applied(&assets[0]), settled);
    selector.settings_mut().max_faces = settled.len() as u64 * 600;
    settle(&mut selector, &away, &instances, &mut assets);
    let kept = applied(&assets[0]).len();
    assert!(kept * 2 <= settled.len(), "{kept} of {} kept", settled.len());
}

#[test]
fn nearest_instance_decides_for_shared_chunks() {
    let far = [Instance::at(0, [0.0, 0.0, -60.0])];
    let both = [far[0], Instance::at(0, [0.0, 0.0, -3.0])];
    let view = above([0.0, 1.0, 2.0]);
    let needed =
        |instances: &[Instance]| Selector::default().select(&view, instances, &[known_asset(6)]).counters;
    assert!(needed(&both).needed_chunks > 2 * needed(&far).needed_chunks);
    assert_eq!(needed(&both).visible_instances, 2);
}

#[test]
fn scale_and_rotation_are_taken_into_account() {
    let view = above([0.0, 3.0, 6.0]);
    let needed = |instance: Instance| {
        Selector::default().select(&view, &[instance], &[known_asset(6)]).counters.needed_chunks
    };
    let plain = needed(Instance::at(0, [0.0; 3]));
    let small = needed(Instance { asset: 0, placement: Placement { scale: 0.1, ..Placement::at([0.0; 3]) } });
    assert!(small * 4 < plain, "{small} against {plain}");
    // A plane is the same after half a turn.
    let turned = needed(Instance {
        asset: 0,
        placement: Placement { rotation: [0.0, 1.0, 0.0, 0.0], ..Placement::at([0.0; 3]) },
    });
    assert!(turned.abs_diff(plain) * 20 <= plain, "{turned} against {plain}");
    // The same scene a million times larger looks the same.
    let huge = View { eye: view.eye.map(|x| x * 1e6), ..view };
    let scaled = Instance { asset: 0, placement: Placement { scale: 1e6, ..Placement::at([0.0; 3]) } };
    let huge = Selector::default().select(&huge, &[scaled], &[known_asset(6)]).counters.needed_chunks;
    assert_eq!(huge, plain);
}

#[test]
fn threshold_rises_until_the_budgets_hold() {
    let instances = [Instance::at(0, [0.0; 3])];
    let view = above([0.0, 1.0, 2.0]);
    for max_faces in [600, 30_000, 200_000] {
        let mut assets = [known_asset(7)];
        let mut selector = Selector::new(SelectSettings { max_faces, ..SelectSettings::default() });
        settle(&mut selector, &view, &instances, &mut assets);
        let faces = applied(&assets[0]).len() as u64 * 600;
        assert!(faces <= max_faces, "{faces} of {max_faces}");
        assert!(selector.last().counters.threshold_px > 1.0);
        // Lifting the budget brings the target back.
        *selector.settings_mut() = SelectSettings::default();
        settle(&mut selector, &view, &instances, &mut assets);
        assert_eq!(selector.last().counters.threshold_px, 1.0);
    }
}

#[test]
fn base_meshes_come_first_and_unknown_chunks_have_the_root_error() {
    let chunks = plane(5);
    let mut fresh = AssetState::new(plane_entry("fresh", &chunks, 1000));
    let instances =
        [Instance::at(0, [0.0; 3]), Instance::at(1, [0.5, 0.0, 0.0]), Instance::at(1, [0.0, 0.0, 900.0])];
    let view = above([0.0, 1.0, 3.0]);
    let parts = |assets: &[AssetState]| {
        let selection = Selector::default().select(&view, &instances, assets).clone();
        selection.wanted.iter().map(|w| w.id).collect::<Vec<_>>()
    };
    assert_eq!(max_screen_error_px(&view, &instances, &[fresh.clone(), known_asset(5)]), f64::INFINITY);
    let wanted = parts(&[fresh.clone(), known_asset(5)]);
    assert_eq!(wanted[0], BlobId::base(0));
    let before_chunks = wanted.iter().position(|id| *id == BlobId::index_page(0, 0)).unwrap();
    let chunks_after =
        wanted[before_chunks..].iter().filter(|id| matches!(id.part(), Some(BlobPart::Chunk(_))));
    assert!(chunks_after.count() > 10, "{wanted:?}");

    fresh.set_state(BlobPart::Base, State::Applied);
    let root_px = max_screen_error_px(&view, &instances[..1], &[fresh.clone()]);
    fresh.add_index_page(0, chunks[..64].to_vec()).unwrap();
    assert!(fresh.unknown_error() < 0.25 && fresh.unknown_error() >= chunks[64].error);
    for chunk in 0..64 {
        fresh.set_state(BlobPart::Chunk(chunk), State::Applied);
    }
    let known_px = max_screen_error_px(&view, &instances[..1], &[fresh.clone()]);
    assert!(known_px < root_px && known_px > 1.0, "{known_px} of {root_px}");
    assert_eq!(parts(&[fresh])[0], BlobId::index_page(0, 1));
}

/// Of two chunks with equal distance and length the larger comes first, whatever the octave of its screen error. A
/// small chunk with large descendants comes before one without.
#[test]
fn chunks_are_ordered_by_difference_per_byte_after_their_parents() {
    let chunk = |error: f32, radius: f32, payload_bytes: u32, parents: &[u32]| ChunkInfo {
        level: 1 + u8::from(!parents.is_empty()),
        error,
        parents: parents.to_vec(),
        sphere: Sphere { center: [0.0; 3], radius },
        payload_bytes,
        vertices: 300,
        wedges: 300,
        faces: 600,
        ..ChunkInfo::default()
    };
    let order = |chunks: &[ChunkInfo]| {
        let mut asset = AssetState::new(plane_entry("plane", chunks, 1000));
        asset.set_state(BlobPart::Base, State::Applied);
        asset.add_index_page(0, chunks.to_vec()).unwrap();
        let (view, instances) = (above([0.0, 3.0, 0.5]), [Instance::at(0, [0.0; 3])]);
        let mut selector = Selector::default();
        let wanted = selector.select(&view, &instances, &[asset]).wanted.clone();
        assert!(wanted.is_sorted_by_key(|wanted| std::cmp::Reverse(wanted.priority)));
        wanted
            .iter()
            .filter_map(|wanted| match wanted.id.part() {
                Some(BlobPart::Chunk(chunk)) => Some(chunk),
                _ => None,
            })
            .collect::<Vec<_>>()
    };
    // Three times the error on a tenth of the size.
    assert_eq!(order(&[chunk(0.03, 0.1, 800, &[]), chunk(0.01, 1.0, 800, &[])]), [1, 0]);
    assert_eq!(order(&[chunk(0.01, 1.0, 8000, &[]), chunk(0.01, 1.0, 800, &[])]), [1, 0]);
    let behind = [chunk(0.01, 0.2, 800, &[]), chunk(0.01, 0.3, 800, &[]), chunk(0.05, 1.0, 800, &[0])];
    assert_eq!(order(&behind), [0, 2, 1]);
    // The child has a higher priority than its parent, and follows it directly.
    assert_eq!(order(&[chunk(0.01, 0.5, 9000, &[]), chunk(0.1, 1.0, 100, &[0])]), [0, 1]);
}

#[test]
fn index_pages_just_above_the_target_are_requested_together() {
    let chunks = plane(6);
    let mut asset = AssetState::new(plane_entry("plane", &chunks, 1000));
    asset.set_state(BlobPart::Base, State::Applied);
    for (page, infos) in (0..2).zip(chunks.chunks(CHUNKS_PER_PAGE)) {
        asset.add_index_page(page, infos.to_vec()).unwrap();
    }
    let instances = [Instance::at(0, [0.0; 3])];
    // As far as makes the error of what is unknown 1.05 px.
    let (mut near, mut far) = (1.0, 1e6);
    for _ in 0..200 {
        let middle = (near + far) / 2.0;
        let unknown = Projection::new(&above([0.0, 1.0, middle]));
        let bounds = unknown.bounds(asset.entry(), &instances[0]);
        let px = unknown.error_px(f64::from(asset.unknown_error()), bounds.depth);
        if px > 1.05 { near = middle } else { far = middle }
    }
    let mut selector = Selector::default();
    let wanted = &selector.select(&above([0.0, 1.0, near]), &instances, &[asset]).wanted;
    let pages: Vec<_> =
        wanted.iter().filter(|w| matches!(w.id.part(), Some(BlobPart::IndexPage(_)))).collect();
    let ids: Vec<_> = pages.iter().map(|page| page.id).collect();
    assert_eq!(ids, (2..6).map(|page| BlobId::index_page(0, page)).collect::<Vec<_>>());
    // Only the first page is needed for certain: it comes first, the others in order.
    assert!(pages.windows(2).all(|pair| pair[0].priority > pair[1].priority), "{pages:?}");
}

#[test]
fn pages_may_come_in_any_order_and_wrong_ones_are_refused() {
    let chunks = plane(5);
    let mut asset = AssetState::new(plane_entry("plane", &chunks, 1000));
    let pages: Vec<_> = chunks.chunks(CHUNKS_PER_PAGE).map(<[_]>::to_vec).collect();
    assert_eq!(asset.add_index_page(99, Vec::new()), Err(PageError::NoSuchPage(99)));
    assert!(matches!(asset.add_index_page(1, pages[1][1..].to_vec()), Err(PageError::WrongCount { .. })));
    assert!(matches!(asset.add_index_page(0, pages[2].clone()), Err(PageError::ParentNotOlder(_))));
    for page in (0..pages.len()).rev() {
        asset.add_index_page(page as u32, pages[page].clone()).unwrap();
        // Chunks whose parents are not known are never wanted.
        asset.set_state(BlobPart::Base, State::Applied);
        let mut selector = Selector::default();
        let selection = selector.select(
            &above([0.0, 1.0, 2.0]),
            &[Instance::at(0, [0.0; 3])],
            std::slice::from_ref(&asset),
        );
        let any_chunk = selection.wanted.iter().any(|w| matches!(w.id.part(), Some(BlobPart::Chunk(_))));
        assert_eq!(any_chunk, page == 0);
    }
    assert_eq!(asset.known_pages() as usize, pages.len());
    assert_eq!(asset.unknown_error(), 0.0);
}

/// 255 + 1 must not overflow: the bound would be 0, and no later page would be requested.
#[test]
fn page_of_level_255_bounds_later_pages() {
    let mut chunks = plane(5);
    chunks[63].level = 255;
    let mut asset = AssetState::new(plane_entry("plane", &chunks, 1000));
    asset.set_state(BlobPart::Base, State::Applied);
    asset.add_index_page(0, chunks[..64].to_vec()).unwrap();
    assert!(asset.unknown_error() >= chunks[63].error);
    let mut selector = Selector::default();
    let wanted = &selector.select(&above([0.0, 0.2, 0.5]), &[Instance::at(0, [0.0; 3])], &[asset]).wanted;
    assert!(wanted.iter().any(|w| w.id == BlobId::index_page(0, 1)), "{wanted:?}");
}

/// A region without chunks for two levels: its next chunk has a parent three levels up, and an error far above those of
/// the levels between. The bound must cover it, else its page is not requested.
#[test]
fn unknown_chunks_are_bounded_with_parents_several_levels_up() {
    let chunk = |level: u8, error: f32, parents: &[u32]| ChunkInfo {
        level,
        error,
        parents: parents.to_vec(),
        sphere: Sphere { center: [0.0; 3], radius: 1.0 },
        payload_bytes: 700,
        vertices: 300,
        wedges: 300,
        faces: 600,
        ..ChunkInfo::default()
    };
    let mut chunks = vec![chunk(1, 0.2, &[]), chunk(1, 0.02, &[])];
    chunks.extend((2..33).map(|_| chunk(2, 0.01, &[1])));
    chunks.extend((33..64).map(|id| chunk(3, 0.005, &[id - 31])));
    chunks.push(chunk(4, 0.19, &[0]));
    let (pages, chunks) = encode_pages(&chunks).unwrap();
    let mut asset = AssetState::new(plane_entry("plane", &chunks, 1000));
    asset.set_state(BlobPart::Base, State::Applied);
    asset.add_index_page(0, decode_stated_page(&pages[0], 0).unwrap()).unwrap();
    assert!(asset.unknown_error() >= chunks[64].error, "{} is not a bound", asset.unknown_error());
    // The bound is not larger than necessary.
    assert_eq!(asset.unknown_error(), chunks[64].error);
    for id in 0..64 {
        asset.set_state(BlobPart::Chunk(id), State::Applied);
    }
    let instances = [Instance::at(0, [0.0; 3])];
    let mut selector = Selector::default();
    let wanted = &selector.select(&above([0.0, 12.0, 16.0]), &instances, std::slice::from_ref(&asset)).wanted;
    assert!(wanted.iter().any(|w| w.id == BlobId::index_page(0, 1)), "{wanted:?}");
    asset.add_index_page(1, decode_stated_page(&pages[1], 64).unwrap()).unwrap();
    assert_eq!(asset.unknown_error(), 0.0);
}

#[test]
fn failed_chunks_block_only_their_descendants() {
    let mut asset = known_asset(4);
    asset.set_state(BlobPart::Chunk(1), State::Failed);
    let mut assets = [asset];
    let mut selector = Selector::default();
    let (view, instances) = (above([0.0, 1.0, 2.0]), [Instance::at(0, [0.0; 3])]);
    settle(&mut selector, &view, &instances, &mut assets);
    assert!(selector.last().counters.missing_chunks > 0);
    assert!(applied(&assets[0]).len() > 10);
    assert!(selector.last().counters.max_screen_error_px > 1.0);
}

#[test]
fn unneeded_blobs_in_flight_are_cancelled() {
    let mut assets = [known_asset(6)];
    let instances = [Instance::at(0, [0.0; 3])];
    let mut selector = Selector::default();
    let asked: Vec<BlobId> = {
        let selection = selector.select(&above([0.0, 1.0, 2.0]), &instances, &assets);
        selection.wanted.iter().map(|w| w.id).take(200).collect()
    };
    for id in &asked {
        apply(&mut assets, *id, State::InFlight);
    }
    let again = selector.select(&above([0.0, 1.0, 2.0]), &instances, &assets);
    assert!(again.cancel.is_empty());
    assert!(again.wanted.iter().take(100).all(|w| w.state == State::InFlight));
    let far = selector.select(&above([0.0, 100.0, 200.0]), &instances, &assets);
    assert!(far.cancel.len() > 100, "{}", far.cancel.len());
}

/// With a texture that covers the plane (2 units) once.
fn textured(mut asset: AssetState) -> AssetState {
    let level = |side: u32| TextureLevel {
        width: side,
        height: side,
        bytes: 8 * side * side,
        format: TextureFormat::Jpeg,
    };
    let description = AssetDescription {
        name: "plane".into(),
        materials: vec![Material { base_color_texture: Some(0), ..Material::default() }],
        textures: vec![TextureInfo {
            kind: TextureKind::Color,
            width: 256,
            height: 256,
            planes: 0,
            mean: None,
            uv_per_unit: 0.5,
            levels: [4, 16, 64, 256].map(level).to_vec(),
        }],
    };
    asset.set_description(&description);
    asset
}

#[test]
fn texture_levels_follow_texel_density() {
    let finest = |eye: [f64; 3]| {
        let mut assets = [textured(known_asset(2))];
        settle(&mut Selector::default(), &above(eye), &[Instance::at(0, [0.0; 3])], &mut assets);
        let here = |l: u8| assets[0].state(BlobPart::Texture { texture: 0, level: l }) == State::Applied;
        let held = (0..4).take_while(|l| here(*l)).count();
        assert!((held as u8..4).all(|l| !here(l)));
        held
    };
    // At 800 units the plane covers about 2 px, at 80 about 19.
    assert_eq!(finest([0.0, 480.0, 640.0]), 1);
    assert_eq!(finest([0.0, 48.0, 64.0]), 3);
    assert_eq!(finest([0.0, 4.0, 4.0]), 4);
}

#[test]
fn shared_textures_are_wanted_once_with_summed_differences() {
    let wanted = |sharing: bool, both: bool| {
        let plain = textured(known_asset(2));
        let shared = vec![SharedTexture { texture: 0, asset: 0, of: 0 }];
        let sharing =
            if sharing { AssetEntry { shared, ..plain.entry().clone() } } else { plain.entry().clone() };
        let assets = [plain, textured(known_asset_of(sharing, 2))];
        let instances = [Instance::at(0, [-3.0, 0.0, 0.0]), Instance::at(1, [3.0, 0.0, 0.0])];
        let instances = &instances[..if both { 2 } else { 1 }];
        let wanted = Selector::default().select(&above([0.0, 12.0, 0.5]), instances, &assets).wanted.clone();
        let is_texture = |w: &Wanted| matches!(w.id.part(), Some(BlobPart::Texture { .. }));
        wanted.into_iter().filter(is_texture).map(|w| (w.id, w.priority)).collect::<Vec<_>>()
    };
    let alone = wanted(true, false);
    let apart = wanted(false, true);
    let shared = wanted(true, true);
    assert_eq!(apart.len(), 2 * alone.len());
    assert_eq!(shared.len(), alone.len());
    for ((id, priority), (same, of_one)) in shared.into_iter().zip(alone) {
        assert_eq!((id, id.asset()), (same, Some(0)));
        assert!(priority > of_one, "{id}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any prefix of the list can be applied in order, and applied chunks can be undone in the listed order; priorities
    /// fall along the list.
    #[test]
    fn every_prefix_is_ancestor_closed_and_every_undo_valid(
        eye in prop::array::uniform3(-6.0..6.0_f64),
        later in prop::array::uniform3(-30.0..30.0_f64),
        prefixes in prop::collection::vec(0..60_usize, 1..8),
        max_faces in 1_000..400_000_u64,
    ) {
        let instances = [
            Instance::at(0, [0.0; 3]),
            Instance::at(1, [2.0, 0.5, -1.0]),
            Instance { asset: 0, placement: Placement { scale: 2.0, ..Placement::at([-3.0, 0.0, 1.0]) } },
        ];
        let mut assets = [known_asset(5), known_asset(4)];
        let mut selector = Selector::new(SelectSettings { max_faces, ..SelectSettings::default() });
        for (n, prefix) in prefixes.into_iter().enumerate() {
            let view = above(if n % 2 == 0 { eye } else { later });
            let selection = selector.select(&view, &instances, &assets).clone();
            prop_assert!(selection.wanted.is_sorted_by(|a, b| a.priority >= b.priority));
            for wanted in selection.wanted.iter().take(prefix) {
                apply(&mut assets, wanted.id, State::Applied);
                assert_closed(&assets);
            }
            for id in selector.select(&view, &instances, &assets).undo.clone() {
                apply(&mut assets, id, State::Cached);
                assert_closed(&assets);
            }
        }
    }
}
