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
