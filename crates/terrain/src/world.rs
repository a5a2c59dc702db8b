//! A terrain, and windows of its heights.

use super::error::TerrainError;
use super::feature::{FeatureSet, Features};
use super::noise::LevelNoise;
use super::numbers::{signed, span};
use super::parameters::Parameters;
use super::patch_overrides::PatchOverrides;
use super::points::HeightOverrides;
use super::rect::Rect;
use super::refine::{Offsets, refine};
use super::stamp::{MAX_STAMPS, Stamp};
use super::window::{Buffers, Scratch, descend};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most points per window: 2^26, of 4 bytes each.
pub const MAX_WINDOW_POINTS: usize = 1 << 26;

/// A world of heights. Clones share the height overrides of patches.
#[derive(Clone, Debug)]
pub struct Terrain {
    pub(super) parameters: Parameters,
    pub(super) noise: Vec<LevelNoise>,
    pub(super) stamps: Vec<Stamp>,
    /// By column and row.
    pub(super) patches: BTreeMap<(i64, i64), Arc<PatchOverrides>>,
}

impl Terrain {
    /// A terrain with these parameters, without features.
    ///
    /// # Errors
    /// If the parameters do not pass [`Parameters::check`].
    pub fn new(parameters: Parameters) -> Result<Self, TerrainError> {
        parameters.check()?;
        let ranges = parameters.ranges();
        let noise = (0..=parameters.finest_level)
            .map(|level| LevelNoise::new(&parameters, level, ranges[usize::from(level)]))
            .collect();
        Ok(Self { parameters, noise, stamps: Vec::new(), patches: BTreeMap::new() })
    }

    /// A terrain with these parameters and stamps.
    ///
    /// # Errors
    /// As [`Self::new`], or if there are more than [`MAX_STAMPS`] or one does not pass [`Stamp::check`].
    pub fn with_stamps(parameters: Parameters, stamps: Vec<Stamp>) -> Result<Self, TerrainError> {
        let (count, limit) = (stamps.len(), MAX_STAMPS);
        if count > limit {
            return Err(TerrainError::TooMany { what: "stamps", count, limit });
        }
        for (index, stamp) in stamps.iter().enumerate() {
            let bad = |why| TerrainError::BadFeature { set: 0, what: "stamp", index, why };
            stamp.check().map_err(|e| bad(e.why))?;
        }
        Ok(Self { stamps, ..Self::new(parameters)? })
    }

    /// A terrain with these parameters and features.
    ///
    /// # Errors
    /// As [`Self::with_stamps`] and [`Features::gather`].
    pub fn with_features(parameters: Parameters, sets: &[FeatureSet]) -> Result<Self, TerrainError> {
        let features = Features::gather(&parameters, sets)?;
        let mut terrain = Self::with_stamps(parameters, features.stamps)?;
        for ((x, y), points) in features.patches {
            terrain.set_points(x, y, points)?;
        }
        Ok(terrain)
    }

    /// Sets the height overrides of patch (`x`, `y`), replacing earlier ones.
    ///
    /// Border points must be overridden in both patches. While only one has them, both show the border as in that
    /// one. With erosion, heights of a patch also depend on overrides of other patches: [`crate::Erosion::reach`].
    ///
    /// Cost: the heights below fixed points are generated, block by block.
    ///
    /// # Errors
    /// If there is no such patch, or a point is outside it.
    pub fn set_points(&mut self, x: i64, y: i64, points: HeightOverrides) -> Result<(), TerrainError> {
        self.check_patch(x, y)?;
        let side = 1 << self.parameters.finest_level;
        if let Some(p) = points.as_slice().iter().find(|p| p.x > side || p.y > side) {
            return Err(TerrainError::BadPoint { x: p.x, y: p.y, why: "is outside the patch" });
        }
        if points.is_empty() {
            self.patches.remove(&(x, y));
        } else {
            let differences = self.differences(x, y, points);
            self.patches.insert((x, y), Arc::new(differences));
        }
        Ok(())
    }

    /// Removes the height overrides of patch (`x`, `y`).
    pub fn remove_points(&mut self, x: i64, y: i64) {
        self.patches.remove(&(x, y));
    }

    /// The stamps, in order.
    #[must_use]
    pub fn stamps(&self) -> &[Stamp] {
        &self.stamps
    }

    /// The height overrides of patch (`x`, `y`).
    #[must_use]
    pub fn points(&self, x: i64, y: i64) -> Option<&HeightOverrides> {
        self.patches.get(&(x, y)).map(|patch| &patch.points)
    }

    /// The patches with height overrides, by column and row.
    pub fn patches_with_points(&self) -> impl Iterator<Item = (i64, i64)> {
        self.patches.keys().copied()
    }

    /// Whether overrides or stamps change anything in patch (`x`, `y`), possibly through erosion.
    #[must_use]
    pub fn has_features(&self, x: i64, y: i64) -> bool {
        let n = self.parameters.finest_level;
        let reach = self.parameters.erosion.reach(n) * i64::from(self.parameters.erosion.is_on());
        let (left, right) = ((x << n) - reach, ((x + 1) << n) + reach);
        let (top, bottom) = ((y << n) - reach, ((y + 1) << n) + reach);
        let around = Rect::from_corners(left, top, right, bottom);
        let own = self.patches.contains_key(&(x, y));
        let others = reach > 0
            && self.patches_near(signed(n), around).any(|(&(px, py), _)| {
                let patch = Rect::from_corners(px << n, py << n, (px + 1) << n, (py + 1) << n);
                patch.intersection(&around).is_some()
            });
        own || others
            || self.stamps.iter().any(|stamp| {
                let (columns, rows) = stamp.footprint();
                columns[0] <= right && columns[1] >= left && rows[0] <= bottom && rows[1] >= top
            })
    }

