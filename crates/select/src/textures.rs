//! Wanted texture levels; a level that several assets share is listed once.

use std::cmp::Reverse;

use super::difference::Picture;
use super::priority::{hidden, refine_priority};
use super::selection::{Selection, State, Wanted};
use super::state::AssetState;
use super::visibility::Visibility;
use lodestream_scene::asset::TextureLevel;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::Instance;
use lodestream_scene::view::View;

/// A texture level that one asset wants.
#[derive(Clone, Copy, Debug)]
pub(super) struct WantedLevel {
    /// The blob to request; the same for all assets that share the texture.
    pub(super) id: BlobId,
    /// The asset that wants it.
    pub(super) asset: u32,
    pub(super) bytes: u32,
    pub(super) texels: u64,
    pub(super) state: State,
    /// Visible difference that it makes on this asset.
    pub(super) difference_px2: f32,
    pub(super) foveation: f32,
}

/// Area on the screen of an asset's largest instance, and of its most visible one.
#[derive(Clone, Copy, Debug, Default)]
pub struct ShownArea {
    whole_px2: f32,
    visible_px2: f32,
}

impl ShownArea {
    /// Adds an instance with its surface area and the visible share of it.
    pub fn add(&mut self, surface_px2: f32, shown: f32) {
        self.whole_px2 = self.whole_px2.max(surface_px2);
        self.visible_px2 = self.visible_px2.max(surface_px2 * shown);
    }

    /// Scales the difference that a texture would make without occlusion by the visible share.
    pub fn weigh(&self, difference_px2: f32) -> f32 {
        if self.visible_px2 > 0.0 {
            difference_px2 * (self.visible_px2 / self.whole_px2)
        } else {
            hidden(difference_px2)
        }
    }
}

/// An instance in view.
#[derive(Clone, Copy, Debug)]
struct InView {
    number: u32,
    asset: u32,
    coverage_px: f32,
}

/// The wanted levels of a view and the instances in view.
#[derive(Debug, Default)]
pub(super) struct Textures {
    levels: Vec<WantedLevel>,
    in_view: Vec<InView>,
    /// Per asset, if it has wanted levels.
    areas: Vec<Option<ShownArea>>,
}

impl Textures {
    pub(super) fn clear(&mut self) {
        self.levels.clear();
        self.in_view.clear();
    }

    /// Adds an instance in view.
    pub(super) fn add_instance(&mut self, number: u32, asset: u32, coverage_px: f32) {
        self.in_view.push(InView { number, asset, coverage_px });
    }

    pub(super) fn add_level(&mut self, level: WantedLevel) {
        self.levels.push(level);
    }

    /// Whether a level is wanted.
    pub(super) fn has_levels(&self) -> bool {
        !self.levels.is_empty()
    }

    /// Scales the differences by the visible shares of the instances.
    pub(super) fn apply_visibility(
        &mut self,
        visibility: &Visibility,
        view: &View,
        instances: &[Instance],
        assets: &[AssetState],
    ) {
        let picture = Picture::new(view);
        self.areas.clear();
        self.areas.resize(assets.len(), None);
        for level in &self.levels {
            self.areas[level.asset as usize] = Some(ShownArea::default());
        }
        for &InView { number, asset, coverage_px } in &self.in_view {
            let Some(area) = &mut self.areas[asset as usize] else { continue };
            let instance = &instances[number as usize];
            let shown = visibility.shown(number, view, assets[asset as usize].entry(), instance);
            area.add(picture.surface_px2(coverage_px), shown);
        }
        for level in &mut self.levels {
            if let Some(area) = self.areas[level.asset as usize] {
                level.difference_px2 = area.weigh(level.difference_px2);
            }
        }
    }

    /// Adds the levels to a selection, the most urgent ones first, as far as their texels fit into `room`. The
    /// difference of a shared level is the sum over its assets.
    pub(super) fn list(&mut self, selection: &mut Selection, mut room: u64) {
        self.levels.sort_by_key(|level| level.id);
        let mut listed = Vec::new();
        for same in self.levels.chunk_by(|a, b| a.id == b.id) {
            let WantedLevel { id, bytes, texels, .. } = same[0];
            if same.iter().any(|level| level.state == State::Failed) {
                selection.failed.push(id);
                continue;
            }
            let difference_px2 = same.iter().map(|level| level.difference_px2).sum();
            let foveation = same.iter().map(|level| level.foveation).fold(0.0, f32::max);
            // The blob is the same for all, so the furthest state applies.
            let state = same.iter().map(|level| level.state).max().unwrap_or_default();
            #[expect(
                clippy::cast_precision_loss,
                reason = "a priority needs no more of a length than 24 bits"
            )]
            let priority = refine_priority(difference_px2, bytes as f32, foveation);
            listed.push((Wanted::whole(id, priority, Some(bytes), state), texels));
        }
        // Of one texture, coarser levels have more benefit per byte and come first.
        listed.sort_unstable_by_key(|(wanted, _)| (Reverse(wanted.priority), wanted.id));
        for (wanted, texels) in listed {
            if let Some(rest) = room.checked_sub(texels) {
                room = rest;
                selection.wanted.push(wanted);
            } else {
                selection.counters.levels_without_room += 1;
            }
        }
    }
}

/// Texels of the texture levels in use; a level that assets share counts once.
pub(super) fn texels_in_use(assets: &[AssetState]) -> u64 {
    let mut texels = 0;
    for (number, asset) in (0..).zip(assets) {
        for (texture, state) in (0..).zip(asset.textures()) {
            let (owner, of) = asset.entry().sent_as(number, texture);
            let owner = assets.get(owner as usize).filter(|_| (owner, of) != (number, texture));
            for (level, (about, state)) in (0..).zip(&state.levels) {
                let part = BlobPart::Texture { texture: of, level };
                let counted = owner.is_some_and(|owner| owner.state(part) == State::Applied);
                if *state == State::Applied && !counted {
                    texels += texels_of(about);
                }
            }
        }
    }
    texels
}

/// Texels of a level.
pub(super) fn texels_of(level: &TextureLevel) -> u64 {
    u64::from(level.width) * u64::from(level.height)
}
