//! Terrain: every height of a world follows from [`Parameters`] and a few injected features.
//!
//! Heights are integers on a global grid of points, made by diamond-square with hashed offsets (Fournier,
//! Fussell and Carpenter 1982). The world is divided into square patches: patch (X, Y) covers the points
//! X·2^n to (X + 1)·2^n in x, and likewise in y, borders included. Level l has every 2^(n − l)th of those;
//! level −j has every 2^j-th patch corner. Coordinates of a level are global: its point (x, y) is point
//! (x·2^(n − l), y·2^(n − l)) of the finest.
//!
//! - Any rectangle of any level is made alone ([`Terrain::window`]), the same on every machine: integers
//!   only, no clock, no order, no state.
//! - Neighbouring patches agree on their border.
//! - Level l is a subset of level l + 1.
//!
//! Grid x is a scene's x, grid y its z, height its y.

mod error;
mod fingerprint;
mod noise;
mod parameters;
mod rect;
mod refine;
mod window;

pub use error::TerrainError;
pub use fingerprint::fingerprint;
pub use parameters::{
    Distribution, Erosion, HALVING, MAX_BASE_HEIGHT, MAX_FINEST_LEVEL, PARAMETERS_BYTES, Parameters,
};
pub use window::Scratch;

use noise::LevelNoise;
use rect::Rect;

/// Most points of one window: 2^26, of 4 bytes each.
pub const MAX_WINDOW_POINTS: usize = 1 << 26;

/// A world of heights.
#[derive(Clone, Debug)]
pub struct Terrain {
    parameters: Parameters,
    noise: Vec<LevelNoise>,
}

impl Terrain {
    /// The terrain of some parameters, without features.
    ///
    /// # Errors
    /// If the parameters do not pass [`Parameters::check`].
    pub fn new(parameters: Parameters) -> Result<Self, TerrainError> {
        parameters.check()?;
        let ranges = parameters.ranges();
        let noise = (0..=parameters.finest_level)
            .map(|level| LevelNoise::new(&parameters, level, ranges[usize::from(level)]))
            .collect();
        Ok(Self { parameters, noise })
    }

    /// What the terrain follows from.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// n: the level of all points.
    #[must_use]
    pub fn finest_level(&self) -> i8 {
        self.parameters.finest_level as i8
    }

    /// The coarsest level there is: the one whose single cell is the world.
    #[must_use]
    pub fn coarsest_level(&self) -> i8 {
        -1 - self.parameters.extent_log2 as i8
    }

    /// Largest coordinate of a level's points; the smallest is its negative. The world's own edge belongs to
    /// it: on the finest level of the largest world, coordinates are −2^31 to 2^31.
    ///
    /// # Errors
    /// If there is no such level.
    pub fn edge(&self, level: i8) -> Result<i64, TerrainError> {
        let (lowest, finest) = (self.coarsest_level(), self.finest_level());
        if level < lowest || level > finest {
            let [level, lowest, finest] = [level, lowest, finest].map(i64::from);
            return Err(TerrainError::NoSuchLevel { level, lowest, finest });
        }
        Ok(1 << (i32::from(self.parameters.extent_log2) + i32::from(level)))
    }

    /// The heights of `width` x `height` points of `level` from (`x`, `y`) on, row by row, replacing what
    /// `out` held. Windows may lie anywhere in the world, across patches.
    ///
    /// Cost: about 4/3 of the points, and a few around them for each level above.
    ///
    /// # Errors
    /// If there is no such level, or the window is empty, too large, or not inside the world.
    #[allow(clippy::too_many_arguments)]
    pub fn window(
        &self,
        level: i8,
        x: i64,
        y: i64,
        width: usize,
        height: usize,
        scratch: &mut Scratch,
        out: &mut Vec<i32>,
    ) -> Result<(), TerrainError> {
        let rect = self.checked(level, x, y, width, height)?;
        self.base_window(level, rect, &mut scratch.heights, out);
        Ok(())
    }

    fn checked(&self, level: i8, x: i64, y: i64, width: usize, height: usize) -> Result<Rect, TerrainError> {
        let edge = self.edge(level)?;
        let limit = MAX_WINDOW_POINTS;
        if width.checked_mul(height).is_none_or(|points| points == 0 || points > limit) {
            return Err(TerrainError::BadWindow { width, height, limit });
        }
        let (x_end, y_end) = (x.saturating_add(width as i64 - 1), y.saturating_add(height as i64 - 1));
        if x < -edge || y < -edge || x_end > edge || y_end > edge {
            return Err(TerrainError::OutsideWorld { level, x, y, x_end, y_end, edge });
        }
        Ok(Rect::new(x, y, width, height))
    }

    /// The heights of patch (`x`, `y`) at a level from 0 to the finest: 2^level + 1 rows of as many.
    ///
    /// # Errors
    /// If there is no such level or patch.
    pub fn patch(&self, x: i64, y: i64, level: u8) -> Result<Vec<i32>, TerrainError> {
        let mut out = Vec::new();
        self.patch_into(x, y, level, &mut Scratch::new(), &mut out)?;
        Ok(out)
    }

    /// As [`Self::patch`], with memory to use again.
    ///
    /// # Errors
    /// As [`Self::patch`].
    pub fn patch_into(
        &self,
        x: i64,
        y: i64,
        level: u8,
        scratch: &mut Scratch,
        out: &mut Vec<i32>,
    ) -> Result<(), TerrainError> {
        let finest = self.parameters.finest_level;
        if level > finest {
            let [level, finest] = [level, finest].map(i64::from);
            return Err(TerrainError::NoSuchLevel { level, lowest: 0, finest });
        }
        let edge = 1 << self.parameters.extent_log2;
        if !(-edge..edge).contains(&x) || !(-edge..edge).contains(&y) {
            return Err(TerrainError::NoSuchPatch { x, y, edge });
        }
        let points = (1 << level) + 1;
        self.window(level as i8, x << level, y << level, points, points, scratch, out)
    }
}
