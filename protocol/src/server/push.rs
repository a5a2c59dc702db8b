//! What the server sends unasked: the first flight for a view, and the first refinement behind it.

use std::collections::HashMap;
use std::sync::Arc;

use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_page};

use crate::blob::{BlobId, BlobPart};
use crate::scene::{AssetEntry, InstanceEntry, ScenePage};
use crate::scheduler::Unit;
use crate::select::priority::{base_priority, index_priority};
use crate::select::{AssetState, Priority, Projection, SelectSettings, Selector, State, Wanted};
use crate::source::SceneSource;
use crate::view::View;

/// Screen error as which pages without a visible instance count: what looks worse than this is refined
/// first, but a camera that turns should not wait for long.
const HIDDEN_PAGE_PX: f32 = 16.0;
/// Most assets whose first refinement is pushed, the largest on the screen.
const MAX_REFINED_ASSETS: usize = 64;
/// Most index pages decoded for it.
const MAX_REFINED_PAGES: usize = 64;

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
    let hidden = index_priority(HIDDEN_PAGE_PX);
    let of_pages = (0..).zip(&page_best).map(|(page, &priority)| (priority.max(hidden), Unit::Page(page)));
    let of_bases = (0..).zip(&best).filter(|(_, priority)| **priority > 0);
    let of_bases = of_bases.map(|(asset, &priority)| (priority, Unit::Blob(BlobId::base(asset))));
    let mut flight: Vec<_> = of_pages.chain(of_bases).collect();
    // Pages before base meshes, low numbers first, among equals.
    flight.sort_unstable_by_key(|&(priority, unit)| (priority, std::cmp::Reverse(unit)));
    flight
}

fn all_pages(source: &dyn SceneSource) -> Vec<Arc<ScenePage>> {
    (0..source.header().page_count).map_while(|page| source.page(page)).collect()
}

/// One blob of the first refinement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Refining {
    pub(super) priority: Priority,
    pub(super) id: BlobId,
    /// How many of its bytes the view wants; `None` for all.
    pub(super) end: Option<u32>,
}

/// The first refinement for a view, most urgent first: index pages of what is visible and, by the same
/// selection as the client's, the first chunks, until `budget_bytes` are used up.
///
/// The client takes over with its first `Want` of a chunk; until that arrives, a round trip after the
/// index pages, the link would lie idle.
pub(super) fn first_refinement(source: &dyn SceneSource, view: &View, budget_bytes: u64) -> Vec<Refining> {
    let (numbers, instances, mut assets) = visible_assets(source, view);
    let mut selector = Selector::new(SelectSettings { prefetch_bases: false, ..SelectSettings::default() });
    let mut out = learn_pages(source, view, &mut selector, budget_bytes, (&numbers, &instances, &mut assets));
    let mut left = budget_bytes - out.iter().map(|page| length(source, page)).sum::<u64>().min(budget_bytes);
    // Only now that the pages are known is it clear up to which stop each chunk is wanted.
    for wanted in &selector.select(view, &instances, &assets).wanted {
        let BlobId::Asset { asset, part: part @ BlobPart::Chunk(_) } = wanted.id else {
            // What ranks below a page not read must wait for it.
            break;
        };
        let Some(&asset) = numbers.get(asset as usize) else { continue };
        let id = BlobId::Asset { asset, part };
        let chunk = Refining { priority: wanted.priority, id, end: wanted.end };
        match left.checked_sub(length(source, &chunk)) {
            Some(rest) => left = rest,
            None => break,
        }
        out.push(chunk);
    }
    out.sort_by_key(|next| std::cmp::Reverse(next.priority));
    out
}

fn length(source: &dyn SceneSource, next: &Refining) -> u64 {
    next.end.or_else(|| source.blob_len(&next.id)).map_or(u64::MAX, u64::from)
}

