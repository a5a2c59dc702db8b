//! The tiles of one texture: which are there, and for each place of each level the finest that can be drawn.
//!
//! A word of the page table: page (12 bits), level of the page's tile (5 bits, 0: none, as the coarsest level is never
//! tiled), and from bit 24 how far it has faded in (255: done).

use std::ops::Range;

use lodestream_scene::asset::level_size;
use lodestream_scene::asset::tiles::tile_grid;

use super::uniform::{MAX_TILED_LEVELS, TiledMap};
use crate::resources::texture_shape::TextureShape;

/// Number of a page within its array.
pub(super) type PageNumber = u16;
/// Fade of a tile that is drawn alone.
pub(super) const FADED_IN: u8 = 255;
/// Bits of a word before the level.
const PAGE_BITS: u32 = 12;
/// Bits of a word before the fade.
const FADE_SHIFT: u32 = 24;
/// Most pages that a word can name.
pub(super) const MAX_PAGES: u32 = 1 << PAGE_BITS;

/// A place of a tile: level (0 is the texture's coarsest), column and row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct TilePlace {
    pub(crate) level: u32,
    pub(crate) column: u32,
    pub(crate) row: u32,
}

/// A tile that is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    pub(super) page: PageNumber,
    pub(super) fade: u8,
}

/// Tiles of one level.
#[derive(Debug)]
struct GridLevel {
    columns: u32,
    rows: u32,
    /// Where its words begin among the texture's.
    first: u32,
    tiles: Vec<Option<Tile>>,
}

impl GridLevel {
    fn index(&self, column: u32, row: u32) -> usize {
        row as usize * self.columns as usize + column as usize
    }
}

/// Tiles of one texture.
#[derive(Debug)]
pub(super) struct TileGrid {
    size: [u32; 2],
    all_levels: u32,
    whole: u32,
    levels: Vec<GridLevel>,
}

impl TileGrid {
    /// No tiles, of a texture whose levels from `whole` on are tiled.
    pub(super) fn new(shape: &TextureShape, whole: u32) -> Self {
        let size = [shape.width, shape.height];
        let mut first = 0;
        let tiled = (whole..shape.levels).map(|level| {
            let [columns, rows] = tile_grid(level_size(size, shape.levels, level));
            let count = columns * rows;
            first += count;
            GridLevel { columns, rows, first: first - count, tiles: vec![None; count as usize] }
        });
        Self { size, all_levels: shape.levels, whole, levels: tiled.collect() }
    }

    /// Number of words of the table.
    pub(super) fn words(&self) -> u32 {
        self.levels.last().map_or(0, |level| level.first + level.columns * level.rows)
    }

    /// What a material's uniform says of the texture, whose words begin at `base`.
    pub(super) fn map(&self, base: u32) -> TiledMap {
        let mut tables = [0; MAX_TILED_LEVELS];
        for (table, level) in tables.iter_mut().zip(&self.levels) {
            *table = base + level.first;
        }
        TiledMap { levels: self.all_levels, whole: self.whole, size: self.size, tables, padding: 0 }
    }

    fn level(&self, place: TilePlace) -> Option<&GridLevel> {
        self.levels.get(place.level.checked_sub(self.whole)? as usize)
    }

    /// The tile at a place.
    pub(super) fn tile(&self, place: TilePlace) -> Option<Tile> {
        let level = self.level(place).filter(|level| place.column < level.columns)?;
        *level.tiles.get(level.index(place.column, place.row))?
    }

    /// Replaces a tile, and the words of all places that show it or did; `words` are the texture's. Reports the ranges
    /// of words that were written.
    pub(super) fn set(
        &mut self,
        place: TilePlace,
        tile: Option<Tile>,
        words: &mut [u32],
        written: impl FnMut(Range<u32>),
    ) {
        let Some(at) = place.level.checked_sub(self.whole).map(|at| at as usize) else { return };
        let Some(level) = self.levels.get_mut(at) else { return };
        let index = level.index(place.column, place.row);
        level.tiles[index] = tile;
        let (columns, rows) = (place.column..place.column + 1, place.row..place.row + 1);
        self.refresh(at, (columns, rows), words, written);
    }

    /// Writes the words of a rectangle of places, and of all places below.
    fn refresh(
        &self,
        first: usize,
        (mut columns, mut rows): (Range<u32>, Range<u32>),
        words: &mut [u32],
        mut written: impl FnMut(Range<u32>),
    ) {
        for at in first..self.levels.len() {
            let level = &self.levels[at];
            let coarser = at.checked_sub(1).map(|at| &self.levels[at]);
            if let Some(coarser) = coarser.filter(|_| at > first) {
                columns = below(columns, coarser.columns, level.columns);
                rows = below(rows, coarser.rows, level.rows);
            }
            for row in rows.clone() {
                for column in columns.clone() {
                    let index = level.index(column, row);
                    words[level.first as usize + index] = match (level.tiles[index], coarser) {
                        (Some(Tile { page, fade }), _) => {
                            let number = self.whole + at as u32;
                            u32::from(page) | number << PAGE_BITS | u32::from(fade) << FADE_SHIFT
                        }
                        (None, Some(coarser)) => {
                            let above = [above(column, coarser.columns), above(row, coarser.rows)];
                            words[coarser.first as usize + coarser.index(above[0], above[1])]
                        }
                        (None, None) => 0,
                    };
                }
                let first = level.first + row * level.columns;
                written(first + columns.start..first + columns.end);
            }
        }
    }

