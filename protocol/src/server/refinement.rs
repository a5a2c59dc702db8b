//! The first refinement for a view, which the server pushes after the base meshes.

use std::cell::Cell;
use std::collections::{BTreeMap, HashMap, HashSet};

use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};

use super::coarse_textures::coarse_textures;
use super::first_cut::first_cut;
use super::pushed_blob::PushedBlob;
use super::scene_index::SceneIndex;
use crate::scheduler::Unit;
use crate::source::{Reading, SceneSource, SourceError};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::Instance;
use lodestream_scene::view::View;
use lodestream_select::priority::Priority;
use lodestream_select::{AssetState, Projection, SelectSettings, Selector, State, Wanted};

/// Most assets whose first refinement is pushed: the largest on the screen.
const MAX_REFINED_ASSETS: usize = 64;
/// Most index pages decoded to choose it.
pub(super) const MAX_REFINED_PAGES: usize = 64;
/// Most index pages reported as missing at a time.
const MAX_MISSING: usize = 8;

/// The first refinement for a view.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Refinement {
    /// Most urgent first.
    pub(super) pushed: Vec<PushedBlob>,
    /// Whether a later call gives the same result: all pages were readable, and the occluders of all assets are known.
    pub(super) is_final: bool,
}

/// Index pages that must be read before the refinement can be chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Missing(pub(super) Vec<BlobId>);

/// Reads an index page.
pub(super) type ReadPage<'a> = &'a dyn Fn(&BlobId) -> Result<Reading, SourceError>;

/// Chooses the first refinement for a view, most urgent first: index pages of visible assets and, by the client's own
/// selection, the first chunks and coarsest texture levels, within `budget_bytes`.
///
/// Without it the link would be idle for a round trip, from the base meshes to the client's first `Want` of a chunk.
///
/// `flight` is the first flight for the view; `read` reads index pages.
///
/// # Errors
/// The index pages that `read` reports as pending.
pub(super) fn first_refinement(
    (source, index): (&dyn SceneSource, &SceneIndex),
    view: &View,
    flight: &[(Priority, Unit)],
    budget_bytes: u64,
    read: ReadPage<'_>,
) -> Result<Refinement, Missing> {
    let (numbers, instances, mut assets) = visible_assets(source, index, view, flight);
    let failed = Cell::new(false);
    let read = |id: &BlobId| {
        let page = read(id);
        failed.set(failed.get() | page.is_err());
        page
    };
    let settings = SelectSettings { prefetch_bases: false, ..SelectSettings::default() };
    let mut selector = Selector::new(settings);
    let visible = (&numbers[..], &instances[..], &mut assets[..]);
    let mut out = load_index_pages(source, view, &mut selector, budget_bytes, &read, visible)?;
    let visibility = selector.visibility(view, &instances, &assets);
    let mut textures = coarse_textures(source, view, &settings, visibility, (&numbers, &instances, &assets))
        .into_iter()
        .peekable();
    let mut left = budget_bytes - out.iter().map(|page| length(source, page)).sum::<u64>().min(budget_bytes);
    // The truncation points of chunks depend on the pages, so chunks are chosen after all pages are known.
    for wanted in &selector.select(view, &instances, &assets).wanted {
        let BlobId::Asset { asset, part: part @ BlobPart::Chunk(_) } = wanted.id else {
            // Units of lower priority wait for a page that is not read.
            break;
        };
        let Some(&asset) = numbers.get(asset as usize) else { continue };
        while let Some(level) = textures.next_if(|level| level.priority >= wanted.priority) {
            if let Some(rest) = left.checked_sub(length(source, &level)) {
                left = rest;
                out.push(level);
            }
        }
        let id = BlobId::Asset { asset, part };
        let chunk = PushedBlob { priority: wanted.priority, id, end: wanted.end };
        match left.checked_sub(length(source, &chunk)) {
            Some(rest) => left = rest,
            None => break,
        }
        if let Some(page) = out.iter_mut().find(|page| page.id == page_of(asset, part)) {
            // A page is sent before its chunks.
            page.priority = page.priority.max(chunk.priority);
        }
        out.push(chunk);
    }
    // A base mesh that replaces a part of a proxy is less urgent than what refines it, but comes first.
    let of_bases = base_priorities(flight);
    for next in &mut out {
        if let BlobId::Asset { asset, .. } = next.id
            && let Some(&base) = of_bases.get(&asset)
        {
            next.priority = next.priority.min(base.saturating_sub(1));
        }
    }
    // The sort is stable: pages stay before chunks of equal priority.
    out.sort_by_key(|next| std::cmp::Reverse(next.priority));
    let is_final = !failed.get() && assets.iter().all(|asset| asset.occluder().is_some());
    Ok(Refinement { pushed: out, is_final })
}

