//! Wanted tiles of textures.
//!
//! Texture regions state where the surface is in its textures. A region that is in view and not hidden wants the tiles of
//! its cells, of all levels up to the one whose texels are nearest to a pixel at its nearest point. The difference of a tile is
//! that of a texture on the surface that shows it, summed over regions and instances.

use lodestream_scene::asset::{TILE_SIDE, TextureLevel, TexturePatch, tile_grid};
use lodestream_scene::blob::{BlobId, BlobPart, Tile};
use lodestream_scene::view::View;

use super::Selector;
use crate::difference::Picture;
use crate::instance_tree::Instances;
use crate::project::{Projection, RegionView};
use crate::selection::State;
use crate::state::{AssetState, TextureState};
use crate::textures::{InView, LARGEST_TEXEL, TILE_TEXELS, WantedLevel};
use crate::tile_demand::TileDemand;
use crate::visibility::Placed;

/// Most instances of an asset whose regions are tested: the largest on the screen.
const MAX_INSTANCES: usize = 32;
/// Share of a surface's area that it covers on the screen: half of what is seen faces away by more than 60°.
const FACING: f32 = 0.5;

impl Selector {
    /// Adds the tiles that the instances in view show.
    pub(super) fn want_tiles(
        &mut self,
        view: &View,
        threshold: f32,
        instances: Instances<'_>,
        assets: &[AssetState],
    ) {
        self.textures.turn();
        let mut in_view = self.textures.take_in_view();
        let has_regions = |of: &InView| {
            assets.get(of.asset as usize).is_some_and(|asset| {
                asset.texture_regions().is_some() && asset.state(BlobPart::Base) == State::Applied
            })
        };
        in_view.retain(has_regions);
        if in_view.is_empty() {
            return;
        }
        if self.settings.hidden_last {
            self.visibility.draw(view, self.travel, instances, assets);
        }
        in_view.sort_by(|a, b| {
            a.asset.cmp(&b.asset).then(b.coverage_px.total_cmp(&a.coverage_px)).then(a.number.cmp(&b.number))
        });
        let (projection, picture) = (Projection::new(view), Picture::new(view));
        let mut demand = std::mem::take(&mut self.demand);
        for of_asset in in_view.chunk_by(|a, b| a.asset == b.asset) {
            let number = of_asset[0].asset;
            let asset = &assets[number as usize];
            demand.reset(asset.textures());
            for of in of_asset.iter().take(MAX_INSTANCES) {
                self.evaluate_regions(
                    view,
                    (&projection, &picture),
                    threshold,
                    instances,
                    (asset, of),
                    &mut demand,
                );
            }
            self.add_tiles(number, asset, &demand);
        }
        self.demand = demand;
    }

    fn evaluate_regions(
        &self,
        view: &View,
        (projection, picture): (&Projection, &Picture),
        threshold: f32,
        instances: Instances<'_>,
        (asset, of): (&AssetState, &InView),
        demand: &mut TileDemand,
    ) {
        let Some(instance) = instances.all().get(of.number as usize) else { return };
        let Some(regions) = asset.texture_regions() else { return };
        let local = projection.local(asset.entry(), instance);
        let placed = Placed::new(view, asset.entry(), instance);
        let margin = asset.entry().root_error;
        for region in &regions.regions {
            let Some(view) = local.region(&region.sphere) else { continue };
            let share = if self.settings.hidden_last {
                self.visibility.region_share(of.number, &placed, &region.sphere, margin)
            } else {
                1.0
            };
            if share > 0.0 {
                for patch in &region.patches {
                    let weight = self.settings.texture_weight.get();
                    add_patch(asset, patch, (&view, share), threshold, (picture, weight), demand);
                }
            }
        }
    }

    /// Lists the tiles with a difference.
    fn add_tiles(&mut self, number: u32, asset: &AssetState, demand: &TileDemand) {
        for ((texture, info), first) in (0..).zip(asset.textures()).zip(&demand.first) {
            let levels = (0_u8..).zip(&info.tiled).zip(first);
            for ((at, (about, states)), &first) in levels {
                let level = u8::try_from(info.levels.len()).unwrap_or(u8::MAX).saturating_add(at);
                for ((tile, &state), &(difference_px2, foveation)) in
                    (0..).zip(states).zip(&demand.tiles[first..])
                {
                    if difference_px2 <= 0.0 {
                        continue;
                    }
                    let part = BlobPart::Tile(Tile { texture, level, tile });
                    let id = asset.entry().sent_blob(number, part);
                    self.textures.note_needed(id);
                    if state != State::Applied {
                        let texels = TILE_TEXELS;
                        let bytes = about.bytes;
                        let wanted = WantedLevel {
                            id,
                            asset: number,
                            bytes,
                            texels,
                            state,
                            difference_px2,
                            foveation,
                        };
                        self.textures.add_level(wanted);
                    }
                }
            }
        }
    }

