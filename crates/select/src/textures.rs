//! Levels of textures that a view seeks, each listed once however many assets seek it.

use super::difference::Picture;
use super::priority::{hidden, refine_priority};
use super::selection::{Selection, State, Wanted};
use super::state::AssetState;
use super::visibility::Visibility;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::InstanceEntry;
use lodestream_scene::view::View;

/// A level of a texture that one asset seeks.
#[derive(Clone, Copy, Debug)]
pub(super) struct SoughtLevel {
    /// What is asked for: of a shared texture the same for all assets.
    pub(super) id: BlobId,
    /// The asset that seeks it.
    pub(super) asset: u32,
    pub(super) bytes: u32,
    pub(super) state: State,
    /// Visible difference that it makes to this asset.
    pub(super) difference_px2: f32,
    pub(super) foveation: f32,
}

/// How large an asset's largest instance is on the screen, and how much is seen of the one of which most is.
#[derive(Clone, Copy, Debug, Default)]
pub struct ShownArea {
    whole_px2: f32,
    seen_px2: f32,
}

impl ShownArea {
    /// An instance of so large a surface, and which share of it is seen.
    pub fn add(&mut self, surface_px2: f32, shown: f32) {
        self.whole_px2 = self.whole_px2.max(surface_px2);
        self.seen_px2 = self.seen_px2.max(surface_px2 * shown);
    }

    /// The difference that a texture makes, given the one that it would make if nothing were hidden.
    pub fn weigh(&self, difference_px2: f32) -> f32 {
        if self.seen_px2 > 0.0 {
            difference_px2 * (self.seen_px2 / self.whole_px2)
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

/// What a view seeks, and what shows it.
#[derive(Debug, Default)]
pub(super) struct Textures {
    sought: Vec<SoughtLevel>,
    in_view: Vec<InView>,
    /// Of the assets in view that seek something.
    areas: Vec<Option<ShownArea>>,
}

impl Textures {
    pub(super) fn clear(&mut self) {
        self.sought.clear();
        self.in_view.clear();
    }

    /// An instance is in view.
    pub(super) fn note(&mut self, number: u32, asset: u32, coverage_px: f32) {
        self.in_view.push(InView { number, asset, coverage_px });
    }

    pub(super) fn seek(&mut self, level: SoughtLevel) {
        self.sought.push(level);
    }

    /// Whether anything is sought.
    pub(super) fn seeks(&self) -> bool {
        !self.sought.is_empty()
    }

    /// Weighs what is sought by how much is seen of the instances that show it, as drawn for the view.
    pub(super) fn weigh(
        &mut self,
        visibility: &Visibility,
        view: &View,
        instances: &[InstanceEntry],
        assets: &[AssetState],
    ) {
        let picture = Picture::new(view);
        self.areas.clear();
        self.areas.resize(assets.len(), None);
        for level in &self.sought {
            self.areas[level.asset as usize] = Some(ShownArea::default());
        }
        for &InView { number, asset, coverage_px } in &self.in_view {
            let Some(area) = &mut self.areas[asset as usize] else { continue };
            let instance = &instances[number as usize];
            let shown = visibility.shown(number, view, assets[asset as usize].entry(), instance);
            area.add(picture.surface_px2(coverage_px), shown);
        }
        for level in &mut self.sought {
            if let Some(area) = self.areas[level.asset as usize] {
                level.difference_px2 = area.weigh(level.difference_px2);
            }
        }
    }

    /// Adds what was sought to a selection. What several assets seek makes the sum of the differences that it makes to
    /// each.
    pub(super) fn list(&mut self, selection: &mut Selection) {
        self.sought.sort_by_key(|level| level.id);
        for same in self.sought.chunk_by(|a, b| a.id == b.id) {
            let SoughtLevel { id, bytes, .. } = same[0];
            if same.iter().any(|level| level.state == State::Failed) {
                selection.failed.push(id);
                continue;
            }
            let difference_px2 = same.iter().map(|level| level.difference_px2).sum();
            let foveation = same.iter().map(|level| level.foveation).fold(0.0, f32::max);
            // On its way for one, it is for all.
            let state = same.iter().map(|level| level.state).max().unwrap_or_default();
            #[expect(
                clippy::cast_precision_loss,
                reason = "a priority needs no more of a length than 24 bits"
            )]
            let priority = refine_priority(difference_px2, bytes as f32, foveation);
            selection.wanted.push(Wanted::whole(id, priority, Some(bytes), state));
        }
    }
}
