//! The cut through the forest of proxies: which proxies are drawn instead of their instances.
//!
//! A proxy is *opened*, that is, replaced by its children, while its error is larger on the screen than the threshold. What
//! of them cannot be drawn yet, it stands for still: its instances are its parts, and it is drawn without those that are
//! drawn otherwise. A proxy whose mesh has not arrived is open, too: its instances may be there from another view.

mod finer;

use glam::DVec3;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::AssetEntry;
use lodestream_scene::description::Instance;
use lodestream_scene::proxy::{Cut, PartialProxy, Proxies};

use crate::difference::Picture;
use crate::priority::{Priority, base_priority, prefetch_priority};
use crate::project::Projection;
use crate::root_error::{RootError, middle};
use crate::selection::{State, Wanted};
use crate::state::AssetState;

pub use finer::{Finer, Forest, Placed, finer};

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

/// How many times the error of a root something may have that replaces it, since it has textures. With 1 a city of 1,000
/// parts has three times the image error after 1 s, with 1.35 one of 10,000 a fifth more at the first frame.
const HOLD: f32 = 1.2;

/// In [`CutSelector::cover`].
const NO_PROXY: u32 = u32::MAX;

/// Finds the cut of each view. Keeps which proxies are open, for hysteresis.
#[derive(Clone, Debug, Default)]
pub(crate) struct CutSelector {
    cut: Cut,
    open: Vec<bool>,
    seen: Vec<Seen>,
    /// Proxies that are drawn until what replaces them has arrived.
    waiting: Vec<bool>,
    /// By instance: one more than the proxy that stands for it, [`NO_PROXY`] if none does but it is not drawn, else 0.
    cover: Vec<u32>,
    /// Proxies in view of which nothing can be drawn.
    missing: u32,
    /// Instances that are drawn themselves wherever they are in view, ascending.
    pinned: Vec<u32>,
    /// Those that are drawn themselves in any case, since parts of them are elsewhere; ascending.
    moved: Vec<u32>,
    /// Errors of the roots, if they are made for the start camera.
    root_error: Option<RootError>,
    /// What has a base mesh but is not drawn, since a root looks better yet.
    held: Vec<Placed>,
    /// How many of these there are, and proxies that are not refined and look worse than a root.
    held_count: usize,
    /// By instance and by proxy: whether it has once been as fine as the root that stood for it.
    is_fine: [Vec<bool>; 2],
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
    /// Whether a proxy is replaced piece by piece.
    pub(crate) partial: bool,
}

impl CutSelector {
    /// Sets the instances that are drawn themselves wherever they are in view.
    pub(crate) fn pin(&mut self, instances: &[u32]) {
        self.pinned = instances.to_vec();
        self.pinned.sort_unstable();
    }

    /// Sets the errors of the roots, if they are made for the start camera.
    pub(crate) const fn set_root_error(&mut self, error: Option<RootError>) {
        self.root_error = error;
    }

    /// What has a base mesh but is not drawn, since a root looks better yet.
    pub(crate) fn held(&self) -> &[Placed] {
        &self.held
    }

    /// Largest error in pixels with which something in a sphere replaces a root.
    pub(crate) fn hold_px(&self, projection: &Projection, center: DVec3, radius: f32) -> f32 {
        let error = self.root_error.as_ref().map(|of| of.error(projection.eye(), center.to_array(), radius));
        error.map_or(f32::INFINITY, |error| {
            let relative = (center - DVec3::from(projection.eye())).as_vec3();
            HOLD * error * projection.length_px(1.0, relative, radius)
        })
    }

    /// Marks something as fine enough to replace a root.
    pub(crate) fn set_fine(&mut self, placed: Placed) {
        let (of, number) = match placed {
            Placed::Instance(number) => (0, number as usize),
            Placed::Proxy(number) => (1, number as usize),
        };
        let marks = &mut self.is_fine[of];
        marks.resize(marks.len().max(number + 1), false);
        marks[number] = true;
    }