    /// Memory held by height overrides, in bytes.
    #[must_use]
    pub fn points_bytes(&self) -> usize {
        self.patches.values().map(|patch| patch.bytes()).sum()
    }

    /// The parameters.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// n: the finest level.
    #[must_use]
    pub fn finest_level(&self) -> i8 {
        signed(self.parameters.finest_level)
    }

    /// The coarsest level: the world is two of its cells wide.
    #[must_use]
    pub fn coarsest_level(&self) -> i8 {
        -signed(self.parameters.extent_log2)
    }

    /// Largest coordinate of a level's points; the smallest is its negative. The edge is part of the world: on the
    /// finest level of the largest world, coordinates are −2^31 to 2^31.
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

    /// The heights of `width` x `height` points of `level` from (`x`, `y`) on, row by row; replaces the contents of
    /// `out`. Windows may span patches.
    ///
    /// Cost: about 4/3 of the points, and a few around them per coarser level.
    ///
    /// # Errors
    /// If there is no such level, or the window is empty, too large, or not inside the world.
    #[expect(clippy::too_many_arguments, reason = "four of them are one window, as everywhere")]
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
        if self.parameters.erosion.is_on() {
            self.eroded_window(level, rect, scratch, out);
        } else {
            self.featured(level, rect, scratch, out);
        }
        Ok(())
    }

    /// Heights with features, without erosion.
    pub(super) fn featured(&self, level: i8, rect: Rect, scratch: &mut Scratch, out: &mut Vec<i32>) {
        self.stamped(level, rect, &mut scratch.heights, out);
        self.add_differences(level, rect, scratch, out);
    }

    /// Heights with stamps only.
    pub(super) fn stamped(&self, level: i8, rect: Rect, buffers: &mut Buffers<i32>, out: &mut Vec<i32>) {
        self.base_window(level, rect, buffers, out);
        let shift = i32::from(self.parameters.finest_level).abs_diff(i32::from(level));
        for stamp in &self.stamps {
            stamp.apply(self.parameters.base, rect, shift, out);
        }
    }

    fn checked(&self, level: i8, x: i64, y: i64, width: usize, height: usize) -> Result<Rect, TerrainError> {
        let edge = self.edge(level)?;
        let limit = MAX_WINDOW_POINTS;
        if width.checked_mul(height).is_none_or(|points| points == 0 || points > limit) {
            return Err(TerrainError::BadWindow { width, height, limit });
        }
        let (x_end, y_end) = (x.saturating_add(span(width) - 1), y.saturating_add(span(height) - 1));
        if x < -edge || y < -edge || x_end > edge || y_end > edge {
            return Err(TerrainError::OutsideWorld { level, x, y, x_end, y_end, edge });
        }
        Ok(Rect::new(x, y, width, height))
    }

    /// The heights of patch (`x`, `y`) at a level from 0 to the finest: 2^level + 1 rows of that many points.
    ///
    /// # Errors
    /// If there is no such level or patch.
    pub fn patch(&self, x: i64, y: i64, level: u8) -> Result<Vec<i32>, TerrainError> {
        let mut out = Vec::new();
        self.patch_into(x, y, level, &mut Scratch::new(), &mut out)?;
        Ok(out)
    }

    /// As [`Self::patch`], with reusable buffers.
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
        self.check_patch(x, y)?;
        let points = (1 << level) + 1;
        self.window(signed(level), x << level, y << level, points, points, scratch, out)
    }

    pub(super) fn check_patch(&self, x: i64, y: i64) -> Result<(), TerrainError> {
        let edge = 1 << self.parameters.extent_log2;
        if !(-edge..edge).contains(&x) || !(-edge..edge).contains(&y) {
            return Err(TerrainError::NoSuchPatch { x, y, edge });
        }
        Ok(())
    }

    /// Heights of a rectangle of any `level` without features or erosion.
    pub(super) fn base_window(&self, level: i8, rect: Rect, buffers: &mut Buffers<i32>, out: &mut Vec<i32>) {
        if level < 0 {
            return self.corners(rect, u32::from(level.unsigned_abs()), out);
        }
        descend(
            rect,
            0,
            level.unsigned_abs(),
            buffers,
            out,
            |rect, out| self.corners(rect, 0, out),
            |parent, level, out| {
                let noise = self.noise(level);
                if noise.is_gaussian() {
                    refine(parent, level, &Offsets::<true>(noise), out);
                } else {
                    refine(parent, level, &Offsets::<false>(noise), out);
                }
            },
        );
    }

    /// Every 2^`sparse`th patch corner.
    fn corners(&self, rect: Rect, sparse: u32, out: &mut Vec<i32>) {
        out.clear();
        let noise = self.noise(0);
        for y in rect.y..=rect.bottom() {
            for x in rect.x..=rect.right() {
                out.push(self.parameters.base + noise.at(x << sparse, y << sparse));
            }
        }
    }

    pub(super) fn noise(&self, level: u8) -> &LevelNoise {
        &self.noise[usize::from(level)]
    }
}
