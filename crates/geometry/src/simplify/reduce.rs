//! One level from partition to measurement.

use crate::entropy::Codec;
use crate::error::MeshError;
use crate::pool::{MonitoredPool, Stage};
use crate::simplify::deviation::Deviation;
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::level::{Fixed, Level, truncate_globally};
use crate::simplify::limit::{Limit, limit_error};
use crate::simplify::live::Live;
use crate::simplify::measure::{Coarsening, measure};
use crate::simplify::settings::Settings;
use crate::simplify::whole_components::{MAX_DROPPED_VERTICES, Visible};

/// Parameters shared by all levels of a mesh.
pub(crate) struct Reduction<'a> {
    pub(crate) settings: &'a Settings,
    pub(crate) limit: &'a Limit,
    pub(crate) fixed: Fixed<'a>,
}

/// Parameters of one level.
#[derive(Clone, Copy)]
pub(crate) struct LevelParameters {
    /// Counted from the finest.
    pub(crate) number: usize,
    /// Number of regions.
    pub(crate) count: usize,
    /// Whether its only region is simplified as far as possible.
    pub(crate) last: bool,
    /// Shift (low bits left out) of the grid at its start.
    pub(crate) shift: u8,
    /// [`Settings::coarse_grid`] of this level.
    pub(crate) coarse_grid: f64,
    /// Faces already removed from the complete mesh outside this part.
    pub(crate) done: usize,
}

/// Result of a level.
pub(crate) struct LevelResult {
    pub(crate) chunks: Vec<RegionChunk>,
    /// Shift of the grid at its end.
    pub(crate) shift: u8,
    /// Number of collapses.
    pub(crate) removed: usize,
    /// Number of vertices before the level.
    pub(crate) vertices: usize,
}

impl Reduction<'_> {
    /// Simplifies the mesh by one level.
    pub(crate) fn level(
        &self,
        live: &mut Live<'_>,
        deviation: &mut Deviation,
        place: LevelParameters,
        stray_error: &mut f64,
        pool: &mut MonitoredPool<'_>,
    ) -> Result<LevelResult, MeshError> {
        let &Self { settings, limit, fixed } = self;
        let LevelParameters { number, count, last, shift, coarse_grid, done } = place;
        pool.begin(Stage::Simplify)?;
        let visible = Visible { limit: limit.error, side: settings.visible_side * limit.error };
        let level = Level::new(live, deviation, number, count, fixed, visible, pool)?;
        let tear = settings.unlock_outlines && number == 0;
        let mut records = level.simplify(live, last, tear, settings, pool)?;
        if !last {
            truncate_globally(&mut records, &level, settings);
        }
        pool.begin(Stage::Measure)?;
        limit_error(live, deviation, &level, &mut records, limit, settings, pool)?;
        pool.begin(Stage::Simplify)?;
        let vertices = level.vertices;
        for region in &mut records {
            region.choose_truncation_points(settings.parts, settings.min_part_splits);
            if level.components.is_some() {
                region.align_truncation_points(MAX_DROPPED_VERTICES as usize);
            }
            region.costs = Vec::new();
        }
        let removed = records.iter().map(|r| r.collapses.len()).sum();
        pool.begin(Stage::Measure)?;
        let coarsening = Coarsening { shift, share: coarse_grid, limit: limit.error };
        let (mut chunks, shift) = measure(live, deviation, &level, records, coarsening, pool, stray_error)?;
        if settings.codec == Codec::Zstd {
            chunks.iter_mut().for_each(RegionChunk::clear_truncation_points);
        }
        pool.advance(done + live.alive.len() - live.faces.len(), removed);
        Ok(LevelResult { chunks, shift, removed, vertices })
    }
}
