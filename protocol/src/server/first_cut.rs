//! The first cut through a scene's proxies for a view: what a client draws first.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use super::scene_index::SceneIndex;
use lodestream_scene::description::AssetEntry;
use lodestream_scene::view::View;
use lodestream_select::cut::{OWN_SHARE, STEP_BYTES};
use lodestream_select::difference::Picture;
use lodestream_select::priority::{Priority, refine_priority};
use lodestream_select::{Bounds, Projection};

/// Most bytes of the base meshes and scene pages of a first cut, unless the roots in view have more: a tenth of a second at
/// 2 Mbit/s.
const FIRST_CUT_BYTES: u64 = 24 * 1024;

/// Most bytes of the base meshes that follow to make it finer: what a client requests when it has the first cut.
const FINER_BYTES: u64 = 64 * 1024;

/// What is drawn first, and what makes it finer.
#[derive(Debug, Default)]
pub(super) struct FirstCut {
    /// Numbers of proxies in view.
    pub(super) proxies: Vec<u32>,
    /// By instance: whether a proxy stands for it. Empty without proxies.
    pub(super) covered: Vec<bool>,
    /// The last page that a client needs to draw the cut: it numbers entries after those of the pages before.
    pub(super) last_page: u32,
    /// Assets whose base meshes replace proxies of the cut, as the client will want them.
    pub(super) finer: Vec<(Priority, u32)>,
    /// The last pages that list what replaces proxies of the cut, as urgent as that.
    pub(super) finer_pages: Vec<(Priority, u32)>,
}

impl FirstCut {
    /// Whether a proxy stands for an instance.
    pub(super) fn covers(&self, instance: u32) -> bool {
        self.covered.get(instance as usize).copied().unwrap_or_default()
    }
}

/// A proxy that may be replaced by what is below it, after the visible difference per byte of that; low numbers first among
/// equals.
type Candidate = (Priority, Reverse<u32>);

/// A greedy cut: from the roots in view, the proxy whose replacement makes the largest difference per byte is replaced by
/// what is below it in view, as long as base meshes and pages take at most [`FIRST_CUT_BYTES`]. The rest is listed in
/// [`FirstCut::finer`], up to [`FINER_BYTES`].
pub(super) fn first_cut(scene: &SceneIndex, view: &View) -> FirstCut {
    let proxies = scene.proxies();
    if proxies.is_empty() {
        return FirstCut::default();
    }
    let mut cut = FirstCut { covered: vec![false; scene.instance_count()], ..FirstCut::default() };
    let mut search = Search {
        scene,
        projection: Projection::new(view),
        picture: Picture::new(view),
        view,
        assets: BTreeSet::new(),
        open: BinaryHeap::new(),
    };
    let (mut chosen, mut bytes, mut later) = (BTreeSet::new(), 0, Vec::new());
    let take = |number: u32, search: &mut Search<'_>, cut: &mut FirstCut, chosen: &mut BTreeSet<u32>| {
        cover(&mut cut.covered, scene, number, true);
        let taken = search.take_proxy(number);
        chosen.extend(taken.map(|_| number));
        taken.unwrap_or_default()
    };
    for &root in proxies.roots() {
        bytes += take(root, &mut search, &mut cut, &mut chosen);
        cut.last_page = cut.last_page.max(scene.page_of_proxy(root).unwrap_or_default());
    }
    bytes += scene.bytes_to_page(cut.last_page);
    while let Some(candidate) = search.open.pop() {
        let (_, Reverse(proxy)) = candidate;
        let Some(below) = search.below(proxy) else { continue };
        let own = scene.asset(proxies.nodes()[proxy as usize].proxy.asset).map_or(0, base_bytes);
        let last_page = cut.last_page.max(below.last_page);
        let pages = scene.bytes_to_page(last_page) - scene.bytes_to_page(cut.last_page);
        if (bytes + below.bytes + pages).saturating_sub(own) > FIRST_CUT_BYTES {
            later.push(candidate);
            continue;
        }
        cut.last_page = last_page;
        bytes = bytes + pages - own;
        chosen.remove(&proxy);
        cover(&mut cut.covered, scene, proxy, false);
        bytes += below.instances.iter().map(|&instance| search.take_instance(instance)).sum::<u64>();
        for child in below.proxies {
            bytes += take(child, &mut search, &mut cut, &mut chosen);
        }
    }
    cut.proxies = chosen.into_iter().collect();
    search.open.extend(later);
    search.add_finer(&mut cut);
    cut
}

fn base_bytes(entry: &AssetEntry) -> u64 {
    u64::from(entry.base_bytes)
}

fn cover(covered: &mut [bool], scene: &SceneIndex, proxy: u32, value: bool) {
    let of = scene.proxies().nodes()[proxy as usize].proxy.instances();
    let [first, end] = [of.start, of.end].map(|at| (at as usize).min(covered.len()));
    covered[first..end].fill(value);
}

