//! The selection itself: one pass over instances, two over chunks.

mod shadows;
mod wants;

use std::cmp::Reverse;

use glam::Vec3;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::screen::{visible_error, visible_error_at};

use super::difference::{Picture, SubtreeBenefit, seen_error};
use super::instance_tree::{IndexSet, Instances, TreeQuery};
use super::priority::{Priority, hidden};
use super::project::Projection;
use super::selection::{Counters, Selection, State, Wanted};
use super::settings::SelectSettings;
use super::state::{AssetState, Chunk};
use super::textures::Textures;
use super::visibility::{Placed, Visibility};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::InstanceEntry;
use lodestream_scene::view::View;

/// Below this share of the budgets, the threshold falls back to the target at once.
const RELAXED_SHARE: u64 = 10;
/// The threshold falls only where it can fall by this factor.
const THRESHOLD_FALL: f32 = 0.8;
/// What the screen error of what is seen counts: regions of whose disc a hundredth is seen, at least. Shares are roots.
const LEAST_SHOWN: f32 = 0.1;
/// Bins per octave of the histogram of errors: a resolution of 1/8 octave, 9 %.
const BIN_SHIFT: u32 = 20;
const BINS: usize = 1 << (31 - BIN_SHIFT);

/// Selects. Keeps its buffers and the hysteresis of the threshold from call to call.
#[derive(Debug)]
pub struct Selector {
    settings: SelectSettings,
    selection: Selection,
    threshold_px: f32,
    /// Per asset: where its chunks begin in `chunks`, and what its instances add up to.
    seen: Vec<Seen>,
    /// Per chunk of all assets, one after the other.
    chunks: Vec<ChunkEvaluation>,
    /// Faces and payload bytes by bin of screen error.
    histogram: Vec<(u64, u64)>,
    visibility: Visibility,
    /// Of the chunks of one instance: screen error and foveation of those in view, and how much of each is seen.
    found: Vec<Option<(f64, f32)>>,
    shares: Vec<f32>,
    /// Instances that are looked at.
    nearby: IndexSet,
    /// How far the eye may get until what is wanted now is here.
    way: f32,
    /// Unit vector towards the sun, where it shines.
    to_sun: Option<Vec3>,
    /// Levels of textures that assets seek.
    textures: Textures,
}

/// What the instances of one asset add up to.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    first_chunk: usize,
    visible: bool,
    placed: bool,
    /// Some visible instance is so far away that its chunks were not looked at.
    far: bool,
    /// Radius on the screen, of instances out of view too as far as they were looked at.
    coverage_px: f32,
    /// The same of those in view.
    visible_px: f32,
    foveation: f32,
    /// Bound on the screen error of chunks that are not known yet.
    unknown_px: f32,
    /// Something is seen of an instance, or it is not judged: else index pages are as hidden as what they tell of.
    pages_seen: bool,
    /// The shadow of a part that is out of view may fall into view.
    casts: bool,
    /// By how many pixels chunks that are not known yet may displace such shadows, at most.
    shadow_unknown_px: f32,
    /// Pixels per asset unit where it is nearest.
    px_per_unit: f32,
}

/// What is found out about one chunk.
#[derive(Clone, Copy, Debug, Default)]
struct ChunkEvaluation {
    /// Screen error while it is missing, the largest over instances, itself and its descendants.
    error_px: f32,
    /// The same of itself alone.
    own_px: f32,
    foveation: f32,
    /// By how many pixels it and its descendants displace shadows that fall into view from out of it, as far as that counts.
    shadow_px: f32,
    /// The same of itself alone.
    own_shadow_px: f32,
    /// Wanted for such shadows alone.
    shadow_only: bool,
    /// Visible difference while it is missing, the sum over instances.
    difference_px2: f32,
    /// What its missing descendants are worth, then it with them.
    package: SubtreeBenefit,
    /// By what it is worth with its missing descendants; 0: not wanted.
    priority: Priority,
    /// Applied, and needed by something applied.
    kept: bool,
    /// A child is wanted, so it is itself, whole.
    inner: bool,
    /// The truncation up to which it is wanted.
    truncation: Option<u8>,
    /// It or an ancestor will never come, or is not known.
    blocked: bool,
}