/// Priorities of base meshes by asset.
fn base_priorities(flight: &[(Priority, Unit)]) -> HashMap<u32, Priority> {
    let of_base = |&(priority, unit): &(Priority, Unit)| match unit {
        Unit::Blob(BlobId::Asset { asset, part: BlobPart::Base }) => Some((asset, priority)),
        Unit::Blob(_) | Unit::Page(_) => None,
    };
    flight.iter().filter_map(of_base).collect()
}

/// The index page that lists a chunk.
fn page_of(asset: u32, part: BlobPart) -> BlobId {
    match part {
        BlobPart::Chunk(chunk) => {
            BlobId::index_page(asset, chunk / u32::try_from(CHUNKS_PER_PAGE).unwrap_or(u32::MAX))
        }
        _ => BlobId::base(asset),
    }
}

fn length(source: &dyn SceneSource, next: &PushedBlob) -> u64 {
    next.end.or_else(|| source.blob_len(&next.id)).map_or(u64::MAX, u64::from)
}

/// Reads the index pages that are within the budget, counting the chunks of higher priority.
fn load_index_pages(
    source: &dyn SceneSource,
    view: &View,
    selector: &mut Selector,
    budget_bytes: u64,
    read: ReadPage<'_>,
    (numbers, instances, assets): (&[u32], &[Instance], &mut [AssetState]),
) -> Result<Vec<PushedBlob>, Missing> {
    let mut pages: Vec<PushedBlob> = Vec::new();
    let mut sent = Vec::new();
    let mut missing = Vec::new();
    let mut left = budget_bytes;
    // A page makes chunks and further pages selectable; each iteration uses bytes of the budget or is the last.
    'budget: loop {
        let mut progress = false;
        for wanted in selector.select(view, instances, assets).wanted.clone() {
            let Wanted { id: BlobId::Asset { asset: local, part }, priority, end, .. } = wanted else {
                continue;
            };
            let Some(&number) = numbers.get(local as usize) else { continue };
            let asset = &mut assets[local as usize];
            let id = BlobId::Asset { asset: number, part };
            let next = PushedBlob { priority, id, end };
            let Some(rest) = left.checked_sub(length(source, &next)) else { break 'budget };
            progress = true;
            let BlobPart::IndexPage(page) = part else {
                left = rest;
                asset.set_state(part, State::Applied);
                sent.push((local, part));
                continue;
            };
            if pages.len() == MAX_REFINED_PAGES {
                break 'budget;
            }
            match read(&id) {
                Ok(Reading::Ready(bytes)) if load_index_page(&bytes, page, asset).is_some() => {
                    left = rest;
                    pages.push(next);
                }
                // Other pages that are wanted now can be read at the same time.
                Ok(Reading::Pending) => {
                    missing.push(id);
                    continue;
                }
                Ok(Reading::Ready(_)) | Err(_) => asset.set_state(part, State::Failed),
            }
            break;
        }
        if !progress || !missing.is_empty() {
            break;
        }
    }
    if !missing.is_empty() {
        missing.truncate(MAX_MISSING);
        return Err(Missing(missing));
    }
    for (asset, part) in sent {
        assets[asset as usize].set_state(part, State::Absent);
    }
    Ok(pages)
}

