//! The first flight for a view: scene pages, base meshes and coarsest textures in the order in which they are pushed.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::first_cut::first_cut;
use super::scene_index::SceneIndex;
use crate::scheduler::Unit;
use crate::source::SceneSource;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::Instance;
use lodestream_scene::view::View;
use lodestream_select::Projection;
use lodestream_select::priority::{Priority, base_priority, refine_priority};

/// Benefit of a page without a visible instance, in square pixels per byte. Chunks with more benefit come first, but
/// after a turn of the camera the page is needed soon. In the demo the benefit of chunks falls below 1 after half a
/// second at 2 Mbit/s.
const HIDDEN_PAGE_BENEFIT: f32 = 1.0;

/// Most textures of an asset whose coarsest level is sent with its base mesh.
const MAX_TEXTURES: u16 = 4;
/// Longest such level.
const MAX_TEXTURE_BYTES: u32 = 512;
/// Most bytes of all such levels: 16 ms at 2 Mbit/s.
const MAX_TEXTURES_BYTES: u32 = 4096;
/// Least radius of an asset whose textures are sent, as a fraction of the picture's height. Such an asset covers a
/// quarter of the height, where its mean colour alone is far from its final look.
const MIN_TEXTURED_RADIUS: f32 = 0.125;

/// Orders scene pages, base meshes in view and, for assets that are large on the screen, the coarsest levels of
/// textures. Least urgent first, so that the next is popped from the end. The client requests the base meshes out of
/// view itself.
pub(super) fn first_flight(
    source: &dyn SceneSource,
    scene: &SceneIndex,
    view: &View,
) -> Vec<(Priority, Unit)> {
    let projection = Projection::new(view);
    let mut best = vec![0; scene.assets().len()];
    let mut largest_px = vec![0.0_f32; best.len()];
    let mut page_best = vec![0; scene.page_count()];
    let cut = first_cut(scene, view);
    for &proxy in &cut.proxies {
        let number = scene.proxies().nodes()[proxy as usize].proxy.asset;
        let (Some(entry), Some(page)) = (scene.asset(number), scene.page_of_proxy(proxy)) else { continue };
        let bounds = projection.bounds(entry, &Instance::at(number, [0.0; 3]));
        let priority = base_priority(bounds.coverage_px, bounds.foveation);
        best[number as usize] = priority.max(best[number as usize]);
        if let Some(best_on_page) = page_best.get_mut(page as usize) {
            *best_on_page = priority.max(*best_on_page);
        }
    }
    for (number, page, instance) in scene.near(&projection) {
        if cut.covers(number) {
            continue;
        }
        let Some(asset) = scene.asset(instance.asset) else { continue };
        let bounds = projection.bounds(asset, instance);
        if bounds.visible {
            let priority = base_priority(bounds.coverage_px, bounds.foveation);
            let best = &mut best[instance.asset as usize];
            *best = priority.max(*best);
            let largest_px = &mut largest_px[instance.asset as usize];
            *largest_px = largest_px.max(bounds.coverage_px);
            if let Some(best_on_page) = page_best.get_mut(page as usize) {
                *best_on_page = priority.max(*best_on_page);
            }
        }
    }
    // A base mesh is of no use before the page that lists its asset.
    for ((page, _), &priority) in scene.assets().zip(&best) {
        if let Some(best_on_page) = page_best.get_mut(page as usize) {
            *best_on_page = priority.max(*best_on_page);
        }
    }
    if !scene.proxies().is_empty() {
        let best = page_best.iter().copied().max().unwrap_or_default();
        page_best.get_mut(cut.last_page as usize).into_iter().for_each(|of_page| *of_page = best);
        for &(priority, page) in &cut.finer_pages {
            page_best
                .get_mut(page as usize)
                .into_iter()
                .for_each(|of_page| *of_page = priority.max(*of_page));
        }
        // A client numbers the entries of a page after those of the pages before.
        let mut of_later = 0;
        for best in page_best.iter_mut().rev() {
            of_later = of_later.max(*best);
            *best = of_later;
        }
    }
    let hidden = refine_priority(HIDDEN_PAGE_BENEFIT, 1.0, 1.0);
    let pages = (0..).zip(&page_best).map(|(page, &priority)| (priority.max(hidden), Unit::Page(page)));
    let bases = (0..).zip(&best).filter(|(_, priority)| **priority > 0);
    let bases = bases.map(|(asset, &priority)| (priority, Unit::Blob(BlobId::base(asset))));
    #[expect(clippy::cast_precision_loss, reason = "a viewport has at most 65,535 rows")]
    let least_px = MIN_TEXTURED_RADIUS * view.viewport_px[1] as f32;
    let textures = coarsest_textures(source, scene, |asset| {
        best.get(asset).zip(largest_px.get(asset)).filter(|(_, px)| **px >= least_px).map(|(best, _)| *best)
    });
    // Shared assets may be in both lists.
    let finer = cut.finer.iter().filter(|(_, asset)| best.get(*asset as usize) == Some(&0));
    let finer = finer.map(|&(priority, asset)| (priority, Unit::Blob(BlobId::base(asset))));
    let mut flight: Vec<_> = pages.chain(bases).chain(textures).chain(finer).collect();
    // Pages before base meshes before their textures, low numbers first, among equals.
    flight.sort_unstable_by_key(|&(priority, unit)| (priority, Reverse(unit)));
    flight
}

