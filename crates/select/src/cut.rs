//! The cut through the forest of proxies: which proxies are drawn instead of their instances.
//!
//! A proxy is *opened*, that is, replaced by its children at once, while its error is larger on the screen than the
//! threshold and all its children in view can be drawn. A proxy whose mesh has not arrived is open, too: its instances
//! may be there from another view.

use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::Instance;
use lodestream_scene::proxy::{Cut, Proxies};

use crate::difference::Picture;
use crate::priority::{Priority, base_priority, prefetch_priority, refine_priority};
use crate::project::Projection;
use crate::selection::{State, Wanted};
use crate::state::AssetState;

/// Bytes of base meshes up to which a proxy is replaced by the final cut below it; else first by its children.
pub const STEP_BYTES: u64 = 24 * 1024;

/// Share of the threshold that a proxy's finest mesh may err; its chunks have the rest.
pub const OWN_SHARE: f32 = 0.5;

/// What a scene consists of, for [`CutSelector::update`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct CutScene<'a> {
    pub(crate) proxies: &'a Proxies,
    pub(crate) instances: &'a [Instance],
    pub(crate) assets: &'a [AssetState],
}

/// How a view sees a proxy.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    visible: bool,
    /// Error of the proxy's finest mesh on the screen.
    error_px: f32,
    coverage_px: f32,
    foveation: f32,
    /// Its error is too large.
    must_open: bool,
    /// All of it that is in view can be drawn, by itself or by what is below it.
    can_draw: bool,
}

/// Finds the cut of each view. Keeps which proxies are open, for hysteresis.
#[derive(Clone, Debug, Default)]
pub(crate) struct CutSelector {
    cut: Cut,
    open: Vec<bool>,
    seen: Vec<Seen>,
    /// Proxies that are drawn until what replaces them has arrived.
    waiting: Vec<bool>,
    /// By instance: whether a proxy stands for it.
    covered: Vec<bool>,
    /// Proxies in view of which nothing can be drawn.
    missing: u32,
    /// Instances that are drawn themselves wherever they are in view, ascending.
    pinned: Vec<u32>,
    /// Those that are drawn themselves in any case, since parts of them are elsewhere; ascending.
    moved: Vec<u32>,
}

/// Settings of one update.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CutSettings {
    pub(crate) threshold_px: f32,
    /// An open proxy closes below this fraction of the threshold.
    pub(crate) close_below: f32,
    /// Whether meshes of proxies out of view are wanted, too.
    pub(crate) prefetch: bool,
    /// Whether the server still pushes a cut: then nothing is wanted where nothing can be drawn.
    pub(crate) awaits_push: bool,
}

impl CutSelector {
    /// Sets the instances that are drawn themselves wherever they are in view.
    pub(crate) fn pin(&mut self, instances: &[u32]) {
        self.pinned = instances.to_vec();
        self.pinned.sort_unstable();
    }

    /// Sets the instances that are drawn themselves in any case, ascending.
    pub(crate) fn set_moved(&mut self, instances: Vec<u32>) {
        self.moved = instances;
    }

    /// The last cut.
    pub(crate) const fn cut(&self) -> &Cut {
        &self.cut
    }

    /// The cut of a scene without proxies.
    pub(crate) fn clear(&mut self) {
        let (pinned, moved) = (std::mem::take(&mut self.pinned), std::mem::take(&mut self.moved));
        *self = Self { pinned, moved, ..Self::default() };
    }

    /// Whether a proxy stands for an instance.
    pub(crate) fn covers(&self, instance: u32) -> bool {
        self.covered.get(instance as usize).copied().unwrap_or_default()
    }

    /// Whether a drawn proxy waits for what replaces it, and so needs no refinement.
    pub(crate) fn waits(&self, proxy: u32) -> bool {
        self.waiting.get(proxy as usize).copied().unwrap_or_default()
    }

    /// Error of a proxy's finest mesh on the screen, in pixels.
    pub(crate) fn error_px(&self, proxy: u32) -> f32 {
        self.seen.get(proxy as usize).map_or(0.0, |seen| seen.error_px)
    }

    /// Proxies in view of which nothing can be drawn.
    pub(crate) const fn missing(&self) -> u32 {
        self.missing
    }