    /// Marks all that is held.
    pub(crate) fn set_all_fine(&mut self) {
        for placed in std::mem::take(&mut self.held) {
            self.set_fine(placed);
        }
    }

    fn is_fine(&self, placed: Placed) -> bool {
        let (of, number) = match placed {
            Placed::Instance(number) => (0, number as usize),
            Placed::Proxy(number) => (1, number as usize),
        };
        self.is_fine[of].get(number).copied().unwrap_or_default()
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
        *self = Self { pinned, moved, root_error: self.root_error, ..Self::default() };
    }

    /// Whether a proxy stands for an instance.
    pub(crate) fn covers(&self, instance: u32) -> bool {
        self.cover.get(instance as usize).is_some_and(|by| *by != 0)
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
        self.cover.clear();
        // Proxies come before the instances that they stand for.
        let end = scene
            .proxies
            .roots()
            .last()
            .map_or(0, |&root| scene.proxies.nodes()[root as usize].proxy.instances().end);
        self.cover.resize(scene.instances.len().max(end as usize), 0);
        (self.cut, self.missing) = (Cut::default(), 0);
        (self.held, self.held_count) = (Vec::new(), 0);
        let mut pass = Pass { state: self, projection, picture, scene, settings };
        for &root in scene.proxies.roots() {
            pass.look_at(root);
        }
        let mut list = Vec::new();
        for &root in scene.proxies.roots() {
            pass.draw(root, None, &mut list);
        }
        pass.want_finer(&mut list);
        // An asset of several instances is wanted once, for the most urgent of them.
        list.sort_unstable_by_key(|&(priority, asset)| (asset, std::cmp::Reverse(priority)));
        list.dedup_by_key(|(_, asset)| *asset);
        for (priority, asset) in list {
            if let Some(of) = scene.assets.get(asset as usize) {
                let bytes = of.blob_bytes(BlobPart::Base);
                wanted.push(Wanted::whole(BlobId::base(asset), priority, bytes, of.state(BlobPart::Base)));
            }
        }
        self.cut.covered = runs(self.cover.iter().take(scene.instances.len()).map(|by| *by != 0));
        self.cut.instances = u32::try_from(scene.instances.len()).unwrap_or(u32::MAX);
        self.list_proxies(scene.proxies);
    }

    /// Lists the proxies that stand for anything, and for what they do not.
    fn list_proxies(&mut self, proxies: &Proxies) {
        let mut drawn: Vec<u32> =
            self.cover.iter().filter(|by| ![0, NO_PROXY].contains(by)).map(|by| by - 1).collect();
        drawn.sort_unstable();
        drawn.dedup();
        for &proxy in &drawn {
            let of = proxies.nodes()[proxy as usize].proxy.instances();
            let [first, end] = [of.start, of.end].map(|at| (at as usize).min(self.cover.len()));
            let hidden = runs(self.cover[first..end].iter().map(|by| *by != proxy + 1));
            if !hidden.is_empty() {
                self.cut.partial.push(PartialProxy { proxy, hidden });
            }
        }
        self.cut.proxies = drawn;
    }
}

/// Whether one of some ascending numbers is within a range.
fn any_within(numbers: &[u32], range: std::ops::Range<u32>) -> bool {
    numbers.get(numbers.partition_point(|&number| number < range.start)).is_some_and(|at| *at < range.end)
}

