//! Heights at single positions.

use super::error::TerrainError;
use super::numbers::{real, truncated};
use super::window::Scratch;
use super::world::Terrain;

impl Terrain {
    /// The height of a point of the finest grid.
    ///
    /// Cost: some ten points per level, about a microsecond without erosion.
    ///
    /// # Errors
    /// If the point is not in the world.
    pub fn height_at(&self, x: i64, y: i64, scratch: &mut Scratch) -> Result<i32, TerrainError> {
        let mut heights = Vec::with_capacity(1);
        self.window(self.finest_level(), x, y, 1, 1, scratch, &mut heights)?;
        Ok(heights[0])
    }

    /// The height at any position, in height units: linear on the triangles of the finest grid, whose cells are split
    /// from (x, y) to (x + 1, y + 1).
    ///
    /// Positions outside the world have the height of the nearest position on its edge; NaN counts as 0.
    #[must_use]
    pub fn height_between(&self, x: f64, y: f64, scratch: &mut Scratch) -> f64 {
        let edge = 1_i64 << (self.parameters.extent_log2 + self.parameters.finest_level);
        // The cell, and the position in it; the far side of the last cell belongs to it.
        let place = |at: f64| {
            let at = if at.is_nan() { 0.0 } else { at.clamp(real(-edge), real(edge)) };
            let cell = truncated(at.floor()).min(edge - 1);
            (cell, at - real(cell))
        };
        let ((cell_x, u), (cell_y, v)) = (place(x), place(y));
        let mut heights = Vec::with_capacity(4);
        if self.window(self.finest_level(), cell_x, cell_y, 2, 2, scratch, &mut heights).is_err() {
            return f64::from(self.parameters.base);
        }
        let [a, b, c, d] = std::array::from_fn(|i| f64::from(heights[i]));
        if u >= v { a + u * (b - a) + v * (d - b) } else { a + v * (c - a) + u * (d - c) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Parameters;

    #[test]
    fn a_place_lies_on_the_triangle_of_its_cell() {
        let terrain = Terrain::new(Parameters { finest_level: 4, extent_log2: 3, ..Parameters::default() });
        let (terrain, scratch) = (terrain.unwrap(), &mut Scratch::new());
        let mut at = |x, y| f64::from(terrain.height_at(x, y, scratch).unwrap());
        let (a, b, c, d) = (at(-5, 7), at(-4, 7), at(-5, 8), at(-4, 8));
        let scratch = &mut Scratch::new();
        assert_eq!(terrain.height_between(-5.0, 7.0, scratch), a);
        assert_eq!(terrain.height_between(-4.5, 7.5, scratch), (a + d) / 2.0);
        assert_eq!(terrain.height_between(-4.25, 7.25, scratch), a + 0.75 * (b - a) + 0.25 * (d - b));
        assert_eq!(terrain.height_between(-4.75, 7.75, scratch), a + 0.75 * (c - a) + 0.25 * (d - c));
        let corner = f64::from(terrain.height_at(128, -128, scratch).unwrap());
        assert_eq!(terrain.height_between(f64::INFINITY, -1e30, scratch), corner);
        assert_eq!(
            terrain.height_between(f64::NAN, 0.0, scratch),
            f64::from(terrain.height_at(0, 0, scratch).unwrap())
        );
        assert!(terrain.height_at(129, 0, scratch).unwrap_err().to_string().contains("outside the world"));
    }
}