    /// Finds the cut of a view and adds the base meshes that a finer one needs to `wanted`. Cost: a sphere test for each
    /// proxy down to the cut, and one for each instance whose proxies are open.
    pub(crate) fn update(
        &mut self,
        projection: &Projection,
        picture: &Picture,
        scene: CutScene<'_>,
        settings: CutSettings,
        wanted: &mut Vec<Wanted>,
    ) {
        let count = scene.proxies.nodes().len();
        self.open.resize(count, false);
        self.seen.clear();
        self.seen.resize(count, Seen::default());
        self.waiting.clear();
        self.waiting.resize(count, false);
        self.covered.clear();
        self.covered.resize(scene.instances.len(), false);
        (self.cut, self.missing) = (Cut::default(), 0);
        let mut pass = Pass { state: self, projection, picture, scene, settings };
        for &root in scene.proxies.roots() {
            pass.look_at(root);
        }
        let mut list = Vec::new();
        for &root in scene.proxies.roots() {
            pass.draw(root, &mut list);
        }
        // An asset of several instances is wanted once, for the most urgent of them.
        list.sort_unstable_by_key(|&(priority, asset)| (asset, std::cmp::Reverse(priority)));
        list.dedup_by_key(|(_, asset)| *asset);
        for (priority, asset) in list {
            if let Some(of) = scene.assets.get(asset as usize) {
                let bytes = of.blob_bytes(BlobPart::Base);
                wanted.push(Wanted::whole(BlobId::base(asset), priority, bytes, of.state(BlobPart::Base)));
            }
        }
        self.cut.proxies.sort_unstable();
        self.cut.covered = runs(&self.covered);
        self.cut.instances = u32::try_from(self.covered.len()).unwrap_or(u32::MAX);
    }
}

/// Whether one of some ascending numbers is within a range.
fn any_within(numbers: &[u32], range: std::ops::Range<u32>) -> bool {
    numbers.get(numbers.partition_point(|&number| number < range.start)).is_some_and(|at| *at < range.end)
}

/// Runs of true values, as first and end.
fn runs(flags: &[bool]) -> Vec<[u32; 2]> {
    let mut runs: Vec<[u32; 2]> = Vec::new();
    for (number, _) in (0_u32..).zip(flags).filter(|(_, flag)| **flag) {
        match runs.last_mut() {
            Some([_, end]) if *end == number => *end += 1,
            _ => runs.push([number, number + 1]),
        }
    }
    runs
}

struct Pass<'a> {
    state: &'a mut CutSelector,
    projection: &'a Projection,
    picture: &'a Picture,
    scene: CutScene<'a>,
    settings: CutSettings,
}