/// Adds an index page to the state of its asset.
fn load_index_page(bytes: &[u8], page: u32, asset: &mut AssetState) -> Option<()> {
    let first = page.checked_mul(u32::try_from(CHUNKS_PER_PAGE).ok()?)?;
    asset.add_index_page(page, decode_stated_page(bytes, first).ok()?).ok()
}

/// The assets that cover most of the screen. Returns their numbers, their instances (with assets renumbered) and
/// states with only the base mesh applied. Instances are those in view and the largest one of each asset, which
/// decides the priority of its pages.
fn visible_assets(
    source: &dyn SceneSource,
    index: &SceneIndex,
    view: &View,
    flight: &[(Priority, Unit)],
) -> (Vec<u32>, Vec<Instance>, Vec<AssetState>) {
    let numbers: Vec<u32> = flight
        .iter()
        .rev()
        .filter_map(|(_, unit)| match unit {
            Unit::Blob(BlobId::Asset { asset, part: BlobPart::Base }) => Some(*asset),
            Unit::Blob(_) | Unit::Page(_) => None,
        })
        .take(MAX_REFINED_ASSETS)
        .collect();
    let local: HashMap<u32, u32> = numbers.iter().copied().zip(0..).collect();
    let assets = numbers
        .iter()
        .filter_map(|&number| Some((number, index.asset(number)?)))
        .map(|(number, entry)| {
            let mut state = AssetState::new(entry.clone());
            state.set_state(BlobPart::Base, State::Applied);
            if let Some(occluder) = source.occluder(number) {
                state.set_occluder(occluder);
            }
            state
        })
        .collect();
    let projection = Projection::new(view);
    let cut = first_cut(index, view);
    let in_view = index.near(&projection).into_iter().map(|(number, _, instance)| (number, instance));
    let largest = numbers.iter().filter_map(|&asset| index.largest(asset, &projection));
    let replacing: HashSet<u32> = cut.finer.iter().map(|(_, asset)| *asset).collect();
    // Ordered by number, as the occlusion test expects.
    let placed: BTreeMap<u32, &Instance> = in_view
        .chain(largest)
        .filter(|(number, instance)| {
            local.contains_key(&instance.asset)
                && (!cut.covers(*number) || replacing.contains(&instance.asset))
        })
        .collect();
    let renumber =
        |instance: &&Instance| Some(Instance { asset: *local.get(&instance.asset)?, ..**instance });
    // A proxy in view is a placed asset like others, unless the client will replace it as it is.
    let proxies = cut.proxies.iter().filter_map(|&proxy| {
        let proxy = index.proxies().nodes()[proxy as usize].proxy;
        let depth = projection.bounds_within(index.asset(proxy.asset)?, proxy.error).depth;
        let stays = projection.error_px(f64::from(proxy.error), depth) <= f64::from(view.target_px);
        stays.then_some(Instance::at(*local.get(&proxy.asset)?, [0.0; 3]))
    });
    let instances = placed.values().filter_map(renumber).chain(proxies).collect();
    (numbers, instances, assets)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::coarse_textures::COARSE_LEVELS;
    use crate::server::first_flight::first_flight;
    use crate::testing::MemoryScene;

    fn refinement_for(scene: &MemoryScene, view: &View, budget: u64) -> Vec<PushedBlob> {
        let index = SceneIndex::new(scene);
        let flight = first_flight(scene, &index, view);
        let chosen = first_refinement((scene, &index), view, &flight, budget, &|id| scene.try_read(id));
        chosen.unwrap().pushed
    }

    fn refinement(scene: &MemoryScene, budget: u64) -> Vec<PushedBlob> {
        let view = scene.header.camera.view([1280, 720], 1.0);
        refinement_for(scene, &view, budget)
    }

    #[test]
    fn pending_pages_are_reported_once_each() {
        let scene = MemoryScene::new(3, 2, 5);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let here = std::cell::RefCell::new(HashSet::new());
        let index = SceneIndex::new(&*scene);
        let flight = first_flight(&*scene, &index, &view);
        let read = |id: &BlobId| {
            if here.borrow().contains(id) { scene.try_read(id) } else { Ok(Reading::Pending) }
        };
        for _ in 0..MAX_REFINED_PAGES {
            match first_refinement((&*scene, &index), &view, &flight, 64_000, &read) {
                Ok(chosen) => return assert_eq!(chosen.pushed, refinement(&scene, 64_000)),
                Err(Missing(pages)) => {
                    assert!((1..=MAX_MISSING).contains(&pages.len()));
                    assert!(
                        pages.iter().all(|id| here.borrow_mut().insert(*id)),
                        "reported twice: {pages:?}"
                    );
                }
            }
        }
        panic!("never complete");
    }

    #[test]
    fn what_refines_a_base_mesh_comes_after_it() {
        let scene = MemoryScene::with_proxies();
        let view = scene.header.camera.view([1280, 720], 1.0);
        let index = SceneIndex::new(&*scene);
        let bases = base_priorities(&first_flight(&*scene, &index, &view));
        let refinement = refinement(&scene, 1 << 20);
        assert!(refinement.is_sorted_by(|a, b| a.priority >= b.priority));
        let cut = first_cut(&index, &view);
        let later: Vec<u32> = cut.finer.iter().map(|(_, asset)| *asset).collect();
        let mut refined = 0;
        for next in &refinement {
            let BlobId::Asset { asset, .. } = next.id else { continue };
            assert!(next.priority < bases[&asset], "{next:?}");
            refined += usize::from(later.contains(&asset));
        }
        assert!(refined > 0, "{later:?}: {refinement:?}");
    }

    #[test]
    fn coarse_textures_of_large_assets_come_among_the_first_chunks() {
        let mut scene = MemoryScene::new(3, 1, 5);
        std::sync::Arc::get_mut(&mut scene).unwrap().texture_levels = 4;
        for budget in [1000, 20_000, 64_000] {
            let bytes = |next: &PushedBlob| u64::from(next.end.or(scene.blob_len(&next.id)).unwrap());
            assert!(refinement(&scene, budget).iter().map(bytes).sum::<u64>() <= budget);
        }
        let pushed = refinement(&scene, 64_000);
        let levels: Vec<_> = pushed
            .iter()
            .filter_map(|next| match next.id {
                BlobId::Asset { asset, part: BlobPart::Texture { texture: 0, level } } => {
                    Some((asset, level))
                }
                _ => None,
            })
            .collect();
        assert!(levels.contains(&(0, 0)) && levels.contains(&(0, 1)), "{levels:?}");
        assert!(levels.iter().all(|&(_, level)| level < COARSE_LEVELS), "{levels:?}");
        let place = |id| pushed.iter().position(|next| next.id == id).unwrap_or(usize::MAX);
        assert!(place(BlobId::texture(0, 0, 0)) < place(BlobId::texture(0, 0, 1)));
        let chunks = pushed.iter().filter(|next| matches!(next.id.part(), Some(BlobPart::Chunk(_))));
        assert!(chunks.count() > 10);
        assert!(place(BlobId::texture(0, 0, 0)) < pushed.len() / 2, "{pushed:?}");
        // Of a distant asset no texture is pushed.
        let far = View { eye: [0.0, 1.0, 4000.0], ..scene.header.camera.view([1280, 720], 1.0) };
        let pushed = refinement_for(&scene, &far, 64_000);
        assert!(pushed.iter().all(|next| !matches!(next.id.part(), Some(BlobPart::Texture { .. }))));
    }

    #[test]
    fn refinement_keeps_to_its_budget_and_can_be_applied_in_order() {
        let scene = MemoryScene::new(3, 2, 5);
        for budget in [0, 1000, 20_000, 64_000, 400_000] {
            let pushed = refinement(&scene, budget);
            let (mut seen, mut whole) = (HashSet::new(), HashSet::new());
            let mut bytes = 0;
            for next in &pushed {
                let PushedBlob { id, end, .. } = next;
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
}
