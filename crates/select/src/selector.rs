//! The selector: one pass over instances and two over chunks.

mod bases;
mod chunks;
mod evaluate;
mod shadows;
mod threshold;
mod tiles;

use std::cmp::Reverse;

use glam::Vec3;

use super::cut::{CutScene, CutSelector, CutSettings};
use super::difference::{Picture, SubtreeBenefit};
use super::instance_tree::{IndexSet, Instances};
use super::priority::Priority;
use super::project::Projection;
use super::root_error::RootError;
use super::selection::{Counters, Selection, Wanted};
use super::settings::SelectSettings;
use super::state::{AssetState, Chunk};
use super::textures::{Textures, texels_in_use};
use super::tile_demand::TileDemand;
use super::visibility::Visibility;
use lodestream_scene::description::Instance;
use lodestream_scene::parts::PartTransform;
use lodestream_scene::proxy::Cut;
use lodestream_scene::view::View;

pub use evaluate::max_screen_error_px;

/// Selects the blobs that a view wants. Keeps its buffers and the hysteresis of the threshold between calls.
#[derive(Debug)]
pub struct Selector {
    settings: SelectSettings,
    selection: Selection,
    threshold_px: f32,
    /// Per asset.
    on_screen: Vec<AssetOnScreen>,
    /// Per chunk of all assets, one after the other.
    chunks: Vec<ChunkEvaluation>,
    /// Faces and payload bytes by bin of screen error.
    histogram: Vec<(u64, u64)>,
    visibility: Visibility,
    /// Per chunk of one instance: screen error and foveation if it is in view, …
    projected: Vec<Option<(f64, f32)>>,
    /// … and the visible share.
    shares: Vec<f32>,
    /// Instances projected by the last query of the hierarchy.
    nearby: IndexSet,
    /// Distance that the eye may move before requested blobs arrive.
    travel: f32,
    /// Unit vector towards the sun, if it shines.
    to_sun: Option<Vec3>,
    /// Wanted texture levels.
    textures: Textures,
    demand: TileDemand,
    cut: CutSelector,
    /// Whether the server still pushes base meshes.
    awaits_push: bool,
    /// What of the last cut may be in view.
    drawn: Vec<Drawn>,
    /// Instances, and where parts of them are moved to.
    moved: Vec<(u32, PartTransform)>,
}

/// An instance, or a proxy as one.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    instance: Instance,
    /// Its number, or that of the proxy.
    number: u32,
    is_proxy: bool,
    /// Whether it stands for parts of the instance that are moved.
    is_moved: bool,
    /// Whether a root is drawn instead, since it looks better yet.
    is_held: bool,
}

/// Maxima over the instances of an asset.
#[derive(Clone, Copy, Debug, Default)]
struct AssetOnScreen {
    /// Index of the asset's first chunk in `Selector::chunks`.
    first_chunk: usize,
    visible: bool,
    /// Whether it is drawn, and not held until it is as fine as a root.
    is_drawn: bool,
    placed: bool,
    /// Whether a visible instance is so far away that its chunks were not evaluated.
    far: bool,
    /// Radius on the screen, of evaluated instances in and out of view.
    coverage_px: f32,
    /// The same of instances in view.
    visible_px: f32,
    foveation: f32,
    /// Bound on the screen error of chunks that are not known yet.
    unknown_px: f32,
    /// Whether an instance is not fully occluded, or was not tested; otherwise index pages rank as hidden.
    pages_visible: bool,
    /// Whether a part out of view may cast a shadow into view.
    casts_shadow: bool,
    /// Bound on the displacement of such shadows by chunks that are not known yet, in pixels.
    shadow_unknown_px: f32,
    /// Pixels per asset unit at the nearest point.
    px_per_unit: f32,
}

/// Evaluation of one chunk over all instances.
#[derive(Clone, Copy, Debug, Default)]
struct ChunkEvaluation {
    /// Screen error while it is missing: maximum over instances, the chunk and its descendants.
    error_px: f32,
    /// The same of the chunk alone.
    own_px: f32,
    foveation: f32,
    /// Displacement in pixels of shadows in view, cast by the chunk and its descendants from out of view.
    shadow_px: f32,
    /// The same of the chunk alone.
    own_shadow_px: f32,
    /// Whether it is wanted for such shadows only.
    shadow_only: bool,
    /// Visible difference while it is missing: sum over instances.
    difference_px2: f32,
    /// Benefit of its missing descendants; once processed, with its own.
    subtree: SubtreeBenefit,
    /// Priority by `subtree`; 0 if not wanted.
    priority: Priority,
    /// Whether it is applied and must stay applied.
    kept: bool,
    /// Whether a child is wanted; then the whole chunk is.
    has_wanted_child: bool,
    /// Truncation point up to which it is wanted; `None` for the whole chunk.
    truncation: Option<u8>,
    /// Whether it or an ancestor has failed or is not known.
    blocked: bool,
}

