//! Wanted texture levels; a level that several assets share is listed once.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use super::difference::Picture;
use super::priority::{hidden, refine_priority};
use super::selection::{Selection, State, Wanted};
use super::state::AssetState;
use super::visibility::Visibility;
use lodestream_scene::asset::{TILE_BORDER, TILE_SIDE, TextureLevel};
use lodestream_scene::blob::{BlobId, BlobPart, Tile};
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
pub(super) struct InView {
    pub(super) number: u32,
    pub(super) asset: u32,
    pub(super) coverage_px: f32,
}

/// Side of a level's texels on the screen, in pixels or in the threshold if that is larger, up to which no finer level is
/// wanted: the level whose texels are nearest to a pixel suffices. A scan with a texture of 8192 texels, close, takes 1.01
/// MB so and 1.49 MB with 1, whose pictures differ by 66 dB.
pub(super) const LARGEST_TEXEL: f32 = std::f32::consts::SQRT_2;
/// Most tiles of which it is known when they were needed: beyond, only those of the last selection.
const MAX_NEEDED: usize = 1 << 16;
/// Length of texture regions and of the tiles that they lead to, for the priority of a request.
const REGIONS_AND_TILES_BYTES: f32 = 12_000.0;

/// The request for texture regions.
pub(super) fn wanted_regions(id: BlobId, difference_px2: f32, foveation: f32, state: State) -> Wanted {
    Wanted::whole(id, refine_priority(difference_px2, REGIONS_AND_TILES_BYTES, foveation), None, state)
}

/// The wanted levels of a view and the instances in view.
#[derive(Debug, Default)]
pub(super) struct Textures {
    levels: Vec<WantedLevel>,
    in_view: Vec<InView>,
    /// Per asset, if it has wanted levels.
    areas: Vec<Option<ShownArea>>,
    /// Number of the selection.
    turn: u64,
    /// The last selection that needed a tile.
    needed: BTreeMap<BlobId, u64>,
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

    /// Begins a selection's tiles.
    pub(super) fn turn(&mut self) {
        if self.needed.len() > MAX_NEEDED {
            let turn = self.turn;
            self.needed.retain(|_, last| *last == turn);
        }
        self.turn += 1;
    }

    /// The instances in view.
    pub(super) fn take_in_view(&mut self) -> Vec<InView> {
        std::mem::take(&mut self.in_view)
    }

    /// Notes that the view needs a tile.
    pub(super) fn note_needed(&mut self, id: BlobId) {
        self.needed.insert(id, self.turn);
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

    /// Adds the levels and tiles to a selection, the most urgent ones first, as far as their texels fit into `room`. The
    /// difference of a shared one is the sum over its assets. Where there is no room, tiles that the view does not need
    /// are undone, the least recently needed first.
    pub(super) fn list(&mut self, selection: &mut Selection, mut room: u64, assets: &[AssetState]) {
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
            // Of tiles only the mean of their level is known.
            let stated = Some(bytes).filter(|_| matches!(id.part(), Some(BlobPart::Texture { .. })));
            listed.push((Wanted::whole(id, priority, stated, state), texels));
        }
        // Of one texture, coarser levels have more benefit per byte and come first.
        listed.sort_unstable_by_key(|(wanted, _)| (Reverse(wanted.priority), wanted.id));
        let wants: u64 = listed.iter().map(|(_, texels)| texels).sum();
        let mut unneeded = if wants > room { self.unneeded(assets) } else { Vec::new() };
        for (wanted, texels) in listed {
            while room < texels
                && let Some((id, freed)) = unneeded.pop()
            {
                room += freed;
                selection.undo.push(id);
            }
            if let Some(rest) = room.checked_sub(texels) {
                room = rest;
                selection.wanted.push(wanted);
            } else {
                selection.counters.levels_without_room += 1;
            }
        }
    }
}

/// Texels of the texture levels and tiles in use; one that assets share counts once.
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
    texels + tiles_in_use(assets).map(|(_, texels)| texels).sum::<u64>()
}

/// The tiles in use, as they are sent, with their texels; one that assets share is listed once.
fn tiles_in_use(assets: &[AssetState]) -> impl Iterator<Item = (BlobId, u64)> + use<'_> {
    let textures = (0_u32..).zip(assets).flat_map(|(number, asset)| {
        (0..).zip(asset.textures()).map(move |(texture, state)| (number, asset, texture, state))
    });
    textures.flat_map(move |(number, asset, texture, of)| {
        let whole = u8::try_from(of.levels.len()).unwrap_or(u8::MAX);
        let tiles = (whole..).zip(&of.tiled).flat_map(move |(level, (_, states))| {
            (0..)
                .zip(states)
                .filter(|(_, state)| **state == State::Applied)
                .map(move |(tile, _)| (BlobPart::Tile(Tile { texture, level, tile }), TILE_TEXELS))
        });
        tiles.filter_map(move |(part, texels)| {
            let own = BlobId::Asset { asset: number, part };
            let sent = asset.entry().sent_blob(number, part);
            let owner = sent.asset().zip(sent.part()).filter(|_| sent != own);
            let counted = owner.is_some_and(|(owner, part)| {
                assets.get(owner as usize).is_some_and(|owner| owner.state(part) == State::Applied)
            });
            (!counted).then_some((sent, texels))
        })
    })
}

impl Textures {
    /// The tiles in use that this selection does not need, with their texels, the least recently needed last.
    fn unneeded(&mut self, assets: &[AssetState]) -> Vec<(BlobId, u64)> {
        let in_use: BTreeMap<BlobId, u64> = tiles_in_use(assets).collect();
        let turn = self.turn;
        self.needed.retain(|id, last| *last == turn || in_use.contains_key(id));
        let last = |id: &BlobId| self.needed.get(id).copied().unwrap_or_default();
        let mut unneeded: Vec<(BlobId, u64)> =
            in_use.into_iter().filter(|(id, _)| last(id) != turn).collect();
        // Of equal age, finer ones first: they show the smallest part.
        unneeded.sort_by_key(|(id, _)| (Reverse(last(id)), *id));
        unneeded
    }
}

/// Texels of the page that a tile takes, whatever its size.
pub(super) const TILE_TEXELS: u64 = ((TILE_SIDE + 2 * TILE_BORDER) as u64).pow(2);

/// Texels of a level.
pub(super) fn texels_of(level: &TextureLevel) -> u64 {
    u64::from(level.width) * u64::from(level.height)
}
