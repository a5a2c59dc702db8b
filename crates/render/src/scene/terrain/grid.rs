//! The index pattern that all tiles share.

use lodestream_terrain::tiles::TILE_CELLS;

/// Indices of one quadrant.
pub(crate) const QUADRANT_INDICES: u32 = (TILE_CELLS / 2) * (TILE_CELLS / 2) * 6;

/// Triangles of a tile's cells, quadrant after quadrant (numbered row by row). Vertex `row · (TILE_CELLS + 1) + column`.
/// Each cell is split along the diagonal from its first point to the opposite one, so that two by two cells hold the
/// triangles of one coarser cell.
pub(crate) fn indices() -> Vec<u16> {
    let half = TILE_CELLS / 2;
    let mut indices = Vec::with_capacity(4 * QUADRANT_INDICES as usize);
    for quadrant in 0..4 {
        let (x0, y0) = ((quadrant & 1) * half, (quadrant >> 1) * half);
        for y in y0..y0 + half {
            for x in x0..x0 + half {
                let at = |dx: u32, dy: u32| ((y + dy) * (TILE_CELLS + 1) + x + dx) as u16;
                // Anticlockwise from above: y of the grid is +z of the world.
                indices.extend([at(0, 0), at(1, 1), at(1, 0), at(0, 0), at(0, 1), at(1, 1)]);
            }
        }
    }
    indices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadrants_cover_the_tile_once() {
        let indices = indices();
        assert_eq!(indices.len() as u32, 4 * QUADRANT_INDICES);
        let side = TILE_CELLS + 1;
        let mut area = [0_i64; 4];
        for (number, triangle) in indices.chunks(3).enumerate() {
            let [a, b, c] = [0, 1, 2].map(|i| {
                let index = u32::from(triangle[i]);
                [i64::from(index % side), i64::from(index / side)]
            });
            // Twice the signed area in (x, z): negative is anticlockwise seen from +y.
            let twice = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            assert_eq!(twice, -1);
            let quadrant = number / (QUADRANT_INDICES as usize / 3);
            area[quadrant] += twice;
            let half = i64::from(TILE_CELLS / 2);
            for p in [a, b, c] {
                let x0 = (quadrant as i64 & 1) * half;
                let y0 = (quadrant as i64 >> 1) * half;
                assert!((x0..=x0 + half).contains(&p[0]) && (y0..=y0 + half).contains(&p[1]));
            }
        }
        assert_eq!(area, [-i64::from(TILE_CELLS * TILE_CELLS / 2); 4]);
    }
}