impl Default for Selector {
    fn default() -> Self {
        Self::new(SelectSettings::default())
    }
}

impl Selector {
    /// A selector with these settings.
    #[must_use]
    pub fn new(settings: SelectSettings) -> Self {
        Self {
            settings,
            selection: Selection::default(),
            threshold_px: 0.0,
            on_screen: Vec::new(),
            chunks: Vec::new(),
            histogram: Vec::new(),
            visibility: Visibility::default(),
            projected: Vec::new(),
            shares: Vec::new(),
            nearby: IndexSet::default(),
            travel: 0.0,
            to_sun: None,
            textures: Textures::default(),
            demand: TileDemand::default(),
            cut: CutSelector::default(),
            awaits_push: false,
            drawn: Vec::new(),
            moved: Vec::new(),
        }
    }

    /// Sets whether the server still pushes the base meshes of a cut through the proxies: then none are wanted where
    /// nothing can be drawn yet. False by default.
    pub const fn set_awaits_push(&mut self, awaits_push: bool) {
        self.awaits_push = awaits_push;
    }

    /// Sets the instances for which no proxy may stand where they are in view: their parts have states of their own. None
    /// by default.
    pub fn pin(&mut self, instances: &[u32]) {
        self.cut.pin(instances);
    }

    /// Sets to where parts of instances are moved, each transform once for an instance. Each costs as much as an instance:
    /// the asset is refined as if it stood there too, which is more than its moved parts need; no proxy stands for it,
    /// whether or not it is in view. None by default. For shadows cast from out of view, parts count where they were.
    pub fn set_moved(&mut self, moved: Vec<(u32, PartTransform)>) {
        let mut instances: Vec<u32> = moved.iter().map(|(instance, _)| *instance).collect();
        instances.sort_unstable();
        instances.dedup();
        self.cut.set_moved(instances);
        self.moved = moved;
    }

    /// Sets the errors of root proxies that are made for the scene's start camera. `None` by default.
    pub const fn set_root_error(&mut self, error: Option<RootError>) {
        self.cut.set_root_error(error);
    }

    /// What the last call found to be drawn.
    #[must_use]
    pub const fn cut(&self) -> &Cut {
        self.cut.cut()
    }

    /// The settings; changes apply from the next call.
    pub fn settings_mut(&mut self) -> &mut SelectSettings {
        &mut self.settings
    }

    /// Sets the distance that the eye may move before requested blobs arrive, in world units: its speed × the round
    /// trip. What becomes visible within it counts as visible. 0 by default.
    pub const fn set_travel_distance(&mut self, travel: f32) {
        self.travel = travel;
    }

    /// Sets the direction towards the sun, for shadows cast into view ([`SelectSettings::shadows`]); `None` without a
    /// sun. A zero vector counts as `None`, which is the default.
    pub fn set_to_sun(&mut self, direction: Option<[f32; 3]>) {
        self.to_sun = direction.and_then(|direction| Vec3::from(direction).try_normalize());
    }

    /// Draws the occluders for a view; returns the visibility of the scene's surfaces.
    pub fn visibility(&mut self, view: &View, instances: &[Instance], assets: &[AssetState]) -> &Visibility {
        self.visibility.draw(view, self.travel, instances.into(), assets);
        &self.visibility
    }

    /// The result of the last call.
    #[must_use]
    pub const fn last(&self) -> &Selection {
        &self.selection
    }

    /// Selects for one view. `assets` are indexed by asset number; instances of assets beyond them are skipped.
    ///
    /// Cost: a sphere test per instance, and one per known chunk and visible instance. For thousands of instances use
    /// [`Selector::select_among`].
    pub fn select(&mut self, view: &View, instances: &[Instance], assets: &[AssetState]) -> &Selection {
        self.select_among(view, instances.into(), assets)
    }

    /// As [`select`](Self::select), with the same result, with a hierarchy of the instances: those out of view cost
    /// little.
    pub fn select_among(
        &mut self,
        view: &View,
        instances: Instances<'_>,
        assets: &[AssetState],
    ) -> &Selection {
        self.select_all(view, instances, assets);
        if self.selection.wanted.is_empty() && !self.cut.held().is_empty() {
            // It gets no finer.
            self.cut.set_all_fine();
            self.select_all(view, instances, assets);
        }
        &self.selection
    }

