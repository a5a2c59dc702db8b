//! One level from end to end: cut, simplified, kept within its limit, measured.

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

/// What all levels of a mesh go by.
pub(crate) struct Reduction<'a> {
    pub(crate) settings: &'a Settings,
    pub(crate) limit: &'a Limit,
    pub(crate) fixed: Fixed<'a>,
}

/// Which level it is.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    /// Counted from the finest.
    pub(crate) number: usize,
    /// How many regions it is cut into.
    pub(crate) count: usize,
    /// Its one region goes as far as it can.
    pub(crate) last: bool,
    /// Bits that the grid of its start leaves out.
    pub(crate) shift: u8,
    /// [`Settings::coarse_grid`] of this level.
    pub(crate) coarse_grid: f64,
    /// Faces of the whole that are no more, beside those that are missing here.
    pub(crate) done: usize,
}

/// What became of a level.
pub(crate) struct Reduced {
    pub(crate) chunks: Vec<RegionChunk>,
    /// Bits that the grid of its end leaves out.
    pub(crate) shift: u8,
    /// Its collapses.
    pub(crate) removed: usize,
    /// Vertices that there were.
    pub(crate) vertices: usize,
}

impl Reduction<'_> {
    /// Takes the mesh a level further.
    pub(crate) fn level(
        &self,
        live: &mut Live<'_>,
        deviation: &mut Deviation,
        place: Place,
        stray_error: &mut f64,
        pool: &mut MonitoredPool<'_>,
    ) -> Result<Reduced, MeshError> {
        let &Self { settings, limit, fixed } = self;
        let Place { number, count, last, shift, coarse_grid, done } = place;
        pool.begin(Stage::Simplify)?;
        let level = Level::new(live, deviation, number, count, fixed, pool)?;
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
            region.costs = Vec::new();
        }
        let removed = records.iter().map(|r| r.collapses.len()).sum();
        pool.begin(Stage::Measure)?;
        let coarsening = Coarsening { shift, share: coarse_grid, limit: limit.error };
        let (mut chunks, shift) = measure(live, deviation, &level, records, coarsening, pool, stray_error)?;
        if settings.codec == Codec::Zstd {
            chunks.iter_mut().for_each(RegionChunk::forget_truncation_points);
        }
        pool.advance(done + live.alive.len() - live.faces.len(), removed);
        Ok(Reduced { chunks, shift, removed, vertices })
    }
}
