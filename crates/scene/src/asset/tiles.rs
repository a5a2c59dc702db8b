//! Tiles of large texture levels: squares of [`TILE_SIDE`] texels that are sent and kept one by one.
//!
//! A tile's image has [`TILE_BORDER`] more texels on each side: its neighbours' texels of the same level, and at the
//! level's outer edge those of the opposite edge, as repeating textures need. So a tile can be filtered bilinearly
//! without its neighbours. One texel would do for its own level. The second is for finer levels that a tile stands in
//! for: sides are halved and rounded down, so what a finer tile covers may begin up to a texel before the coarser one.

use std::ops::Range;

use super::{TextureInfo, TextureKind, TextureLevel};

/// Texels along the side of a tile, without borders.
pub const TILE_SIDE: u32 = 256;
/// Texels of the border on each side of a tile's image.
pub const TILE_BORDER: u32 = 2;

/// Number of columns and rows of a level's tiles.
#[must_use]
pub fn tile_grid(level_size: [u32; 2]) -> [u32; 2] {
    level_size.map(|side| side.max(1).div_ceil(TILE_SIDE))
}

/// The texels that a tile covers without borders, in x and y; empty beyond the level.
#[must_use]
pub fn tile_texels(level_size: [u32; 2], column: u32, row: u32) -> [Range<u32>; 2] {
    let along = |side: u32, number: u32| {
        let first = number.saturating_mul(TILE_SIDE).min(side);
        first..first.saturating_add(TILE_SIDE).min(side)
    };
    [along(level_size[0], column), along(level_size[1], row)]
}

/// Width and height of a tile's image, with borders.
#[must_use]
pub fn tile_size(level_size: [u32; 2], column: u32, row: u32) -> [u32; 2] {
    tile_texels(level_size, column, row).map(|texels| texels.end - texels.start + 2 * TILE_BORDER)
}

/// Whether a level is small enough to stay whole: both sides are at most a tile's.
#[must_use]
pub fn is_whole(level_size: [u32; 2]) -> bool {
    level_size.iter().all(|side| *side <= TILE_SIDE)
}

/// Whether a level of a texture is cut into tiles. Heights are not: relief mapping follows rays through them.
#[must_use]
pub fn is_tiled(kind: TextureKind, level_size: [u32; 2]) -> bool {
    kind != TextureKind::Height && !is_whole(level_size)
}

/// Column and row of the `tile`-th tile of a level, row by row.
#[must_use]
pub fn tile_place(level_size: [u32; 2], tile: u16) -> [u32; 2] {
    let columns = tile_grid(level_size)[0];
    [u32::from(tile) % columns, u32::from(tile) / columns]
}

impl TextureLevel {
    /// Width and height, in texels.
    #[must_use]
    pub const fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }
}

impl TextureInfo {
    /// Number of levels that are one image each: the coarser ones.
    #[must_use]
    pub fn whole_levels(&self) -> usize {
        self.levels.partition_point(|level| !is_tiled(self.kind, level.size()))
    }

    /// Number of images of a level: 1, or that of its tiles.
    #[must_use]
    pub fn images(&self, level: usize) -> u32 {
        match self.levels.get(level) {
            Some(level) if is_tiled(self.kind, level.size()) => tile_grid(level.size()).iter().product(),
            Some(_) => 1,
            None => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_each_texel_once_and_images_have_borders() {
        for size in [[1000, 700], [2048, 1], [256, 257], [1, 1], [512, 512]] {
            let [columns, rows] = tile_grid(size);
            let mut texels = 0;
            for row in 0..rows {
                for column in 0..columns {
                    let [x, y] = tile_texels(size, column, row);
                    assert!(!x.is_empty() && !y.is_empty(), "{size:?} {column} {row}");
                    assert_eq!([x.start, y.start], [TILE_SIDE * column, TILE_SIDE * row]);
                    assert_eq!(tile_size(size, column, row), [x.len() as u32 + 4, y.len() as u32 + 4]);
                    texels += x.len() * y.len();
                }
            }
            assert_eq!(texels, size[0] as usize * size[1] as usize);
        }
        assert_eq!(tile_size([1000, 700], 3, 2), [236, 192]);
        assert_eq!(tile_size([1000, 700], 9, 0), [4, 260], "beyond the level");
    }

    #[test]
    fn levels_of_a_tile_or_less_stay_whole() {
        assert!(is_whole([256, 1]) && is_whole([256, 256]));
        assert!(!is_whole([257, 1]) && !is_whole([4, 512]));
        assert!(is_tiled(TextureKind::Color, [1, 257]) && !is_tiled(TextureKind::Height, [4096, 4096]));
        assert_eq!(tile_place([1000, 700], 6), [2, 1]);
        assert!(u16::try_from(tile_grid([1 << 15; 2]).iter().product::<u32>() - 1).is_ok());
    }
}
