//! The first cut through a scene's proxies for a view: what a client draws first.

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};

use super::scene_index::SceneIndex;
use lodestream_scene::description::AssetEntry;
use lodestream_scene::view::View;
use lodestream_select::difference::Picture;
use lodestream_select::{Bounds, Projection};

/// Most bytes of the base meshes of a first cut, unless the roots in view have more: a tenth of a second at 2 Mbit/s.
const FIRST_CUT_BYTES: u64 = 24 * 1024;

/// What is drawn first.
#[derive(Debug, Default)]
pub(super) struct FirstCut {
    /// Numbers of proxies in view.
    pub(super) proxies: Vec<u32>,
    /// By instance: whether a proxy stands for it. Empty without proxies.
    pub(super) covered: Vec<bool>,
}

impl FirstCut {
    /// Whether a proxy stands for an instance.
    pub(super) fn covers(&self, instance: u32) -> bool {
        self.covered.get(instance as usize).copied().unwrap_or_default()
    }
}

/// A proxy that may be replaced by what is below it.
#[derive(Debug, PartialEq)]
struct Candidate {
    /// Visible difference per byte.
    benefit: f32,
    proxy: u32,
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.benefit.total_cmp(&other.benefit).then(other.proxy.cmp(&self.proxy))
    }
}

/// A greedy cut: from the roots in view, the proxy whose replacement makes the largest difference per byte is replaced by
/// what is below it in view, as long as all base meshes take at most [`FIRST_CUT_BYTES`].
pub(super) fn first_cut(scene: &SceneIndex, view: &View) -> FirstCut {
    let proxies = scene.proxies();
    if proxies.is_empty() {
        return FirstCut::default();
    }
    let mut covered = vec![false; scene.instance_count()];
    let mut search = Search {
        scene,
        projection: Projection::new(view),
        picture: Picture::new(view),
        view,
        assets: BTreeSet::new(),
    };
    let (mut open, mut chosen, mut bytes) = (BinaryHeap::new(), BTreeSet::new(), 0);
    for &root in proxies.roots() {
        bytes += search.take_proxy(root, &mut open, &mut chosen);
        cover(&mut covered, scene, root, true);
    }
    while let Some(Candidate { proxy, .. }) = open.pop() {
        let Some(below) = search.below(proxy) else { continue };
        let own = scene.asset(proxies.nodes()[proxy as usize].proxy.asset).map_or(0, base_bytes);
        if (bytes + below.bytes).saturating_sub(own) > FIRST_CUT_BYTES {
            continue;
        }
        bytes -= own;
        chosen.remove(&proxy);
        cover(&mut covered, scene, proxy, false);
        for instance in below.instances {
            if let Some(asset) = scene.instance(instance).filter(|of| search.assets.insert(of.asset)) {
                bytes += scene.asset(asset.asset).map_or(0, base_bytes);
            }
        }
        for child in below.proxies {
            bytes += search.take_proxy(child, &mut open, &mut chosen);
            cover(&mut covered, scene, child, true);
        }
    }
    FirstCut { proxies: chosen.into_iter().collect(), covered }
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
struct Below {
    proxies: Vec<u32>,
    instances: Vec<u32>,
    bytes: u64,
}

struct Search<'a> {
    scene: &'a SceneIndex,
    projection: Projection,
    picture: Picture,
    view: &'a View,
    /// Assets of chosen instances: several instances have one base mesh.
    assets: BTreeSet<u32>,
}

impl Search<'_> {
    fn bounds(&self, proxy: u32) -> Option<(Bounds, &AssetEntry)> {
        let proxy = self.scene.proxies().nodes()[proxy as usize].proxy;
        let entry = self.scene.asset(proxy.asset)?;
        Some((self.projection.bounds_within(entry, proxy.error), entry))
    }

    /// Chooses a proxy if it is in view; returns its bytes.
    fn take_proxy(
        &mut self,
        number: u32,
        open: &mut BinaryHeap<Candidate>,
        chosen: &mut BTreeSet<u32>,
    ) -> u64 {
        let Some((bounds, entry)) = self.bounds(number).filter(|(bounds, _)| bounds.visible) else {
            return 0;
        };
        let bytes = base_bytes(entry);
        chosen.insert(number);
        let error = self.scene.proxies().nodes()[number as usize].proxy.error;
        #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
        let error_px = self.projection.error_px(f64::from(error), bounds.depth) as f32;
        if error_px > self.view.target_px {
            let difference_px2 = self.picture.shape_px2(error_px, bounds.coverage_px);
            let below = self.below(number).map_or(1, |below| below.bytes.max(1));
            #[expect(
                clippy::cast_precision_loss,
                reason = "an order needs no more of a length than 24 bits"
            )]
            open.push(Candidate { benefit: difference_px2 / below as f32, proxy: number });
        }
        bytes
    }

    /// What is below a proxy in view; `None` if not all of it is known.
    fn below(&self, number: u32) -> Option<Below> {
        let nodes = self.scene.proxies().nodes();
        let node = &nodes[number as usize];
        let mut below = Below { proxies: Vec::new(), instances: Vec::new(), bytes: 0 };
        let mut from = node.proxy.instances().start;
        let mut assets = BTreeSet::new();
        let mut add = |range: std::ops::Range<u32>, below: &mut Below| {
            for number in range {
                let instance = self.scene.instance(number)?;
                let entry = self.scene.asset(instance.asset)?;
                if self.projection.bounds(entry, instance).visible {
                    below.instances.push(number);
                    let is_new = !self.assets.contains(&instance.asset) && assets.insert(instance.asset);
                    below.bytes += if is_new { base_bytes(entry) } else { 0 };
                }
            }
            Some(())
        };
        for &child in &node.children {
            let of = nodes[child as usize].proxy.instances();
            add(from..of.start, &mut below)?;
            from = of.end;
            let (bounds, entry) = self.bounds(child)?;
            if bounds.visible {
                below.proxies.push(child);
                below.bytes += base_bytes(entry);
            }
        }
        add(from..node.proxy.instances().end, &mut below)?;
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
        assert!(bytes <= FIRST_CUT_BYTES && bytes > FIRST_CUT_BYTES / 4, "{bytes}");
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