impl Pass<'_> {
    fn base(&self, asset: u32) -> State {
        self.scene.assets.get(asset as usize).map_or(State::Absent, |asset| asset.state(BlobPart::Base))
    }

    fn is_in_view(&self, instance: &Instance) -> bool {
        let asset = self.scene.assets.get(instance.asset as usize);
        asset.is_some_and(|asset| self.projection.bounds(asset.entry(), instance).visible)
    }

    /// Looks at a proxy, and at what is below it as far as it may be drawn; returns whether all of it that is in view can
    /// be drawn.
    fn look_at(&mut self, number: u32) -> bool {
        let node = &self.scene.proxies.nodes()[number as usize];
        let Some(asset) = self.scene.assets.get(node.proxy.asset as usize) else { return false };
        let bounds = self.projection.bounds_within(asset.entry(), node.proxy.error);
        #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
        let error_px = self.projection.error_px(f64::from(node.proxy.error), bounds.depth) as f32;
        let was_open = self.state.open[number as usize];
        let limit =
            OWN_SHARE * self.settings.threshold_px * if was_open { self.settings.close_below } else { 1.0 };
        let base = asset.state(BlobPart::Base);
        let mut seen = Seen {
            visible: bounds.visible,
            error_px,
            coverage_px: bounds.coverage_px,
            foveation: bounds.foveation,
            must_open: any_within(&self.state.moved, node.proxy.instances())
                || if bounds.visible {
                    error_px > limit
                        || base == State::Failed
                        || any_within(&self.state.pinned, node.proxy.instances())
                } else {
                    was_open
                },
            can_draw: base == State::Applied,
        };
        if seen.must_open || base != State::Applied {
            let below = self.look_below(number);
            // Without a mesh of its own, what is below has to do.
            self.state.open[number as usize] = below || base == State::Failed;
            seen.can_draw |= below;
        } else {
            self.state.open[number as usize] = false;
        }
        // Nothing is lacking out of view.
        seen.can_draw |= !bounds.visible;
        self.state.seen[number as usize] = seen;
        seen.can_draw
    }

    /// Whether all children of a proxy are known, and those in view can be drawn.
    fn look_below(&mut self, number: u32) -> bool {
        let node = &self.scene.proxies.nodes()[number as usize];
        let mut all = node.children.len() == node.proxy.child_count as usize;
        for &child in &node.children {
            all &= self.look_at(child);
        }
        all && self.own_instances(number).all(|instance| {
            let of = self.scene.instances.get(instance as usize);
            // One that cannot be had must not keep all others coarse.
            let is_due = |of: &Instance| !matches!(self.base(of.asset), State::Applied | State::Failed);
            of.is_some_and(|of| !is_due(of) || !self.is_in_view(of))
        })
    }

    /// The instances of a proxy that no child stands for.
    fn own_instances(&self, number: u32) -> impl Iterator<Item = u32> + use<> {
        self.scene.proxies.own_instances(number).into_iter().flatten()
    }

    /// Adds a proxy or what is below it to the cut, and lists what a finer cut needs.
    fn draw(&mut self, number: u32, list: &mut Vec<(Priority, u32)>) {
        let node = &self.scene.proxies.nodes()[number as usize];
        let (seen, base) = (self.state.seen[number as usize], self.base(node.proxy.asset));
        if self.state.open[number as usize] {
            for &child in &node.children {
                self.draw(child, list);
            }
            let is_known = node.children.len() == node.proxy.child_count as usize
                && self
                    .own_instances(number)
                    .last()
                    .is_none_or(|last| (last as usize) < self.scene.instances.len());
            self.state.missing += u32::from(seen.visible && !is_known);
            return;
        }
        let of = node.proxy.instances();
        if base == State::Applied {
            self.cover(of);
            self.state.cut.proxies.push(number);
            if seen.visible && seen.must_open {
                self.state.waiting[number as usize] = true;
                self.want_finer(number, list);
            }
            return;
        }
        let is_wanted = if seen.visible { !self.settings.awaits_push } else { self.settings.prefetch };
        if is_wanted {
            let priority = if seen.visible {
                base_priority(seen.coverage_px, seen.foveation)
            } else {
                prefetch_priority(seen.coverage_px)
            };
            list.push((priority, node.proxy.asset));
        }
        if !seen.visible {
            // Nothing of it is drawn, and its instances are not wanted.
            return self.cover(of);
        }
        self.state.missing += 1;
        // What has arrived is drawn; the rest is not wanted.
        for &child in &node.children {
            self.draw_arrived(child);
        }
        for instance in self.own_instances(number) {
            self.cover_absent(instance);
        }
    }

    /// Draws what has arrived of a proxy that is missing.
    fn draw_arrived(&mut self, number: u32) {
        let node = &self.scene.proxies.nodes()[number as usize];
        if self.base(node.proxy.asset) == State::Applied && !self.state.open[number as usize] {
            self.state.cut.proxies.push(number);
            return self.cover(node.proxy.instances());
        }
        for &child in &node.children {
            self.draw_arrived(child);
        }
        for instance in self.own_instances(number) {
            self.cover_absent(instance);
        }
    }

    fn cover_absent(&mut self, instance: u32) {
        let of = self.scene.instances.get(instance as usize);
        if of.is_none_or(|of| self.base(of.asset) != State::Applied) {
            self.cover(instance..instance.saturating_add(1));
        }
    }

    fn cover(&mut self, of: std::ops::Range<u32>) {
        let known = self.state.covered.len();
        let [first, end] = [of.start, of.end].map(|at| (at as usize).min(known));
        self.state.covered[first..end].fill(true);
    }

    /// Lists the base meshes that replace a drawn proxy: those of the final cut below it, or of its children if these are
    /// many. They help only together, so that they have one priority.
    fn want_finer(&mut self, number: u32, list: &mut Vec<(Priority, u32)>) {
        let mut assets = Vec::new();
        self.missing_below(number, true, &mut assets);
        let bytes = |assets: &[u32]| -> u64 {
            let bytes = |asset: &u32| Some(self.scene.assets.get(*asset as usize)?.entry().base_bytes);
            assets.iter().filter_map(bytes).map(u64::from).sum()
        };
        if bytes(&assets) > STEP_BYTES {
            assets.clear();
            self.missing_below(number, false, &mut assets);
        }
        let seen = self.state.seen[number as usize];
        let difference_px2 = self.picture.shape_px2(seen.error_px, seen.coverage_px);
        #[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
        let priority = refine_priority(difference_px2, bytes(&assets) as f32, seen.foveation);
        list.extend(assets.into_iter().map(|asset| (priority, asset)));
    }

    /// Assets in view below a proxy whose base meshes have not arrived; with `all` those of the final cut.
    fn missing_below(&self, number: u32, all: bool, assets: &mut Vec<u32>) {
        let node = &self.scene.proxies.nodes()[number as usize];
        for &child in &node.children {
            let (seen, of) =
                (self.state.seen[child as usize], self.scene.proxies.nodes()[child as usize].proxy);
            if !seen.visible || (seen.can_draw && !(all && seen.must_open)) {
                continue;
            }
            if all && seen.must_open {
                self.missing_below(child, all, assets);
            } else {
                self.add_missing(of.asset, assets);
            }
        }
        for instance in self.own_instances(number) {
            if let Some(of) = self.scene.instances.get(instance as usize).filter(|of| self.is_in_view(of)) {
                self.add_missing(of.asset, assets);
            }
        }
    }

    fn add_missing(&self, asset: u32, assets: &mut Vec<u32>) {
        let is_missing = matches!(self.base(asset), State::Absent | State::InFlight | State::Cached);
        if is_missing && !assets.contains(&asset) {
            assets.push(asset);
        }
    }
}
