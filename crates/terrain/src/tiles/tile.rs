//! Identifiers and sizes of tiles.

/// Cells along a tile's side, two triangles each. Smaller tiles adapt to distance more closely; but each is generated
/// with a margin, which then weighs more.
pub const TILE_CELLS: u32 = 8;
/// Height samples along a cell's side: normals come from a surface finer than the drawn one.
pub const CELL_SAMPLES: u32 = 2;
/// Samples beyond a tile's border on each side, which normals of its own and of the next coarser surface need.
pub const TILE_MARGIN: u32 = 2;
/// Samples along a tile's side, margins included.
pub const TILE_SAMPLES: u32 = TILE_CELLS * CELL_SAMPLES + 1 + 2 * TILE_MARGIN;

/// A square of [`TILE_CELLS`]² cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TileId {
    /// Binary logarithm of the distance between neighbouring points, in grid units of the finest level.
    pub spacing: u8,
    /// Number of the tile towards +x: it begins at `x · side()` grid units.
    pub x: i32,
    /// Number of the tile towards +y of the grid (+z of the world).
    pub y: i32,
}

impl TileId {
    /// Length of a side, in grid units.
    #[must_use]
    pub fn side(self) -> i64 {
        i64::from(TILE_CELLS) << self.spacing
    }

    /// First grid point, in grid units of the finest level.
    #[must_use]
    pub fn origin(self) -> [i64; 2] {
        [i64::from(self.x) * self.side(), i64::from(self.y) * self.side()]
    }

    /// One of the four tiles of half the spacing that cover this one, numbered row by row. The spacing must not be 0.
    #[must_use]
    pub fn child(self, quadrant: u8) -> Self {
        let (dx, dy) = (i32::from(quadrant & 1), i32::from(quadrant >> 1));
        Self { spacing: self.spacing - 1, x: 2 * self.x + dx, y: 2 * self.y + dy }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_cover_their_parent() {
        let parent = TileId { spacing: 5, x: -3, y: 7 };
        let [x, y] = parent.origin();
        let half = parent.side() / 2;
        let expected = [[x, y], [x + half, y], [x, y + half], [x + half, y + half]];
        for (quadrant, origin) in (0..4).zip(expected) {
            let child = parent.child(quadrant);
            assert_eq!(child.origin(), origin);
            assert_eq!(child.side(), half);
        }
    }
}
