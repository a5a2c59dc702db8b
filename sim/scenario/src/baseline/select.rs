//! Selects the pieces that a view needs, by the projection of [`lodestream_select`], most urgent first. The order by
//! octaves of screen error reaches a given screen error sooner than this project's order by visible difference.
//!
//! A piece is refined into its children while its projected error exceeds the target, without children out of view. A
//! child with several parents needs all of them, so its benefit is added to theirs. Pieces required to draw an asset
//! come first.

use std::cmp::Reverse;

use lodestream_scene::{BlobId, BlobPart, View};
use lodestream_select::priority::{base_priority, prefetch_priority};
use lodestream_select::{Priority, Projection};

use super::library::Content;
use super::octave::octave_priority;
use super::offer::{Item, Offer};

/// Texture levels requested at once for one texture, as in the project's selection.
const PENDING_LEVELS: usize = 2;
/// Weight of a blurred texel against a screen error of one pixel.
const TEXTURE_WEIGHT: f32 = 0.25;

/// Download state of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    Absent,
    Requested,
    Here,
}

/// Download state of all items of a content.
#[derive(Clone, Debug)]
pub(super) struct ItemStates {
    pieces: Vec<Vec<State>>,
    /// By asset, texture and level.
    textures: Vec<Vec<Vec<State>>>,
}

impl ItemStates {
    pub(super) fn nothing(content: &Content) -> Self {
        let textures = content.stage.textures.iter();
        Self {
            pieces: content.offers.iter().map(|offer| vec![State::Absent; offer.pieces.len()]).collect(),
            textures: textures
                .map(|of| of.iter().map(|texture| vec![State::Absent; texture.levels.len()]).collect())
                .collect(),
        }
    }

    pub(super) fn set(&mut self, item: Item, state: State) {
        match item {
            Item::Piece { asset, piece } => self.pieces[asset as usize][piece as usize] = state,
            Item::Texture(id) => {
                if let BlobId::Asset { asset, part: BlobPart::Texture { texture, level } } = id {
                    self.textures[asset as usize][usize::from(texture)][usize::from(level)] = state;
                }
            }
        }
    }

    /// The pieces of an asset that can be used: those that arrived together with all that they depend on.
    fn usable(&self, asset: usize, offer: &Offer) -> Vec<bool> {
        let mut usable = vec![false; offer.pieces.len()];
        for (number, piece) in offer.pieces.iter().enumerate() {
            usable[number] = self.pieces[asset][number] == State::Here
                && piece.parents.iter().all(|&parent| usable[parent as usize]);
        }
        usable
    }
}

/// An item to request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct MissingItem {
    pub(super) item: Item,
    pub(super) priority: Priority,
    pub(super) bytes: u64,
    pub(super) state: State,
}

/// The selection for one view.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Selection {
    /// Missing items, most urgent first, parents before children.
    pub(super) wanted: Vec<MissingItem>,
    /// Whether every visible instance can be drawn.
    pub(super) drawable: bool,
    /// Upper bound on the screen error of what is drawn, in pixels; infinite while a visible instance cannot be drawn.
    pub(super) error_px: f64,
}

/// Screen errors of an asset over all its instances.
#[derive(Clone, Debug, Default)]
struct AssetErrors {
    visible: bool,
    placed: bool,
    coverage_px: f32,
    foveation: f32,
    px_per_unit: f32,
    /// By piece: screen error while it is missing, and foveation.
    missing: Vec<(f32, f32)>,
}

