//! The first flight for a view: what of the scene comes in which order before anybody asked.

use std::cmp::Reverse;
use std::sync::Arc;

use crate::blob::BlobId;
use crate::scene::{AssetEntry, ScenePage};
use crate::scheduler::Unit;
use crate::select::Projection;
use crate::select::priority::{Priority, base_priority, refine_priority};
use crate::source::SceneSource;
use crate::view::View;

/// Square pixels a byte that pages without a visible instance count as: what is worth more comes first, but a camera that
/// turns should not wait for long. The demo's refinement falls below that after half a second at 2 Mbit/s.
const HIDDEN_PAGE_WORTH: f32 = 1.0;

/// The first flight for a view: scene pages and base meshes, least urgent first (so that the next is
/// popped from the end). Base meshes out of view are left to the client.
pub(super) fn first_flight(source: &dyn SceneSource, view: &View) -> Vec<(Priority, Unit)> {
    let projection = Projection::new(view);
    let pages = all_pages(source);
    let assets: Vec<(u32, &AssetEntry)> =
        pages.iter().flat_map(|page| page.assets.iter().map(|asset| (page.page, asset))).collect();
    let mut best = vec![0; assets.len()];
    let mut page_best = vec![0; pages.len()];
    for (page, best_on_page) in pages.iter().zip(&mut page_best) {
        for instance in &page.instances {
            let Some((_, asset)) = assets.get(instance.asset as usize) else { continue };
            let bounds = projection.bounds(asset, instance);
            if bounds.visible {
                let priority = base_priority(bounds.coverage_px, bounds.centrality);
                let best = &mut best[instance.asset as usize];
                *best = priority.max(*best);
                *best_on_page = priority.max(*best_on_page);
            }
        }
    }
    // A base mesh is of no use before the page that lists its asset.
    for (&(page, _), &priority) in assets.iter().zip(&best) {
        if let Some(best_on_page) = page_best.get_mut(page as usize) {
            *best_on_page = priority.max(*best_on_page);
        }
    }
    let hidden = refine_priority(HIDDEN_PAGE_WORTH, 1.0, 1.0);
    let of_pages = (0..).zip(&page_best).map(|(page, &priority)| (priority.max(hidden), Unit::Page(page)));
    let of_bases = (0..).zip(&best).filter(|(_, priority)| **priority > 0);
    let of_bases = of_bases.map(|(asset, &priority)| (priority, Unit::Blob(BlobId::base(asset))));
    let mut flight: Vec<_> = of_pages.chain(of_bases).collect();
    // Pages before base meshes, low numbers first, among equals.
    flight.sort_unstable_by_key(|&(priority, unit)| (priority, Reverse(unit)));
    flight
}

/// All pages of the description.
pub(super) fn all_pages(source: &dyn SceneSource) -> Vec<Arc<ScenePage>> {
    (0..source.header().page_count).map_while(|page| source.page(page)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::MemoryScene;

    #[test]
    fn the_largest_and_nearest_base_comes_first_and_behind_its_page() {
        let scene = MemoryScene::new(20, 1, 2);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let mut flight = first_flight(&*scene, &view);
        flight.reverse();
        let units: Vec<_> = flight.iter().map(|(_, unit)| *unit).collect();
        assert_eq!(units[..2], [Unit::Page(0), Unit::Blob(BlobId::base(0))]);
        for asset in 0..20 {
            let base = units.iter().position(|u| *u == Unit::Blob(BlobId::base(asset))).unwrap();
            let page = units.iter().position(|u| *u == Unit::Page(asset / 8)).unwrap();
            assert!(page < base, "asset {asset}");
        }
    }
}