    fn select_all(&mut self, view: &View, instances: Instances<'_>, assets: &[AssetState]) {
        let in_use = usage(assets);
        // What has become as fine as the root that stands for it is drawn at once; that holds nothing else up.
        for _ in 0..2 {
            self.reset(assets);
            self.find_cut(view, instances, assets);
            if !self.evaluate(view, instances, assets, in_use) {
                break;
            }
        }
        let threshold = self.choose_threshold(view.target_px, assets);
        if let Some(to_sun) = self.to_sun.filter(|_| self.settings.shadows) {
            self.evaluate_shadows(view, to_sun, threshold, instances, assets);
            self.admit_shadows(threshold, assets);
        }
        self.selection.counters.threshold_px = f64::from(threshold);
        let keep_out_of_view = {
            #[expect(clippy::cast_precision_loss, reason = "faces are counted, far below 2^53")]
            let share = in_use.0 as f64 / self.settings.max_faces.max(1) as f64;
            share <= f64::from(self.settings.keep_out_of_view.get())
        };
        let picture = Picture::new(view);
        let projection = Projection::new(view);
        for (number, asset) in (0..).zip(assets) {
            self.list_chunks(number, asset, threshold, keep_out_of_view);
            let beyond_px = || instances.coverage_px(number, asset.entry(), &projection);
            self.want_base_and_pages(number, asset, threshold, &picture, beyond_px);
            self.want_textures(number, asset, threshold, &picture);
        }
        if self.settings.hidden_last && self.textures.has_levels() {
            self.visibility.draw(view, self.travel, instances, assets);
            self.textures.apply_visibility(&self.visibility, view, instances.all(), assets);
        }
        self.want_tiles(view, threshold, instances, assets);
        let texels = texels_in_use(assets);
        self.selection.counters.texels = texels;
        let room = self.settings.max_texels.saturating_sub(texels);
        self.textures.list(&mut self.selection, room, assets);
        self.finish();
    }

    /// Finds which proxies are drawn. Without proxies, all instances are.
    fn find_cut(&mut self, view: &View, instances: Instances<'_>, assets: &[AssetState]) {
        let Some(proxies) = instances.proxies() else {
            self.cut.clear();
            return;
        };
        let settings = CutSettings {
            threshold_px: self.threshold_px.max(view.target_px),
            close_below: self.settings.undo_below.get(),
            prefetch: self.settings.prefetch_bases,
            awaits_push: self.awaits_push,
            partial: self.settings.partial_proxies,
        };
        let scene = CutScene { proxies, instances: instances.all(), assets };
        let (projection, picture) = (Projection::new(view), Picture::new(view));
        self.cut.update(&projection, &picture, scene, settings, &mut self.selection.wanted);
    }

    fn reset(&mut self, assets: &[AssetState]) {
        self.selection.wanted.clear();
        self.selection.failed.clear();
        self.selection.cancel.clear();
        self.selection.undo.clear();
        self.selection.counters = Counters::default();
        self.on_screen.clear();
        let mut first_chunk = 0;
        for asset in assets {
            self.on_screen.push(AssetOnScreen { first_chunk, ..AssetOnScreen::default() });
            first_chunk += asset.chunks().len();
        }
        self.chunks.clear();
        self.chunks.resize(first_chunk, ChunkEvaluation::default());
        self.textures.clear();
    }

    /// Sorts the wanted blobs and truncates the list.
    fn finish(&mut self) {
        let selection = &mut self.selection;
        if !self.cut.cut().proxies.is_empty() || self.cut.missing() > 0 {
            // An asset may be wanted for instances and for those below a proxy.
            selection.wanted.sort_unstable_by_key(|w| (w.id, Reverse(w.priority)));
            selection.wanted.dedup_by_key(|w| w.id);
        }
        let awaited = if self.awaits_push { self.cut.missing() } else { 0 };
        selection.counters.settled = selection.wanted.is_empty() && awaited == 0;
        let order = |w: &Wanted| (Reverse(w.priority), w.id);
        let most = self.settings.max_wanted.get();
        if selection.wanted.len() > most {
            selection.wanted.select_nth_unstable_by_key(most, order);
            selection.wanted.truncate(most);
        }
        selection.wanted.sort_unstable_by_key(order);
    }
}

/// Faces and payload bytes in use over all chunks.
fn usage(assets: &[AssetState]) -> (u64, u64) {
    let chunks = assets.iter().flat_map(AssetState::chunks).flatten();
    chunks.filter_map(Chunk::extent_in_use).fold((0, 0), |(faces, bytes), extent| {
        (faces + u64::from(extent.faces), bytes + u64::from(extent.payload_bytes))
    })
}
