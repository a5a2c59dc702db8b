//! The first refinement for a view, which the server sends unasked behind the base meshes.

use std::cell::Cell;
use std::collections::{BTreeMap, HashMap};

use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};

use super::coarse_textures::coarse_textures;
use super::places::Places;
use crate::scheduler::Unit;
use crate::source::{Reading, SceneSource, SourceError};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::InstanceEntry;
use lodestream_scene::view::View;
use lodestream_select::priority::Priority;
use lodestream_select::{AssetState, Projection, SelectSettings, Selector, State, Wanted};

/// Most assets whose first refinement is pushed, the largest on the screen.
const MAX_REFINED_ASSETS: usize = 64;
/// Most index pages decoded for it.
pub(super) const MAX_REFINED_PAGES: usize = 64;
/// Most index pages named as missing at a time.
const MAX_MISSING: usize = 8;
/// One blob of the first refinement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Refining {
    pub(super) priority: Priority,
    pub(super) id: BlobId,
    /// How many of its bytes the view wants; `None` for all.
    pub(super) end: Option<u32>,
}

/// The first refinement for a view.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Refinement {
    /// Most urgent first.
    pub(super) pushed: Vec<Refining>,
    /// Whether another choice would come to the same: nothing could not be read, and no surface that hides something may
    /// be known later.
    pub(super) lasts: bool,
}

/// Index pages that have to be read before a refinement can be chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Missing(pub(super) Vec<BlobId>);

/// Gives an index page.
pub(super) type ReadPage<'a> = &'a dyn Fn(&BlobId) -> Result<Reading, SourceError>;