/// What replaces a proxy in view.
#[derive(Default)]
struct Below {
    proxies: Vec<u32>,
    instances: Vec<u32>,
    /// Bytes of base meshes.
    bytes: u64,
    /// The last page that lists any of it, in view or not.
    last_page: u32,
}

struct Search<'a> {
    scene: &'a SceneIndex,
    projection: Projection,
    picture: Picture,
    view: &'a View,
    /// Assets of chosen instances: several instances have one base mesh.
    assets: BTreeSet<u32>,
    /// Proxies that may be replaced.
    open: BinaryHeap<Candidate>,
}

impl Search<'_> {
    fn bounds(&self, proxy: u32) -> Option<(Bounds, &AssetEntry)> {
        let proxy = self.scene.proxies().nodes()[proxy as usize].proxy;
        let entry = self.scene.asset(proxy.asset)?;
        Some((self.projection.bounds_within(entry, proxy.error), entry))
    }

    /// Chooses a proxy if it is in view; returns its bytes.
    fn take_proxy(&mut self, number: u32) -> Option<u64> {
        let (bounds, entry) = self.bounds(number).filter(|(bounds, _)| bounds.visible)?;
        let bytes = base_bytes(entry);
        if let Some(priority) = self.priority(number, &bounds) {
            self.open.push((priority, Reverse(number)));
        }
        Some(bytes)
    }

    /// Chooses an instance; returns the bytes of its asset, if that is new.
    fn take_instance(&mut self, number: u32) -> u64 {
        let instance = self.scene.instance(number).filter(|of| self.assets.insert(of.asset));
        instance.and_then(|of| self.scene.asset(of.asset)).map_or(0, base_bytes)
    }

    /// Error of a proxy on the screen, if a client replaces it for that.
    fn error_px(&self, number: u32, bounds: &Bounds) -> Option<f32> {
        let error = self.scene.proxies().nodes()[number as usize].proxy.error;
        #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
        let error_px = self.projection.error_px(f64::from(error), bounds.depth) as f32;
        (error_px > OWN_SHARE * self.view.target_px).then_some(error_px)
    }

    /// Priority of what replaces a proxy; `None` if nothing has to.
    fn priority(&self, number: u32, bounds: &Bounds) -> Option<Priority> {
        let error_px = self.error_px(number, bounds)?;
        let difference_px2 = self.picture.shape_px2(error_px, bounds.coverage_px);
        #[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
        let bytes = self.below(number)?.bytes as f32;
        Some(refine_priority(difference_px2, bytes, bounds.foveation))
    }

    /// Adds base meshes that replace the proxies that are left: as a client requests them, those of the final cut below a
    /// proxy, or of its children if these are many.
    fn add_finer(&mut self, cut: &mut FirstCut) {
        let (mut bytes, mut least) = (0, Priority::MAX);
        while let Some((priority, Reverse(proxy))) = self.open.pop() {
            let mut last = Below::default();
            let is_known = self.add_final(proxy, &mut last).is_some();
            let (below, is_final) = match self.below(proxy) {
                _ if is_known && last.bytes <= STEP_BYTES => (last, true),
                Some(below) => (below, false),
                None => continue,
            };
            bytes += below.bytes;
            if bytes > FINER_BYTES {
                break;
            }
            // What is below a proxy comes after it.
            least = least.min(priority);
            cut.finer_pages.push((least, below.last_page));
            for child in below.proxies {
                cut.finer.push((least, self.scene.proxies().nodes()[child as usize].proxy.asset));
                if !is_final {
                    let _ = self.take_proxy(child);
                }
            }
            for instance in below.instances {
                if self.take_instance(instance) > 0
                    && let Some(of) = self.scene.instance(instance)
                {
                    cut.finer.push((least, of.asset));
                }
            }
        }
    }

    /// Adds the final cut below a proxy; `None` if not all of it is known.
    fn add_final(&self, number: u32, last: &mut Below) -> Option<()> {
        let below = self.below(number)?;
        last.last_page = last.last_page.max(below.last_page);
        last.instances.extend(below.instances);
        let instances: u64 = below.bytes;
        let mut proxies = 0;
        for child in below.proxies {
            let (bounds, entry) = self.bounds(child)?;
            proxies += base_bytes(entry);
            if self.error_px(child, &bounds).is_some() {
                self.add_final(child, last)?;
            } else {
                last.proxies.push(child);
                last.bytes += base_bytes(entry);
            }
        }
        last.bytes += instances - proxies;
        Some(())
    }

    /// What is below a proxy in view; `None` if not all of it is known.
    fn below(&self, number: u32) -> Option<Below> {
        let proxies = self.scene.proxies();
        let (mut below, mut assets) = (Below::default(), BTreeSet::new());
        for &child in &proxies.nodes()[number as usize].children {
            let (bounds, entry) = self.bounds(child)?;
            below.last_page = below.last_page.max(self.scene.page_of_proxy(child)?);
            if bounds.visible {
                below.proxies.push(child);
                below.bytes += base_bytes(entry);
            }
        }
        for run in proxies.own_instances(number) {
            let last = run.end.checked_sub(1).and_then(|last| self.scene.page_of_instance(last));
            below.last_page = below.last_page.max(last.unwrap_or_default());
            for number in run {
                let instance = self.scene.instance(number)?;
                let entry = self.scene.asset(instance.asset)?;
                if self.projection.bounds(entry, instance).visible {
                    below.instances.push(number);
                    let is_new = !self.assets.contains(&instance.asset) && assets.insert(instance.asset);
                    below.bytes += if is_new { base_bytes(entry) } else { 0 };
                }
            }
        }
        Some(below)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::scheduler::Unit;
    use crate::server::first_flight::first_flight;
    use crate::testing::MemoryScene;
    use lodestream_scene::blob::{BlobId, BlobPart};
    use lodestream_scene::proxy::Proxy;

    /// 32 planes behind each other; a root, four children, and four of each.
    fn scene() -> Arc<MemoryScene> {
        let mut scene = MemoryScene::new(32, 1, 2);
        let of = |parent: u32, first_instance, instance_count, child_count, error| Proxy {
            asset: first_instance / 8,
            parent,
            first_instance,
            instance_count,
            child_count,
            error,
        };
        let root = of(0, 0, 32, 4, 4.0);
        let children = (0..4).map(|n| of(1, 8 * n, 8, 4, 1.0));
        let leaves = (0..16).map(|n| of(2 + n / 4, 2 * n, 2, 0, 0.25));
        let pages = &mut Arc::get_mut(&mut scene).unwrap().pages;
        // Their assets stand in the first page for simplicity: those of the first planes.
        let assets = pages[0].assets.len() as u32;
        let fits = |proxy: Proxy| Proxy { asset: proxy.asset.min(assets - 1), ..proxy };
        Arc::get_mut(&mut pages[0]).unwrap().proxies =
            [root].into_iter().chain(children).chain(leaves).map(fits).collect();
        scene
    }

    #[test]
    fn a_first_cut_shows_everything_within_its_bytes() {
        let scene = scene();
        let index = SceneIndex::new(&*scene);
        assert_eq!(index.proxies().len(), 21);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let cut = first_cut(&index, &view);
        assert!(!cut.proxies.is_empty() && cut.covered.iter().any(|covered| !covered), "{cut:?}");
        let mut assets: BTreeSet<u32> = BTreeSet::new();
        let mut bytes = 0;
        for &proxy in &cut.proxies {
            let proxy = index.proxies().nodes()[proxy as usize].proxy;
            assert!(proxy.instances().all(|instance| cut.covers(instance)), "{proxy:?} beside its instances");
            bytes += base_bytes(index.asset(proxy.asset).unwrap());
        }
        let projection = Projection::new(&view);
        for (number, _, instance) in index.near(&projection) {
            let stands = cut.proxies.iter().filter(|proxy| {
                index.proxies().nodes()[**proxy as usize].proxy.instances().contains(&number)
            });
            assert_eq!(stands.count(), usize::from(cut.covers(number)), "instance {number}");
            if !cut.covers(number) && assets.insert(instance.asset) {
                bytes += base_bytes(index.asset(instance.asset).unwrap());
            }
        }
        bytes += index.bytes_to_page(cut.last_page);
        assert!(bytes <= FIRST_CUT_BYTES && bytes > FIRST_CUT_BYTES / 4, "{bytes}");
        let own = (0..).zip(&cut.covered).filter(|(_, covered)| !**covered).map(|(number, _)| number);
        assert!(own.filter_map(|number| index.page_of_instance(number)).max() <= Some(cut.last_page));
        let finer = &cut.finer_pages;
        assert!(!finer.is_empty() && finer.is_sorted_by(|a, b| a.0 >= b.0), "{finer:?}");
    }

    #[test]
    fn the_first_flight_has_the_base_meshes_of_the_cut_only() {
        let scene = scene();
        let index = SceneIndex::new(&*scene);
        let far = View { eye: [0.0, 1.0, 40_000.0], ..scene.header.camera.view([1280, 720], 1.0) };
        assert_eq!(first_cut(&index, &far).proxies, [0]);
        let flight = first_flight(&*scene, &index, &far);
        let bases: Vec<_> = flight
            .iter()
            .filter_map(|(_, unit)| match unit {
                Unit::Blob(BlobId::Asset { asset, part: BlobPart::Base }) => Some(*asset),
                _ => None,
            })
            .collect();
        assert_eq!(bases, [0]);
        assert_eq!(flight.last().unwrap().1, Unit::Page(0), "the page with the root comes first");
    }
}