impl Default for Selector {
    fn default() -> Self {
        Self::new(SelectSettings::default())
    }
}

/// Upper bound on the screen error over all visible parts with what is applied, in pixels: infinite while
/// a visible instance lacks its base mesh. The measure behind TTQ.
#[must_use]
pub fn max_screen_error_px(view: &View, instances: &[InstanceEntry], assets: &[AssetState]) -> f64 {
    let projection = Projection::new(view);
    let mut worst = 0.0_f64;
    for instance in instances {
        let Some(asset) = assets.get(instance.asset as usize) else { continue };
        let bounds = projection.bounds(asset.entry(), instance);
        if !bounds.visible {
            continue;
        }
        if asset.state(BlobPart::Base) != State::Applied {
            return f64::INFINITY;
        }
        let scale = f64::from(instance.scale);
        worst = worst.max(projection.error_px(f64::from(asset.unknown_error()) * scale, bounds.depth));
        let local = projection.local(asset.entry(), instance);
        for chunk in asset.chunks().iter().flatten().filter(|chunk| chunk.state() != State::Applied) {
            let error = remaining_error(chunk, 1.0);
            worst = local.error_px(&chunk.info().sphere, error).map_or(worst, |(px, _)| worst.max(px));
        }
    }
    worst
}

/// The length that shows where a chunk is not in use, or only up to a truncation.
fn remaining_error(chunk: &Chunk, share: f32) -> f32 {
    let info = chunk.info();
    match chunk.truncation() {
        Some(truncation) => visible_error_at(info, &info.extent(Some(truncation)), share),
        None => visible_error(info, share),
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
            seen: Vec::new(),
            chunks: Vec::new(),
            histogram: Vec::new(),
            visibility: Visibility::default(),
            found: Vec::new(),
            shares: Vec::new(),
            nearby: IndexSet::default(),
            way: 0.0,
            to_sun: None,
            textures: Textures::default(),
        }
    }

    /// The settings; changes hold from the next call.
    pub fn settings_mut(&mut self) -> &mut SelectSettings {
        &mut self.settings
    }

    /// How far the eye may get until what is wanted now is here, in world units: its speed times a round trip. What comes
    /// into view on the way counts as seen. 0 at first.
    pub const fn set_way(&mut self, way: f32) {
        self.way = way;
    }

    /// Where the sun's light comes from, for what casts shadows into view ([`SelectSettings::shadows`]); `None` where there
    /// is none, or a direction that is none. None at first.
    pub fn set_to_sun(&mut self, direction: Option<[f32; 3]>) {
        self.to_sun = direction.and_then(|direction| Vec3::from(direction).try_normalize());
    }

    /// What a view sees of the scene's surfaces.
    pub fn visibility(
        &mut self,
        view: &View,
        instances: &[InstanceEntry],
        assets: &[AssetState],
    ) -> &Visibility {
        self.visibility.draw(view, self.way, instances.into(), assets);
        &self.visibility
    }

    /// What the last call found.
    #[must_use]
    pub const fn last(&self) -> &Selection {
        &self.selection
    }

    /// Selects for one view. `assets` are indexed by asset number; instances of assets beyond them
    /// are skipped.
    ///
    /// Costs a sphere test per instance, and per known chunk and visible instance. Of scenes with thousands of instances,
    /// [`Selector::select_among`] finds those in view.
    pub fn select(&mut self, view: &View, instances: &[InstanceEntry], assets: &[AssetState]) -> &Selection {
        self.select_among(view, instances.into(), assets)
    }

    /// The same, to the bit, with a hierarchy of the instances: what is out of view costs next to nothing.
    pub fn select_among(
        &mut self,
        view: &View,
        instances: Instances<'_>,
        assets: &[AssetState],
    ) -> &Selection {
        self.reset(assets);
        let in_use = usage(assets);
        self.look(view, instances, assets, in_use);
        let threshold = self.close_and_choose_threshold(view.target_px, assets);
        if let Some(to_sun) = self.to_sun.filter(|_| self.settings.shadows) {
            self.look_for_shadows(view, to_sun, threshold, instances, assets);
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
            self.refine(number, asset, threshold, keep_out_of_view);
            let beyond_px = || instances.coverage_px(number, asset.entry(), &projection);
            self.want_base_and_pages(number, asset, threshold, &picture, beyond_px);
            self.want_textures(number, asset, threshold, &picture);
        }
        if self.settings.hidden_last && self.textures.seeks() {
            self.visibility.draw(view, self.way, instances, assets);
            self.textures.weigh(&self.visibility, view, instances.all(), assets);
        }
        self.textures.list(&mut self.selection);
        self.finish()
    }

    fn reset(&mut self, assets: &[AssetState]) {
        self.selection.wanted.clear();
        self.selection.failed.clear();
        self.selection.cancel.clear();
        self.selection.undo.clear();
        self.selection.counters = Counters::default();
        self.seen.clear();
        let mut first_chunk = 0;
        for asset in assets {
            self.seen.push(Seen { first_chunk, ..Seen::default() });
            first_chunk += asset.chunks().len();
        }
        self.chunks.clear();
        self.chunks.resize(first_chunk, ChunkEvaluation::default());
        self.textures.clear();
    }

    /// The pass over instances: screen errors per chunk, and the achieved error.
    fn look(&mut self, view: &View, instances: Instances<'_>, assets: &[AssetState], in_use: (u64, u64)) {
        let (projection, picture) = (Projection::new(view), Picture::new(view));
        instances.find(&TreeQuery::in_view(&projection), &mut self.nearby);
        for (number, seen) in (0..).zip(&mut self.seen) {
            seen.placed = instances.places(number);
        }
        let counters = &mut self.selection.counters;
        (counters.applied_faces, counters.applied_bytes) = in_use;
        let floor_px = f64::from(view.target_px * self.settings.undo_below.get());
        let (mut worst, mut worst_seen) = (0.0_f64, 0.0_f64);
        let mut drawn = false;
        for &number in self.nearby.numbers() {
            let instance = &instances.all()[number as usize];
            let Some(asset) = assets.get(instance.asset as usize) else { continue };
            let seen = &mut self.seen[instance.asset as usize];
            seen.placed = true;
            let bounds = projection.bounds(asset.entry(), instance);
            seen.coverage_px = seen.coverage_px.max(bounds.coverage_px);
            if !bounds.visible {
                continue;
            }
            seen.visible = true;
            seen.visible_px = seen.visible_px.max(bounds.coverage_px);
            self.textures.note(number, instance.asset, bounds.coverage_px);
            seen.foveation = seen.foveation.max(bounds.foveation);
            counters.visible_instances += 1;
            if asset.state(BlobPart::Base) == State::Applied {
                counters.drawable_instances += 1;
            } else {
                (worst, worst_seen) = (f64::INFINITY, f64::INFINITY);
            }
            let scale = f64::from(instance.scale);
            let px_of = |error: f32| projection.error_px(f64::from(error) * scale, bounds.depth);
            let unknown_px = px_of(asset.unknown_error());
            worst = worst.max(unknown_px);
            if unknown_px > floor_px && self.settings.hidden_last && asset.occluder().is_some() {
                if !std::mem::replace(&mut drawn, true) {
                    self.visibility.draw(view, self.way, instances, assets);
                }
                let shown = self.visibility.shown(number, view, asset.entry(), instance);
                seen.pages_seen |= shown > 0.0;
                if shown > 0.0 {
                    worst_seen = worst_seen.max(unknown_px);
                }
            } else {
                seen.pages_seen = true;
                worst_seen = worst_seen.max(unknown_px);
            }
            #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
            {
                seen.unknown_px = seen.unknown_px.max(unknown_px as f32);
                let px_per_unit = projection.px_per_unit(asset.entry(), instance, bounds.depth);
                seen.px_per_unit = seen.px_per_unit.max(px_per_unit as f32);
            }
            // No chunk's visible error exceeds the root error, and no sphere is nearer than the asset's.
            let root_px = px_of(asset.entry().root_error);
            if root_px < floor_px {
                (worst, worst_seen) = (worst.max(root_px), worst_seen.max(root_px));
                seen.far = true;
                continue;
            }
            let local = projection.local(asset.entry(), instance);
            let share = self.settings.attribute_share.get();
            counters.tested_chunks += asset.chunks().len() as u64;
            self.found.clear();
            self.found.extend(asset.chunks().iter().map(|chunk| {
                let info = chunk.as_ref()?.info();
                local.error_px(&info.sphere, visible_error(info, share))
            }));
            self.shares.clear();
            self.shares.resize(asset.chunks().len(), 1.0);
            let found = &self.found;
            // What is applied, or too small to be wanted, need not be looked for.
            let asks = |number: usize, chunk: &Chunk| {
                chunk.state() != State::Applied && found[number].is_some_and(|(px, _)| px > floor_px)
            };
            let numbered = (0..).zip(asset.chunks());
            if self.settings.hidden_last
                && asset.occluder().is_some()
                && numbered.filter_map(|(at, chunk)| Some((at, chunk.as_ref()?))).any(|(at, c)| asks(at, c))
            {
                if !std::mem::replace(&mut drawn, true) {
                    self.visibility.draw(view, self.way, instances, assets);
                }
                let placed = Placed::new(view, asset.entry(), instance);
                self.visibility.shares(number, &placed, asset.chunks(), asks, &mut self.shares);
            }
            let seeks = &mut self.chunks[seen.first_chunk..];
            let about = found.iter().zip(&self.shares);
            for ((seek, chunk), (found, &shown)) in seeks.iter_mut().zip(asset.chunks()).zip(about) {
                let (Some(chunk), &Some((px, foveation))) = (chunk, found) else { continue };
                let info = chunk.info();
                let error = visible_error(info, share);
                if chunk.state() != State::Applied {
                    let left = remaining_error(chunk, share);
                    let left_px = if left < error { px * f64::from(left / error) } else { px };
                    worst = worst.max(left_px);
                    if shown > LEAST_SHOWN {
                        worst_seen = worst_seen.max(left_px);
                    }
                }
                #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
                {
                    seek.own_px = seek.own_px.max(px as f32);
                    seek.error_px = seek.own_px;
                    let px_per_unit = px as f32 / error.max(f32::MIN_POSITIVE);
                    let seen_px = px_per_unit * seen_error(info.error, info.attribute_error, share);
                    let whole = picture.shape_px2(seen_px, px_per_unit * info.sphere.radius);
                    seek.difference_px2 += if shown > 0.0 { shown * whole } else { hidden(whole) };
                }
                seek.foveation = seek.foveation.max(foveation);
            }
        }
        counters.max_screen_error_px = worst;
        counters.seen_screen_error_px = worst_seen;
    }

    /// Passes errors on to parents and finds the threshold at which the budgets hold.
    fn close_and_choose_threshold(&mut self, target_px: f32, assets: &[AssetState]) -> f32 {
        self.histogram.clear();
        self.histogram.resize(BINS, (0, 0));
        let (mut faces, mut bytes) = (0_u64, 0_u64);
        for (seen, asset) in self.seen.iter().zip(assets) {
            if !seen.visible {
                continue;
            }
            let seeks = &mut self.chunks[seen.first_chunk..];
            for (index, chunk) in asset.chunks().iter().enumerate().rev() {
                let Some(info) = chunk.as_ref().map(Chunk::info) else { continue };
                let ChunkEvaluation { error_px, foveation, .. } = seeks[index];
                if error_px <= 0.0 {
                    continue;
                }
                for &parent in &info.parents {
                    let parent = &mut seeks[parent as usize];
                    parent.error_px = parent.error_px.max(error_px);
                    parent.foveation = parent.foveation.max(foveation);
                }
                if error_px > target_px {
                    let bin = &mut self.histogram[(error_px.to_bits() >> BIN_SHIFT) as usize % BINS];
                    bin.0 += u64::from(info.faces);
                    bin.1 += u64::from(info.payload_bytes);
                    faces += u64::from(info.faces);
                    bytes += u64::from(info.payload_bytes);
                }
            }
        }
        let SelectSettings { max_faces, max_bytes, .. } = self.settings;
        let relaxed = |budget: u64| budget - budget / RELAXED_SHARE;
        if faces <= relaxed(max_faces) && bytes <= relaxed(max_bytes) {
            self.threshold_px = target_px;
            return target_px;
        }
        let needed = threshold_within(&self.histogram, max_faces, max_bytes, target_px);
        if needed > self.threshold_px || needed < self.threshold_px * THRESHOLD_FALL {
            self.threshold_px = needed;
        }
        self.threshold_px = self.threshold_px.max(target_px);
        self.threshold_px
    }

    /// Lists the chunks of one asset that are wanted, no longer wanted, or to be undone.
    fn refine(&mut self, number: u32, asset: &AssetState, threshold: f32, keep_out_of_view: bool) {
        let share = self.settings.attribute_share.get();
        let truncation_points = self.settings.truncation_points;
        let chunks = asset.chunks();
        let seeks = &mut self.chunks[self.seen[number as usize].first_chunk..][..chunks.len()];
        let far = self.seen[number as usize].far;
        let counters = &mut self.selection.counters;
        // Over budget there is no room for hysteresis.
        let over = counters.applied_faces > self.settings.max_faces
            || counters.applied_bytes > self.settings.max_bytes;
        let undo_below = if over { threshold } else { threshold * self.settings.undo_below.get() };
        // Children before parents: what they are worth and what must stay is passed up.
        for (index, chunk) in chunks.iter().enumerate().rev() {
            let Some(chunk) = chunk else { continue };
            let info = chunk.info();
            let seek = &mut seeks[index];
            let applied = chunk.extent_in_use().is_some();
            if seek.error_px > threshold {
                seek.truncation = if truncation_points { enough(info, seek, threshold, share) } else { None };
                if chunk.state_up_to(seek.truncation) != State::Applied {
                    let left = match chunk.truncation() {
                        Some(truncation) if seek.own_px > 0.0 => {
                            px_at(info, seek, truncation, share) / seek.own_px
                        }
                        _ => 1.0,
                    };
                    let need = info.extent(seek.truncation).payload_bytes;
                    #[expect(
                        clippy::cast_precision_loss,
                        reason = "a priority needs no more of a length than 24 bits"
                    )]
                    let bytes = need.saturating_sub(chunk.held_bytes()).max(1) as f32;
                    let own = SubtreeBenefit { difference_px2: left * seek.difference_px2, bytes };
                    seek.package = own.with(seek.package);
                    seek.priority = seek.package.priority(seek.foveation);
                }
            }
            let out_of_view = seek.error_px <= 0.0 && !far;
            seek.kept |= applied && (seek.error_px >= undo_below || (out_of_view && keep_out_of_view));
            let ChunkEvaluation { package, kept, error_px, .. } = *seek;
            for &parent in &info.parents {
                let parent = &mut seeks[parent as usize];
                parent.package.add(package, info.parents.len());
                parent.kept |= kept;
                parent.inner |= error_px > threshold;
            }
            let id = BlobId::chunk(number, u32::try_from(index).unwrap_or(u32::MAX));
            if applied && !kept {
                self.selection.undo.push(id);
            } else if chunk.state() == State::InFlight && seeks[index].error_px < undo_below {
                self.selection.cancel.push(id);
            }
        }
        // Nothing can be used of an asset whose base mesh cannot be had.
        let baseless = asset.state(BlobPart::Base) == State::Failed;
        // Parents before children: what can never come blocks what hangs on it, and nothing comes before its parents.
        for (index, chunk) in chunks.iter().enumerate() {
            let Some(chunk) = chunk else {
                seeks[index].blocked = true;
                continue;
            };
            let info = chunk.info();
            let blocked = baseless
                || chunk.state() == State::Failed
                || info.parents.iter().any(|&parent| seeks[parent as usize].blocked);
            let parents = info.parents.iter().map(|&parent| seeks[parent as usize].priority);
            let first = parents.filter(|&priority| priority > 0).min().unwrap_or(Priority::MAX);
            let seek = &mut seeks[index];
            seek.priority = seek.priority.min(first);
            seek.blocked = blocked;
            if chunk.state() == State::Failed && (seek.error_px > threshold || seek.inner) {
                let id = BlobId::chunk(number, u32::try_from(index).unwrap_or(u32::MAX));
                self.selection.failed.push(id);
            }
            if seek.error_px <= threshold {
                continue;
            }
            counters.needed_chunks += 1;
            let (truncation, held) = (seek.truncation, chunk.held_bytes());
            let need = info.extent(truncation).payload_bytes;
            counters.needed_bytes += u64::from(need);
            counters.shadow_bytes += if seek.shadow_only { u64::from(need) } else { 0 };
            let state = chunk.state_up_to(truncation);
            if state == State::Applied {
                continue;
            }
            counters.missing_chunks += 1;
            if matches!(state, State::Absent | State::InFlight) {
                counters.missing_bytes += u64::from(need.saturating_sub(held));
            }
            if !blocked {
                let id = BlobId::chunk(number, u32::try_from(index).unwrap_or(u32::MAX));
                let (bytes, end) = (Some(info.payload_bytes), truncation.map(|_| need));
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
                let error_px = seek.own_px as u16;
                self.selection.wanted.push(Wanted {
                    id,
                    priority: seek.priority,
                    bytes,
                    state,
                    held,
                    end,
                    truncation,
                    error_px,
                });
            }
        }
    }

    /// Puts the wanted blobs in order and cuts the list.
    fn finish(&mut self) -> &Selection {
        let selection = &mut self.selection;
        selection.counters.settled = selection.wanted.is_empty();
        let order = |w: &Wanted| (Reverse(w.priority), w.id);
        let most = self.settings.max_wanted.get();
        if selection.wanted.len() > most {
            selection.wanted.select_nth_unstable_by_key(most, order);
            selection.wanted.truncate(most);
        }
        selection.wanted.sort_unstable_by_key(order);
        selection
    }
}