    /// All tiles with their places.
    pub(super) fn tiles(&self) -> impl Iterator<Item = (TilePlace, Tile)> {
        (self.whole..).zip(&self.levels).flat_map(|(number, level)| {
            (0..).zip(&level.tiles).filter_map(move |(index, tile)| {
                let (column, row) = (index % level.columns, index / level.columns);
                Some((TilePlace { level: number, column, row }, (*tile)?))
            })
        })
    }

    /// Gives each tile the page that `moved` says, and writes all words.
    pub(super) fn renumber(
        &mut self,
        moved: impl Fn(PageNumber) -> PageNumber,
        words: &mut [u32],
        written: impl FnMut(Range<u32>),
    ) {
        for tile in self.levels.iter_mut().flat_map(|level| &mut level.tiles).flatten() {
            tile.page = moved(tile.page);
        }
        let Some(coarsest) = self.levels.first() else { return };
        self.refresh(0, (0..coarsest.columns, 0..coarsest.rows), words, written);
    }
}

/// The column or row of the next coarser level, which has `count`.
fn above(number: u32, count: u32) -> u32 {
    (number / 2).min(count - 1)
}

/// The columns or rows of the next finer level of `finer_count`, below some of `count`. The last has what is left over
/// where the finer level has an odd number of texels.
fn below(range: Range<u32>, count: u32, finer_count: u32) -> Range<u32> {
    let end = if range.end == count { finer_count } else { (2 * range.end).min(finer_count) };
    (2 * range.start).min(end)..end
}

#[cfg(test)]
mod tests {
    use lodestream_scene::asset::TextureKind;

    use super::*;

    /// The word of a place, found by walking up from it.
    fn expected(grid: &TileGrid, place: TilePlace) -> u32 {
        for level in (grid.whole..=place.level).rev() {
            let [columns, rows] = tile_grid(level_size(grid.size, grid.all_levels, level));
            let coarser = place.level - level;
            let [column, row] = [(place.column, columns), (place.row, rows)]
                .map(|(number, count)| (number >> coarser).min(count - 1));
            if let Some(tile) = grid.tile(TilePlace { level, column, row }) {
                return u32::from(tile.page) | level << 12 | u32::from(tile.fade) << 24;
            }
        }
        0
    }

    #[test]
    fn words_name_the_finest_tile_at_or_above_after_any_changes() {
        for size in [(4096, 4096), (1000, 700), (2048, 1), (1025, 3333), (513, 513)] {
            let shape = TextureShape::full(size.0, size.1, TextureKind::Color).tiled();
            let mut grid = TileGrid::new(&shape, shape.whole_levels);
            let mut words = vec![0; grid.words() as usize];
            let mut seen = words.clone();
            let mut state = 1_u32;
            for page in 0..300 {
                // Numerical Recipes' generator.
                let mut random = |below: u32| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 8) % below
                };
                let level = shape.whole_levels + random(shape.levels - shape.whole_levels);
                let [columns, rows] = tile_grid(shape.level_size(level).into());
                let place = TilePlace { level, column: random(columns), row: random(rows) };
                let tile = (random(3) > 0).then_some(Tile { page, fade: random(256) as u8 });
                let mut ranges = Vec::new();
                grid.set(place, tile, &mut words, |range| ranges.push(range));
                for range in ranges {
                    let range = range.start as usize..range.end as usize;
                    seen[range.clone()].copy_from_slice(&words[range]);
                }
                assert_eq!(seen, words, "all that was written is reported");
            }
            for (number, level) in (shape.whole_levels..).zip(&grid.levels) {
                for (row, column) in (0..level.rows).flat_map(|row| (0..level.columns).map(move |c| (row, c)))
                {
                    let word = words[level.first as usize + level.index(column, row)];
                    assert_eq!(word, expected(&grid, TilePlace { level: number, column, row }), "{size:?}");
                }
            }
        }
    }

    #[test]
    fn a_change_writes_only_what_is_below_it() {
        let shape = TextureShape::full(8192, 8192, TextureKind::Color).tiled();
        let mut grid = TileGrid::new(&shape, shape.whole_levels);
        let mut words = vec![0; grid.words() as usize];
        let mut written = |level, column, row| {
            let mut sum = 0;
            let tile = Some(Tile { page: 1, fade: 0 });
            let place = TilePlace { level, column, row };
            grid.set(place, tile, &mut words, |range| sum += range.end - range.start);
            sum
        };
        assert_eq!(written(13, 5, 6), 1);
        assert_eq!(written(12, 5, 6), 1 + 4);
        assert_eq!(written(9, 1, 0), 1 + 4 + 16 + 64 + 256);
    }
}