/// The first refinement for a view, most urgent first: index pages of what is visible and, by the same
/// selection as the client's, the first chunks and the coarsest levels of textures, until `budget_bytes` are used up.
///
/// The client takes over with its first `Want` of a chunk; until that arrives, a round trip after the
/// index pages, the link would lie idle.
///
/// `flight` is the first flight for the view. `read` gives index pages; where it has not all of them at hand, the missing ones are what comes back instead.
pub(super) fn first_refinement(
    (source, places): (&dyn SceneSource, &Places),
    view: &View,
    flight: &[(Priority, Unit)],
    budget_bytes: u64,
    read: ReadPage<'_>,
) -> Result<Refinement, Missing> {
    let (numbers, instances, mut assets) = visible_assets(source, places, view, flight);
    let failed = Cell::new(false);
    let read = |id: &BlobId| {
        let page = read(id);
        failed.set(failed.get() | page.is_err());
        page
    };
    let settings = SelectSettings { prefetch_bases: false, ..SelectSettings::default() };
    let mut selector = Selector::new(settings);
    let known = (&numbers[..], &instances[..], &mut assets[..]);
    let mut out = learn_pages(source, view, &mut selector, budget_bytes, &read, known)?;
    let visibility = selector.visibility(view, &instances, &assets);
    let mut textures = coarse_textures(source, view, &settings, visibility, (&numbers, &instances, &assets))
        .into_iter()
        .peekable();
    let mut left = budget_bytes - out.iter().map(|page| length(source, page)).sum::<u64>().min(budget_bytes);
    // Only now that the pages are known is it clear up to which stop each chunk is wanted.
    for wanted in &selector.select(view, &instances, &assets).wanted {
        let BlobId::Asset { asset, part: part @ BlobPart::Chunk(_) } = wanted.id else {
            // What ranks below a page not read must wait for it.
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
        let chunk = Refining { priority: wanted.priority, id, end: wanted.end };
        match left.checked_sub(length(source, &chunk)) {
            Some(rest) => left = rest,
            None => break,
        }
        if let Some(page) = out.iter_mut().find(|page| page.id == page_of(asset, part)) {
            // No chunk before its page.
            page.priority = page.priority.max(chunk.priority);
        }
        out.push(chunk);
    }
    // Stable, so pages stay before chunks that are as urgent.
    out.sort_by_key(|next| std::cmp::Reverse(next.priority));
    let lasts = !failed.get() && assets.iter().all(|asset| asset.occluder().is_some());
    Ok(Refinement { pushed: out, lasts })
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

fn length(source: &dyn SceneSource, next: &Refining) -> u64 {
    next.end.or_else(|| source.blob_len(&next.id)).map_or(u64::MAX, u64::from)
}

/// Reads the index pages that come within the budget if the chunks above them are sent too.
fn learn_pages(
    source: &dyn SceneSource,
    view: &View,
    selector: &mut Selector,
    budget_bytes: u64,
    read: ReadPage<'_>,
    (numbers, instances, assets): (&[u32], &[InstanceEntry], &mut [AssetState]),
) -> Result<Vec<Refining>, Missing> {
    let mut pages: Vec<Refining> = Vec::new();
    let mut sent = Vec::new();
    let mut missing = Vec::new();
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
            match read(&id) {
                Ok(Reading::Ready(bytes)) if learn(&bytes, page, asset).is_some() => {
                    left = rest;
                    pages.push(next);
                }
                // The others that are wanted now can be read at the same time.
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

/// Takes an index page into the state of its asset.
fn learn(bytes: &[u8], page: u32, asset: &mut AssetState) -> Option<()> {
    let first = page.checked_mul(u32::try_from(CHUNKS_PER_PAGE).ok()?)?;
    asset.add_index_page(page, decode_stated_page(bytes, first).ok()?).ok()
}

/// The assets that cover most of the screen: their numbers, their instances (with assets renumbered) that are in view, and
/// of each the largest on the screen, which decides how urgent its pages are; and states in which only the base is there.
fn visible_assets(
    source: &dyn SceneSource,
    places: &Places,
    view: &View,
    flight: &[(Priority, Unit)],
) -> (Vec<u32>, Vec<InstanceEntry>, Vec<AssetState>) {
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
        .filter_map(|&number| Some((number, places.asset(number)?)))
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
    let in_view = places.near(&projection).into_iter().map(|(number, _, instance)| (number, instance));
    let largest = numbers.iter().filter_map(|&asset| places.largest(asset, &projection));
    // By number: what hides what is found in that order.
    let placed: BTreeMap<u32, &InstanceEntry> =
        in_view.filter(|(_, instance)| local.contains_key(&instance.asset)).chain(largest).collect();
    let renumber =
        |instance: &&InstanceEntry| Some(InstanceEntry { asset: *local.get(&instance.asset)?, ..**instance });
    let instances = placed.values().filter_map(renumber).collect();
    (numbers, instances, assets)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::coarse_textures::COARSE_LEVELS;
    use crate::server::first_flight::first_flight;
    use crate::testing::MemoryScene;
    use std::collections::HashSet;

    fn refinement_for(scene: &MemoryScene, view: &View, budget: u64) -> Vec<Refining> {
        let places = Places::new(scene);
        let flight = first_flight(scene, &places, view);
        let chosen = first_refinement((scene, &places), view, &flight, budget, &|id| scene.try_read(id));
        chosen.unwrap().pushed
    }

    fn refinement(scene: &MemoryScene, budget: u64) -> Vec<Refining> {
        let view = scene.header.camera.view([1280, 720], 1.0);
        refinement_for(scene, &view, budget)
    }

    #[test]
    fn pages_that_are_not_at_hand_are_named_until_all_that_is_needed_is_there() {
        let scene = MemoryScene::new(3, 2, 5);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let here = std::cell::RefCell::new(HashSet::new());
        let places = Places::new(&*scene);
        let flight = first_flight(&*scene, &places, &view);
        let read = |id: &BlobId| {
            if here.borrow().contains(id) { scene.try_read(id) } else { Ok(Reading::Pending) }
        };
        for _ in 0..MAX_REFINED_PAGES {
            match first_refinement((&*scene, &places), &view, &flight, 64_000, &read) {
                Ok(chosen) => return assert_eq!(chosen.pushed, refinement(&scene, 64_000)),
                Err(Missing(pages)) => {
                    assert!((1..=MAX_MISSING).contains(&pages.len()));
                    assert!(pages.iter().all(|id| here.borrow_mut().insert(*id)), "named twice: {pages:?}");
                }
            }
        }
        panic!("never complete");
    }

    #[test]
    fn the_coarsest_levels_of_textures_come_among_the_first_chunks_of_what_is_large() {
        let mut scene = MemoryScene::new(3, 1, 5);
        std::sync::Arc::get_mut(&mut scene).unwrap().texture_levels = 4;
        for budget in [1000, 20_000, 64_000] {
            let bytes = |next: &Refining| u64::from(next.end.or(scene.blob_len(&next.id)).unwrap());
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
        // Far away the mean colour does.
        let far = View { eye: [0.0, 1.0, 4000.0], ..scene.header.camera.view([1280, 720], 1.0) };
        let pushed = refinement_for(&scene, &far, 64_000);
        assert!(pushed.iter().all(|next| !matches!(next.id.part(), Some(BlobPart::Texture { .. }))));
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
}