pub(super) fn select(content: &Content, held: &ItemStates, view: &View) -> Selection {
    let stage = &*content.stage;
    let projection = Projection::new(view);
    let usable: Vec<Vec<bool>> =
        content.offers.iter().enumerate().map(|(asset, offer)| held.usable(asset, offer)).collect();
    let drawable = |asset: usize| content.offers[asset].roots().all(|piece| usable[asset][piece as usize]);
    let mut selection = Selection { drawable: true, ..Selection::default() };
    let of_offer = |offer: &Offer| AssetErrors {
        missing: vec![(0.0, 0.0); offer.pieces.len()],
        ..AssetErrors::default()
    };
    let mut seen: Vec<AssetErrors> = content.offers.iter().map(of_offer).collect();
    for instance in &stage.instances {
        let number = instance.asset as usize;
        let (Some(asset), Some(offer)) = (stage.assets.get(number), content.offers.get(number)) else {
            continue;
        };
        let bounds = projection.bounds(asset, instance);
        let seen = &mut seen[number];
        seen.placed = true;
        seen.coverage_px = seen.coverage_px.max(bounds.coverage_px);
        if !bounds.visible {
            continue;
        }
        seen.visible = true;
        seen.foveation = seen.foveation.max(bounds.foveation);
        // As in the project's selection.
        {
            let px_per_unit = projection.px_per_unit(asset, instance, bounds.depth) as f32;
            seen.px_per_unit = seen.px_per_unit.max(px_per_unit);
        }
        if !drawable(number) {
            selection.drawable = false;
            selection.error_px = f64::INFINITY;
        }
        let local = projection.local(asset, instance);
        let px: Vec<Option<(f64, f32)>> =
            offer.pieces.iter().map(|piece| local.error_px(&piece.sphere, piece.error)).collect();
        for (child, piece) in offer.pieces.iter().enumerate() {
            if px[child].is_none() {
                continue;
            }
            for &parent in &piece.parents {
                let Some((error_px, foveation)) = px[parent as usize] else { continue };
                if usable[number][parent as usize] && !usable[number][child] {
                    selection.error_px = selection.error_px.max(error_px);
                }
                let missing = &mut seen.missing[child];
                *missing = (missing.0.max(error_px as f32), missing.1.max(foveation));
            }
        }
    }
    for (number, seen) in (0_u32..).zip(&mut seen) {
        want_pieces(&mut selection, content, held, number, seen, view.target_px);
        if seen.visible && drawable(number as usize) {
            want_textures(&mut selection, content, held, number, seen, view.target_px);
        }
    }
    selection.wanted.sort_unstable_by_key(|wanted| (Reverse(wanted.priority), wanted.item));
    selection
}

fn want_pieces(
    selection: &mut Selection,
    content: &Content,
    held: &ItemStates,
    asset: u32,
    seen: &mut AssetErrors,
    target_px: f32,
) {
    let offer = &content.offers[asset as usize];
    let mut priorities: Vec<Priority> = vec![0; offer.pieces.len()];
    // Children before parents, so that benefits accumulate upwards.
    for (number, piece) in offer.pieces.iter().enumerate().rev() {
        let (error_px, foveation) = seen.missing[number];
        let own = if offer.is_root(piece) {
            if seen.visible {
                base_priority(seen.coverage_px, seen.foveation)
            } else if seen.placed {
                prefetch_priority(seen.coverage_px)
            } else {
                0
            }
        } else if error_px > target_px {
            octave_priority(error_px, u32::try_from(piece.bytes).unwrap_or(u32::MAX), foveation)
        } else {
            0
        };
        priorities[number] = priorities[number].max(own);
        for &parent in &piece.parents {
            let parent = parent as usize;
            priorities[parent] = priorities[parent].max(priorities[number]);
            let worth = &mut seen.missing[parent];
            *worth = (worth.0.max(error_px), worth.1.max(foveation));
        }
    }
    let states = &held.pieces[asset as usize];
    // Nodes cannot be requested before the index that lists them has arrived.
    let unknown = |parent: &u32| {
        let parent = *parent as usize;
        !offer.pieces[parent].draws && states[parent] != State::Here
    };
    for (piece, &priority) in (0_u32..).zip(&priorities) {
        let state = states[piece as usize];
        let known = !offer.pieces[piece as usize].parents.iter().any(unknown);
        if priority > 0 && state != State::Here && known {
            let bytes = offer.pieces[piece as usize].bytes;
            selection.wanted.push(MissingItem { item: Item::Piece { asset, piece }, priority, bytes, state });
        }
    }
}

/// A texture's next level is requested while a texel of the present one covers more than a pixel.
fn want_textures(
    selection: &mut Selection,
    content: &Content,
    held: &ItemStates,
    asset: u32,
    seen: &AssetErrors,
    target_px: f32,
) {
    let textures = &content.stage.textures[asset as usize];
    for ((number, texture), states) in (0_u16..).zip(textures).zip(&held.textures[asset as usize]) {
        let px_per_uv = seen.px_per_unit / texture.uv_per_unit.max(f32::MIN_POSITIVE);
        let mut texel_px = px_per_uv.min(f32::MAX);
        let mut pending = 0;
        for ((level, &(bytes, texels)), &state) in (0_u8..).zip(&texture.levels).zip(states) {
            if texel_px <= target_px.max(1.0) || pending == PENDING_LEVELS {
                break;
            }
            if state != State::Here {
                pending += 1;
                let priority = octave_priority(texel_px.min(256.0) * TEXTURE_WEIGHT, bytes, seen.foveation);
                let item = Item::Texture(BlobId::texture(asset, number, level));
                selection.wanted.push(MissingItem { item, priority, bytes: u64::from(bytes), state });
            }
            // A texture's side.
            let texels = texels.max(1) as f32;
            texel_px = px_per_uv / texels;
        }
    }
}