/// The threshold, `least_px` at least, above which there are no more faces and bytes than these, by a histogram of errors.
fn threshold_within(histogram: &[(u64, u64)], max_faces: u64, max_bytes: u64, least_px: f32) -> f32 {
    let (mut faces, mut bytes) = (0_u64, 0_u64);
    for (bin, (more_faces, more_bytes)) in histogram.iter().enumerate().rev() {
        faces += more_faces;
        bytes += more_bytes;
        if faces > max_faces || bytes > max_bytes {
            #[expect(clippy::cast_possible_truncation, reason = "bins fit into 11 bits")]
            let above = f32::from_bits((bin as u32 + 1) << BIN_SHIFT);
            return if above.is_finite() { above.max(least_px) } else { f32::MAX };
        }
    }
    least_px
}

/// Screen error of a chunk's own that is left at a truncation.
fn px_at(info: &ChunkInfo, seek: &ChunkEvaluation, truncation: u8, share: f32) -> f32 {
    let whole = visible_error(info, share);
    let left = visible_error_at(info, &info.extent(Some(truncation)), share);
    if left < whole { seek.own_px * (left / whole) } else { seek.own_px }
}

/// The first truncation of a chunk at which nothing is left above the threshold; `None` where none is, or a
/// child is wanted.
fn enough(info: &ChunkInfo, seek: &ChunkEvaluation, threshold: f32, share: f32) -> Option<u8> {
    if seek.inner {
        return None;
    }
    (0_u8..)
        .take(info.truncation_points.len())
        .find(|&truncation| px_at(info, seek, truncation, share) <= threshold)
}

/// Faces and payload bytes of what is in use of all assets' chunks.
fn usage(assets: &[AssetState]) -> (u64, u64) {
    let chunks = assets.iter().flat_map(AssetState::chunks).flatten();
    chunks.filter_map(Chunk::extent_in_use).fold((0, 0), |(faces, bytes), extent| {
        (faces + u64::from(extent.faces), bytes + u64::from(extent.payload_bytes))
    })
}