    /// Wants the texture regions of an asset whose coarser levels are not enough.
    pub(super) fn want_texture_regions(
        &mut self,
        number: u32,
        asset: &AssetState,
        threshold: f32,
        picture: &Picture,
    ) {
        let on_screen = self.on_screen[number as usize];
        let state = asset.state(BlobPart::TextureRegions);
        let id = BlobId::texture_regions(number);
        if state == State::Applied {
            return;
        }
        let texel_px = |info: &TextureState| {
            let (last, _) = info.levels.last().filter(|_| !info.tiled.is_empty())?;
            Some(on_screen.px_per_unit / (info.uv_per_unit * longer_side(last)).max(f32::MIN_POSITIVE))
        };
        let largest = asset.textures().iter().filter_map(texel_px).fold(0.0, f32::max);
        if largest <= LARGEST_TEXEL * threshold.max(1.0) {
            return;
        }
        if state == State::Failed {
            self.selection.failed.push(id);
            return;
        }
        let weight = self.settings.texture_weight.get();
        let difference_px2 = picture.texture_px2(largest, on_screen.visible_px, weight);
        self.selection.wanted.push(crate::textures::wanted_regions(
            id,
            difference_px2,
            on_screen.foveation,
            state,
        ));
    }
}

#[expect(clippy::cast_precision_loss, reason = "sides of textures are small")]
fn longer_side(level: &TextureLevel) -> f32 {
    level.width.max(level.height).max(1) as f32
}

/// Adds what a patch shows of its material's textures.
fn add_patch(
    asset: &AssetState,
    patch: &TexturePatch,
    (view, share): (&RegionView, f32),
    threshold: f32,
    (picture, weight): (&Picture, f32),
    demand: &mut TileDemand,
) {
    let Some(cells) = asset.material_cells(patch.material) else { return };
    let columns = tile_grid(cells.size)[0].max(1);
    let px_per_unit = view.px_per_unit;
    let area_px2 = patch.area * view.middle_px_per_unit.powi(2) * FACING * share;
    #[expect(clippy::cast_precision_loss, reason = "a patch has few cells")]
    let per_cell = 1.0 / patch.cell_count().max(1) as f32;
    for &texture in &cells.textures {
        let Some(info) = asset.textures().get(usize::from(texture)) else { continue };
        let mut coarser = info.levels.last().map(|(level, _)| level);
        for ((level, _), &first) in info.tiled.iter().zip(&demand.first[usize::from(texture)]) {
            let side = coarser.replace(level).map_or(1.0, longer_side);
            // Of the coarser level: a finer one adds nothing to texels within a pixel.
            let texel_px = px_per_unit / (patch.uv_per_unit * side).max(f32::MIN_POSITIVE);
            if texel_px <= LARGEST_TEXEL * threshold.max(1.0) {
                break;
            }
            let difference_px2 = picture.texture_px2(texel_px, area_px2.sqrt(), weight) * per_cell;
            let grid = tile_grid(level.size());
            for cell in patch.cells.iter().cloned().flatten() {
                let [across, down] = [u32::from(cell) % columns, u32::from(cell) / columns];
                let x = tiles_of_cell(across, cells.size[0], level.width, grid[0]);
                let y = tiles_of_cell(down, cells.size[1], level.height, grid[1]);
                for row in y {
                    for column in x.clone() {
                        let tile = first + (row * grid[0] + column) as usize;
                        if let Some((difference, foveation)) = demand.tiles.get_mut(tile) {
                            *difference += difference_px2;
                            *foveation = foveation.max(view.foveation);
                        }
                    }
                }
            }
        }
    }
}

/// The tiles of a level that a cell covers, along one axis: cells are as wide as the tiles of a level of `finest` texels.
fn tiles_of_cell(cell: u32, finest: u32, texels: u32, tiles: u32) -> std::ops::Range<u32> {
    let at = |cell: u64| (cell * u64::from(TILE_SIDE)).min(finest.into()) * u64::from(texels);
    let unit = u64::from(finest.max(1)) * u64::from(TILE_SIDE);
    let first = at(cell.into()) / unit;
    let end = at(u64::from(cell) + 1).div_ceil(unit);
    let within = |tile: u64| u32::try_from(tile).unwrap_or(u32::MAX).min(tiles);
    within(first)..within(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_cover_the_tiles_that_they_overlap() {
        // Of a level of 4096 texels, and of one of 1000 beside it.
        assert_eq!(tiles_of_cell(5, 4096, 4096, 16), 5..6);
        assert_eq!(tiles_of_cell(5, 4096, 2048, 8), 2..3);
        assert_eq!(tiles_of_cell(15, 4096, 512, 2), 1..2);
        assert_eq!(tiles_of_cell(1, 1024, 1000, 4), 0..2);
        assert_eq!(tiles_of_cell(3, 1000, 1000, 4), 3..4);
        assert_eq!(tiles_of_cell(3, 1000, 500, 2), 1..2);
        assert_eq!(tiles_of_cell(0, 1, 4096, 16), 0..16, "one cell for all");
        for (finest, texels) in [(1000_u32, 700_u32), (32_768, 257), (300, 32_768)] {
            let [cells, tiles] = [finest, texels].map(|side| side.div_ceil(TILE_SIDE));
            let mut covered = vec![false; tiles as usize];
            for cell in 0..cells {
                let range = tiles_of_cell(cell, finest, texels, tiles);
                assert!(!range.is_empty(), "cell {cell}");
                range.for_each(|tile| covered[tile as usize] = true);
            }
            assert!(covered.iter().all(|covered| *covered), "{finest} {texels}");
        }
    }
}