/// Reads the index pages that come within the budget if the chunks above them are sent too.
fn learn_pages(
    source: &dyn SceneSource,
    view: &View,
    selector: &mut Selector,
    budget_bytes: u64,
    (numbers, instances, assets): (&[u32], &[InstanceEntry], &mut [AssetState]),
) -> Vec<Refining> {
    let mut pages: Vec<Refining> = Vec::new();
    let mut sent = Vec::new();
    let mut left = budget_bytes;
    // Pages make chunks and further pages known; each turn of the loop uses up bytes or ends.
    'turns: loop {
        let mut progress = false;
        for wanted in selector.select(view, instances, assets).wanted.clone() {
            let Wanted { id: BlobId::Asset { asset: local, part }, priority, end, .. } = wanted else {
                continue;
            };
            let Some(&number) = numbers.get(local as usize) else { continue };
            let asset = &mut assets[local as usize];
            let id = BlobId::Asset { asset: number, part };
            let next = Refining { priority, id, end };
            let Some(rest) = left.checked_sub(length(source, &next)) else { break 'turns };
            progress = true;
            let BlobPart::IndexPage(page) = part else {
                left = rest;
                asset.set_state(part, State::Applied);
                sent.push((local, part));
                continue;
            };
            if pages.len() == MAX_REFINED_PAGES {
                break 'turns;
            }
            match learn(source, &id, page, asset) {
                Some(()) => {
                    left = rest;
                    pages.push(next);
                }
                None => asset.set_state(part, State::Failed),
            }
            break;
        }
        if !progress {
            break;
        }
    }
    for (asset, part) in sent {
        assets[asset as usize].set_state(part, State::Absent);
    }
    pages
}

/// Reads an index page into the state of its asset.
fn learn(source: &dyn SceneSource, id: &BlobId, page: u32, asset: &mut AssetState) -> Option<()> {
    let bytes = source.read(id).ok()?;
    let first = page.checked_mul(u32::try_from(CHUNKS_PER_PAGE).ok()?)?;
    asset.add_index_page(page, decode_page(&bytes, first).ok()?).ok()
}

/// The assets that cover most of the screen: their numbers, their instances (with assets renumbered) and
/// states in which only the base is there.
fn visible_assets(source: &dyn SceneSource, view: &View) -> (Vec<u32>, Vec<InstanceEntry>, Vec<AssetState>) {
    let flight = first_flight(source, view);
    let numbers: Vec<u32> = flight
        .iter()
        .rev()
        .filter_map(|(_, unit)| match unit {
            Unit::Blob(id) => id.asset(),
            Unit::Page(_) => None,
        })
        .take(MAX_REFINED_ASSETS)
        .collect();
    let local: HashMap<u32, u32> = numbers.iter().copied().zip(0..).collect();
    let pages = all_pages(source);
    let entries: Vec<&AssetEntry> = pages.iter().flat_map(|page| &page.assets).collect();
    let assets = numbers
        .iter()
        .filter_map(|&number| entries.get(number as usize))
        .map(|&entry| {
            let mut state = AssetState::new(entry.clone());
            state.set_state(BlobPart::Base, State::Applied);
            state
        })
        .collect();
    let instances = pages
        .iter()
        .flat_map(|page| &page.instances)
        .filter_map(|instance| local.get(&instance.asset).map(|&asset| InstanceEntry { asset, ..*instance }))
        .collect();
    (numbers, instances, assets)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::MemoryScene;
    use std::collections::HashSet;

    fn refinement(scene: &MemoryScene, budget: u64) -> Vec<Refining> {
        first_refinement(scene, &scene.header.camera.view([1280, 720], 1.0), budget)
    }

    #[test]
    fn the_first_refinement_keeps_to_its_budget_and_to_what_can_be_applied() {
        let scene = MemoryScene::new(3, 2, 5);
        for budget in [0, 1000, 20_000, 64_000, 400_000] {
            let pushed = refinement(&scene, budget);
            let (mut seen, mut whole) = (HashSet::new(), HashSet::new());
            let mut bytes = 0;
            for next in &pushed {
                let Refining { id, end, .. } = next;
                bytes += u64::from(end.unwrap_or(scene.blob_len(id).unwrap()));
                if let BlobId::Asset { asset, part: BlobPart::Chunk(chunk) } = *id {
                    let page = BlobId::index_page(asset, chunk / CHUNKS_PER_PAGE as u32);
                    assert!(seen.contains(&page), "{id} before its page");
                    for &parent in &scene.chunks[0][chunk as usize].parents {
                        let parent = BlobId::chunk(asset, parent);
                        assert!(seen.contains(&parent), "{id} before its parent");
                        assert!(whole.contains(&parent), "{id}, though its parent comes in part");
                    }
                }
                assert!(seen.insert(*id), "{id} twice");
                if end.is_none() {
                    whole.insert(*id);
                }
            }
            assert!(bytes <= budget && (budget < 20_000 || bytes * 4 > budget * 3), "{bytes} of {budget}");
        }
    }

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
