//! The first flight for a view: what of the scene comes in which order before anybody asked.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::places::Places;
use crate::scheduler::Unit;
use crate::source::SceneSource;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::view::View;
use lodestream_select::Projection;
use lodestream_select::priority::{Priority, base_priority, refine_priority};

/// Square pixels a byte that pages without a visible instance count as: what is worth more comes first, but a camera that
/// turns should not wait for long. The demo's refinement falls below that after half a second at 2 Mbit/s.
const HIDDEN_PAGE_WORTH: f32 = 1.0;

/// Textures of an asset whose coarsest level comes with its base mesh, at most, and of so many bytes.
const MAX_TEXTURES: u16 = 4;
const MAX_TEXTURE_BYTES: u32 = 512;
/// Bytes of all such levels, at most: 16 ms at 2 Mbit/s, however much is large.
const MAX_TEXTURES_BYTES: u32 = 4096;
/// Least radius of an asset whose textures do, in heights of the picture: it is a quarter of the height across, and in
/// one mean colour far from what it becomes.
const LEAST_TEXTURED: f32 = 0.125;

/// The first flight for a view: scene pages, base meshes and, of what is large on the screen, the coarsest levels of
/// textures, least urgent first (so that the next is popped from the end). Base meshes out of view are left to the client.
pub(super) fn first_flight(source: &dyn SceneSource, places: &Places, view: &View) -> Vec<(Priority, Unit)> {
    let projection = Projection::new(view);
    let mut best = vec![0; places.assets().len()];
    let mut largest_px = vec![0.0_f32; best.len()];
    let mut page_best = vec![0; places.page_count()];
    for (_, page, instance) in places.near(&projection) {
        let Some(asset) = places.asset(instance.asset) else { continue };
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
    for ((page, _), &priority) in places.assets().zip(&best) {
        if let Some(best_on_page) = page_best.get_mut(page as usize) {
            *best_on_page = priority.max(*best_on_page);
        }
    }
    let hidden = refine_priority(HIDDEN_PAGE_WORTH, 1.0, 1.0);
    let of_pages = (0..).zip(&page_best).map(|(page, &priority)| (priority.max(hidden), Unit::Page(page)));
    let of_bases = (0..).zip(&best).filter(|(_, priority)| **priority > 0);
    let of_bases = of_bases.map(|(asset, &priority)| (priority, Unit::Blob(BlobId::base(asset))));
    #[expect(clippy::cast_precision_loss, reason = "a viewport has at most 65,535 rows")]
    let least_px = LEAST_TEXTURED * view.viewport_px[1] as f32;
    let of_textures = coarsest_textures(source, places, |asset| {
        best.get(asset).zip(largest_px.get(asset)).filter(|(_, px)| **px >= least_px).map(|(best, _)| *best)
    });
    let mut flight: Vec<_> = of_pages.chain(of_bases).chain(of_textures).collect();
    // Pages before base meshes before their textures, low numbers first, among equals.
    flight.sort_unstable_by_key(|&(priority, unit)| (priority, Reverse(unit)));
    flight
}

/// The coarsest level of the textures of each asset that `priority_of` gives a priority; of a shared one once. Of what
/// exceeds [`MAX_TEXTURES_BYTES`] the most urgent.
fn coarsest_textures(
    source: &dyn SceneSource,
    places: &Places,
    priority_of: impl Fn(usize) -> Option<Priority>,
) -> impl Iterator<Item = (Priority, Unit)> {
    let mut levels: BTreeMap<BlobId, (Priority, u32)> = BTreeMap::new();
    for (number, (_, entry)) in places.assets().enumerate() {
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
        first_flight(scene, &Places::new(scene), view)
    }

    #[test]
    fn the_largest_and_nearest_base_comes_first_and_behind_its_page() {
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
    fn the_coarsest_textures_of_what_is_large_come_with_its_base_mesh() {
        let mut scene = MemoryScene::new(20, 1, 2);
        Arc::get_mut(&mut scene).unwrap().texture_levels = 3;
        let view = scene.header.camera.view([1280, 720], 1.0);
        let near = |levels_of: View| {
            let flight = flight(&scene, &levels_of);
            let texture = |(at, (_, unit)): (usize, &(Priority, Unit))| match unit {
                Unit::Blob(id @ BlobId::Asset { asset, part: BlobPart::Texture { level, .. } }) => {
                    assert_eq!(*level, 0, "{id}");
                    // What is handed over before it, as the last comes first.
                    assert!(flight[at..].iter().any(|(_, unit)| *unit == Unit::Blob(BlobId::base(*asset))));
                    Some(*asset)
                }
                _ => None,
            };
            flight.iter().enumerate().filter_map(texture).collect::<Vec<_>>()
        };
        let large = near(view);
        assert!(large.contains(&0) && large.len() < 20, "{large:?}");
        let further = View { eye: view.eye.map(|x| 100.0 * x), ..view };
        assert_eq!(near(further), []);
    }

    #[test]
    fn however_much_is_large_its_coarsest_textures_are_few_bytes() {
        let mut scene = MemoryScene::new(40, 1, 2);
        Arc::get_mut(&mut scene).unwrap().texture_levels = 1;
        // Through a telescope everything is large.
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
        // Those of the most urgent base meshes.
        assert_eq!(textured, bases[..textured.len()]);
        let bytes: u32 =
            of(|part| *part != BlobPart::Base).map(|(id, _, _)| scene.blob_len(id).unwrap()).sum();
        assert!((MAX_TEXTURES_BYTES - 200..=MAX_TEXTURES_BYTES).contains(&bytes), "{bytes}");
    }
}