/// The coarsest texture levels of the assets to which `priority_of` gives a priority, a shared texture once. If they
/// exceed [`MAX_TEXTURES_BYTES`], the most urgent ones.
fn coarsest_textures(
    source: &dyn SceneSource,
    scene: &SceneIndex,
    priority_of: impl Fn(usize) -> Option<Priority>,
) -> impl Iterator<Item = (Priority, Unit)> {
    let mut levels: BTreeMap<BlobId, (Priority, u32)> = BTreeMap::new();
    for (number, (_, entry)) in scene.assets().enumerate() {
        let (Ok(asset), Some(priority)) = (u32::try_from(number), priority_of(number)) else { continue };
        for texture in 0..MAX_TEXTURES {
            let id = entry.sent_blob(asset, BlobPart::Texture { texture, level: 0 });
            if let Some(bytes) = source.blob_len(&id).filter(|&bytes| bytes <= MAX_TEXTURE_BYTES) {
                let level = levels.entry(id).or_insert((priority, bytes));
                level.0 = priority.max(level.0);
            }
        }
    }
    let mut levels: Vec<_> =
        levels.into_iter().map(|(id, (priority, bytes))| (priority, id, bytes)).collect();
    levels.sort_by_key(|&(priority, id, _)| (Reverse(priority), id));
    let mut left = MAX_TEXTURES_BYTES;
    levels.into_iter().map_while(move |(priority, id, bytes)| {
        left = left.checked_sub(bytes)?;
        Some((priority, Unit::Blob(id)))
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::testing::MemoryScene;
    use lodestream_scene::description::Camera;

    fn flight(scene: &MemoryScene, view: &View) -> Vec<(Priority, Unit)> {
        first_flight(scene, &SceneIndex::new(scene), view)
    }

    #[test]
    fn largest_base_mesh_comes_first_after_its_page() {
        let scene = MemoryScene::new(20, 1, 2);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let mut flight = flight(&scene, &view);
        flight.reverse();
        let units: Vec<_> = flight.iter().map(|(_, unit)| *unit).collect();
        assert_eq!(units[..2], [Unit::Page(0), Unit::Blob(BlobId::base(0))]);
        for asset in 0..20 {
            let base = units.iter().position(|u| *u == Unit::Blob(BlobId::base(asset))).unwrap();
            let page = units.iter().position(|u| *u == Unit::Page(asset / 8)).unwrap();
            assert!(page < base, "asset {asset}");
        }
    }

    #[test]
    fn coarsest_textures_of_large_assets_follow_their_base_mesh() {
        let mut scene = MemoryScene::new(20, 1, 2);
        Arc::get_mut(&mut scene).unwrap().texture_levels = 3;
        let view = scene.header.camera.view([1280, 720], 1.0);
        let textured_assets = |view: View| {
            let flight = flight(&scene, &view);
            let texture = |(at, (_, unit)): (usize, &(Priority, Unit))| match unit {
                Unit::Blob(id @ BlobId::Asset { asset, part: BlobPart::Texture { level, .. } }) => {
                    assert_eq!(*level, 0, "{id}");
                    // The flight is popped from its end, so the base mesh is sent first.
                    assert!(flight[at..].iter().any(|(_, unit)| *unit == Unit::Blob(BlobId::base(*asset))));
                    Some(*asset)
                }
                _ => None,
            };
            flight.iter().enumerate().filter_map(texture).collect::<Vec<_>>()
        };
        let large = textured_assets(view);
        assert!(large.contains(&0) && large.len() < 20, "{large:?}");
        let further = View { eye: view.eye.map(|x| 100.0 * x), ..view };
        assert_eq!(textured_assets(further), []);
    }

    #[test]
    fn coarsest_textures_are_bounded_in_bytes() {
        let mut scene = MemoryScene::new(40, 1, 2);
        Arc::get_mut(&mut scene).unwrap().texture_levels = 1;
        // A narrow field of view makes all assets large.
        let camera =
            Camera { eye: [0.0, 0.3, 4.0], target: [0.0, 0.3, 0.0], fov_y: 0.05, ..scene.header.camera };
        let flight = flight(&scene, &camera.view([1280, 720], 1.0));
        let blobs = flight.iter().rev().filter_map(|(_, unit)| match unit {
            Unit::Blob(id @ BlobId::Asset { asset, part }) => Some((id, *asset, part)),
            _ => None,
        });
        let of = |part: fn(&BlobPart) -> bool| blobs.clone().filter(move |(_, _, p)| part(p));
        let bases: Vec<u32> = of(|part| *part == BlobPart::Base).map(|(_, asset, _)| asset).collect();
        let textured: Vec<u32> = of(|part| *part != BlobPart::Base).map(|(_, asset, _)| asset).collect();
        assert_eq!(bases.len(), 40);
        // The textures of the most urgent base meshes.
        assert_eq!(textured, bases[..textured.len()]);
        let bytes: u32 =
            of(|part| *part != BlobPart::Base).map(|(id, _, _)| scene.blob_len(id).unwrap()).sum();
        assert!((MAX_TEXTURES_BYTES - 200..=MAX_TEXTURES_BYTES).contains(&bytes), "{bytes}");
    }
}