/// Runs of true values, as first and end.
fn runs(flags: impl Iterator<Item = bool>) -> Vec<[u32; 2]> {
    let mut runs: Vec<[u32; 2]> = Vec::new();
    for (number, _) in (0_u32..).zip(flags).filter(|(_, flag)| *flag) {
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

    /// Adds a proxy or what is below it to the cut. `above` is the proxy that stands for what cannot be drawn otherwise.
    /// Lists what a cut needs where there is none.
    fn draw(&mut self, number: u32, above: Option<u32>, list: &mut Vec<(Priority, u32)>) {
        let node = &self.scene.proxies.nodes()[number as usize];
        let (seen, base) = (self.state.seen[number as usize], self.base(node.proxy.asset));
        let is_there = base == State::Applied;
        let is_open = self.state.open[number as usize];
        let may_hold = above.is_some() && self.may_hold();
        if is_open && !may_hold && !self.holds_below(number, list) {
            self.cover(node.proxy.instances(), 0);
            for &child in &node.children {
                self.draw(child, None, list);
            }
            let is_known = node.children.len() == node.proxy.child_count as usize
                && self
                    .own_instances(number)
                    .last()
                    .is_none_or(|last| (last as usize) < self.scene.instances.len());
            self.state.missing += u32::from(seen.visible && !is_known);
            return;
        }
        let is_better = is_there && !self.holds_proxy(number, above);
        let Some(by) = is_better.then_some(number).or(above) else {
            return self.draw_missing(number, list);
        };
        self.cover(node.proxy.instances(), by + 1);
        if !(seen.must_open || is_open && may_hold) {
            return;
        }
        if is_better && seen.visible {
            self.state.waiting[number as usize] = true;
        }
        if self.settings.partial {
            self.draw_below(number, by, list);
        }
    }

    /// Adds what is below a proxy to the cut, where `by` stands for what cannot be drawn.
    fn draw_below(&mut self, number: u32, by: u32, list: &mut Vec<(Priority, u32)>) {
        for &child in &self.scene.proxies.nodes()[number as usize].children {
            self.draw(child, Some(by), list);
        }
        for instance in self.own_instances(number) {
            if self.can_draw(instance) && !self.holds_instance(instance) {
                self.cover(instance..instance.saturating_add(1), 0);
            }
        }
    }

    /// For a root of which all in view can be drawn otherwise: whether it looks better yet than some of that. Adds it to the
    /// cut then.
    fn holds_below(&mut self, number: u32, list: &mut Vec<(Priority, u32)>) -> bool {
        let node = &self.scene.proxies.nodes()[number as usize];
        if !self.is_start_root(number) || self.base(node.proxy.asset) != State::Applied {
            return false;
        }
        let before = self.state.held_count;
        self.cover(node.proxy.instances(), number + 1);
        self.draw_below(number, number, list);
        let holds = self.state.held_count > before;
        self.state.waiting[number as usize] = holds && self.state.seen[number as usize].visible;
        holds
    }

    /// Whether what has arrived may wait until it is as fine as a root.
    const fn may_hold(&self) -> bool {
        self.settings.partial && self.state.root_error.is_some()
    }

    /// Whether a proxy is a root that is made for the start camera, and may be replaced piece by piece.
    fn is_start_root(&self, number: u32) -> bool {
        self.may_hold() && self.scene.proxies.nodes()[number as usize].proxy.parent().is_none()
    }

    /// Whether a root looks better than a proxy below it whose mesh is there.
    fn holds_proxy(&mut self, number: u32, above: Option<u32>) -> bool {
        let seen = self.state.seen[number as usize];
        if !seen.visible || above.is_none() || !self.may_hold() {
            return false;
        }
        let proxy = &self.scene.proxies.nodes()[number as usize].proxy;
        let Some(asset) = self.scene.assets.get(proxy.asset as usize) else { return false };
        let entry = asset.entry();
        let center = middle(entry.origin, entry.sphere.center);
        if seen.must_open {
            // It is not refined, so its error stays.
            let limit = self.state.hold_px(self.projection, center, entry.sphere.radius);
            let relative = (center - DVec3::from(self.projection.eye())).as_vec3();
            let error_px = (proxy.error + entry.root_error)
                * self.projection.length_px(1.0, relative, entry.sphere.radius);
            let holds = error_px > limit;
            // Where all below it can be drawn, it is not needed.
            self.state.held_count += usize::from(holds && !self.state.open[number as usize]);
            return holds;
        }
        self.holds(Placed::Proxy(number))
    }

    /// Whether a root looks better than an instance whose base mesh is there.
    fn holds_instance(&mut self, number: u32) -> bool {
        let of = self.scene.instances.get(number as usize);
        self.may_hold()
            && of.is_some_and(|of| self.is_in_view(of))
            && !any_within(&self.state.moved, number..number.saturating_add(1))
            && !any_within(&self.state.pinned, number..number.saturating_add(1))
            && self.holds(Placed::Instance(number))
    }

    fn holds(&mut self, placed: Placed) -> bool {
        let holds = !self.state.is_fine(placed);
        if holds {
            self.state.held.push(placed);
            self.state.held_count += 1;
        }
        holds
    }

    /// Adds what has arrived of a proxy that has not, with none above it; lists its base mesh.
    fn draw_missing(&mut self, number: u32, list: &mut Vec<(Priority, u32)>) {
        let node = &self.scene.proxies.nodes()[number as usize];
        let seen = self.state.seen[number as usize];
        let is_wanted = if seen.visible { !self.settings.awaits_push } else { self.settings.prefetch };
        if is_wanted {
            let priority = if seen.visible {
                base_priority(seen.coverage_px, seen.foveation)
            } else {
                prefetch_priority(seen.coverage_px)
            };
            list.push((priority, node.proxy.asset));
        }
        self.cover(node.proxy.instances(), NO_PROXY);
        // Nothing of it is drawn out of view, and its instances are not wanted.
        if seen.visible {
            self.state.missing += 1;
            self.draw_arrived(number);
        }
    }

    /// Draws what has arrived below a proxy that is missing; the rest is not wanted.
    fn draw_arrived(&mut self, number: u32) {
        let node = &self.scene.proxies.nodes()[number as usize];
        for &child in &node.children {
            let proxy = self.scene.proxies.nodes()[child as usize].proxy;
            if self.base(proxy.asset) == State::Applied && !self.state.open[child as usize] {
                self.cover(proxy.instances(), child + 1);
            } else {
                self.draw_arrived(child);
            }
        }
        for instance in self.own_instances(number) {
            if self.can_draw(instance) {
                self.cover(instance..instance.saturating_add(1), 0);
            }
        }
    }

    fn can_draw(&self, instance: u32) -> bool {
        let of = self.scene.instances.get(instance as usize);
        of.is_some_and(|of| self.base(of.asset) == State::Applied)
    }

    fn cover(&mut self, of: std::ops::Range<u32>, by: u32) {
        let known = self.state.cover.len();
        let [first, end] = [of.start, of.end].map(|at| (at as usize).min(known));
        self.state.cover[first..end].fill(by);
    }

    /// Lists the base meshes that make the cut finer.
    fn want_finer(&mut self, list: &mut Vec<(Priority, u32)>) {
        let waiting =
            (0_u32..).zip(&self.state.waiting).filter(|(_, waits)| **waits).map(|(number, _)| number);
        let finer = finer(&*self, self.projection, self.picture, waiting);
        list.extend(finer.iter().map(|finer| (finer.priority(), finer.asset)));
    }
}

impl Forest for Pass<'_> {
    fn proxies(&self) -> &Proxies {
        self.scene.proxies
    }

    fn instance(&self, number: u32) -> Option<&Instance> {
        self.scene.instances.get(number as usize)
    }

    fn entry(&self, asset: u32) -> Option<&AssetEntry> {
        self.scene.assets.get(asset as usize).map(AssetState::entry)
    }

    fn is_missing(&self, asset: u32) -> bool {
        matches!(self.base(asset), State::Absent | State::InFlight | State::Cached)
    }

    fn is_drawn(&self, proxy: u32) -> bool {
        let asset = self.scene.proxies.nodes()[proxy as usize].proxy.asset;
        let is_held = self.state.seen[proxy as usize].must_open && !self.state.waiting[proxy as usize];
        self.base(asset) == State::Applied && !is_held
    }

    fn error_within(&self, proxy: u32, center: [f64; 3], radius: f32) -> Option<f32> {
        let of = self.state.root_error.as_ref().filter(|_| self.is_start_root(proxy))?;
        Some(of.error_with_appearance(self.projection.eye(), center, radius))
    }

    fn must_open(&self, proxy: u32, _: f32) -> bool {
        self.state.seen[proxy as usize].must_open
    }
}
