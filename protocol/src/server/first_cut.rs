//! The first cut through a scene's proxies for a view: what a client draws first.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

use super::scene_index::SceneIndex;
use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::proxy::Proxies;
use lodestream_scene::view::View;
use lodestream_select::cut::{Finer, Forest, OWN_SHARE, Placed, finer};
use lodestream_select::difference::Picture;
use lodestream_select::priority::{Priority, refine_priority};
use lodestream_select::{Bounds, Projection};

/// Most bytes of the base meshes and scene pages of a first cut, unless the roots in view have more: 65 ms at 2 Mbit/s. With
/// 24 KiB a city of 1,000 parts begins 0.1 s later, a level finer, and has twice the image error after 0.75 s.
const FIRST_CUT_BYTES: u64 = 16 * 1024;

/// Most bytes of the base meshes that follow to make it finer: what a client requests when it has the first cut. With 64 KiB
/// a city of 10,000 parts has a fifth more image error after 1.5 s.
const FINER_BYTES: u64 = 128 * 1024;

/// What is drawn first, and what makes it finer.
#[derive(Debug, Default)]
pub(super) struct FirstCut {
    /// Numbers of proxies in view.
    pub(super) proxies: Vec<u32>,
    /// By instance: whether a proxy stands for it. Empty without proxies.
    pub(super) covered: Vec<bool>,
    /// The last page that a client needs to draw the cut: it numbers entries after those of the pages before.
    pub(super) last_page: u32,
    /// Assets whose base meshes replace parts of the cut's proxies, as the client will want them.
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
        proxies: BTreeSet::new(),
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
    add_finer(&search, &mut cut);
    cut
}

/// Adds base meshes that make the cut finer, as a client requests them, most urgent first, and the pages that list them.
fn add_finer(search: &Search<'_>, cut: &mut FirstCut) {
    let drawn = search.open.iter().map(|(_, Reverse(proxy))| *proxy);
    let list = finer(search, &search.projection, &search.picture, drawn);
    let page_of = |finer: &Finer| match finer.first {
        Placed::Proxy(proxy) => search.scene.page_of_proxy(proxy),
        Placed::Instance(instance) => search.scene.page_of_instance(instance),
    };
    let with_page = list.into_iter().filter_map(|finer| Some((page_of(&finer)?.max(cut.last_page), finer)));
    let mut list: Vec<(u32, Finer)> = with_page.collect();
    list.sort_by_key(|(page, finer)| (*page, finer.asset));
    // A page is as urgent as the difference of what it lists, per byte of both. It is of no use before those before it, so
    // these and a page with more difference per byte have one priority (pool adjacent violators, Ayer et al. 1955).
    let mut pools: Vec<Pool> = Vec::new();
    let last_of_cut = cut.last_page;
    let later = list.partition_point(|(page, _)| *page <= last_of_cut);
    for of_page in list[later..].chunk_by(|(one, _), (other, _)| one == other) {
        let last_page = of_page[0].0;
        let before = pools.last().map_or(last_of_cut, |pool| pool.last_page);
        let page_bytes = search.scene.bytes_to_page(last_page) - search.scene.bytes_to_page(before);
        #[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
        let mut pool = Pool { last_page, difference_px2: 0.0, bytes: page_bytes as f32 };
        for (_, finer) in of_page {
            pool.add(finer.difference_px2(), finer.bytes());
        }
        while let Some(last) = pools.pop_if(|last| last.priority() < pool.priority()) {
            pool = Pool {
                last_page,
                difference_px2: last.difference_px2 + pool.difference_px2,
                bytes: last.bytes + pool.bytes,
            };
        }
        pools.push(pool);
    }
    let of_pool = |page: u32| pools[pools.partition_point(|pool| pool.last_page < page)].priority();
    let is_listed = |page: u32| page <= last_of_cut;
    let mut list: Vec<(Priority, u32, u32)> = list
        .into_iter()
        .map(|(page, finer)| {
            let own = finer.priority();
            (if is_listed(page) { own } else { own.min(of_pool(page)) }, finer.asset, finer.bytes())
        })
        .collect();
    list.sort_unstable_by_key(|&(priority, asset, _)| (Reverse(priority), asset));
    let mut bytes = 0;
    let within = list.into_iter().take_while(|(_, _, length)| {
        bytes += u64::from(*length);
        bytes <= FINER_BYTES
    });
    cut.finer = within.map(|(priority, asset, _)| (priority, asset)).collect();
    cut.finer_pages = pools.iter().map(|pool| (pool.priority(), pool.last_page)).collect();
}

/// Pages that are sent one after the other, and what they list.
struct Pool {
    last_page: u32,
    difference_px2: f32,
    bytes: f32,
}

impl Pool {
    #[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
    fn add(&mut self, difference_px2: f32, bytes: u32) {
        self.difference_px2 += difference_px2;
        self.bytes += bytes as f32;
    }

    fn priority(&self) -> Priority {
        refine_priority(self.difference_px2, self.bytes, 1.0)
    }
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
    /// Assets of chosen proxies.
    proxies: BTreeSet<u32>,
    /// Proxies that may be replaced.
    open: BinaryHeap<Candidate>,
}

impl Forest for Search<'_> {
    fn proxies(&self) -> &Proxies {
        self.scene.proxies()
    }

    fn instance(&self, number: u32) -> Option<&Instance> {
        self.scene.instance(number)
    }

    fn entry(&self, asset: u32) -> Option<&AssetEntry> {
        self.scene.asset(asset)
    }

    fn is_missing(&self, asset: u32) -> bool {
        !self.assets.contains(&asset) && !self.proxies.contains(&asset)
    }

    fn is_drawn(&self, proxy: u32) -> bool {
        self.proxies.contains(&self.scene.proxies().nodes()[proxy as usize].proxy.asset)
    }

    fn error_within(&self, proxy: u32, center: [f64; 3], radius: f32) -> Option<f32> {
        let is_root = self.scene.proxies().nodes()[proxy as usize].proxy.parent().is_none();
        let of = self.scene.root_error().filter(|_| is_root)?;
        Some(of.error_with_appearance(self.projection.eye(), center, radius))
    }

    fn must_open(&self, _: u32, error_px: f32) -> bool {
        error_px > OWN_SHARE * self.view.target_px
    }
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
        self.proxies.insert(self.scene.proxies().nodes()[number as usize].proxy.asset);
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
    use super::*;
    use crate::scheduler::Unit;
    use crate::server::first_flight::first_flight;
    use crate::testing::MemoryScene;
    use lodestream_scene::blob::{BlobId, BlobPart};

    #[test]
    fn a_first_cut_shows_everything_within_its_bytes() {
        let scene = MemoryScene::with_proxies();
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
        let scene = MemoryScene::with_proxies();
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
