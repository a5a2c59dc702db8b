//! Simplification from the input to the base mesh, level by level, region by region.
//!
//! Each level partitions the live faces into regions. A collapse u → t is allowed only if the complete stars of u
//! *and* t are in one region, so outlines do not change and regions are independent: they can be simplified in any
//! order, on any number of threads, with the same result. The next level partitions anew, so outlines move. The
//! collapses of one region are one chunk.

mod attributes;
pub(crate) mod blocks;
mod commit;
mod deviation;
mod extent;
pub(crate) mod hierarchy;
mod inherited;
mod input_faces;
mod legality;
mod level;
pub(crate) mod levels;
mod limit;
mod live;
mod measure;
mod metric;
mod packed;
mod partition;
mod placement;
mod posed;
mod quadric;
mod queue;
mod reduce;
mod region;
mod resume;
pub(crate) mod settings;
mod star_table;
mod surroundings;
#[cfg(test)]
mod truncation_test;
mod whole_components;

#[cfg(test)]
use crate::checkpoint::CheckpointStore;
use crate::entropy::Codec;
use crate::error::MeshError;
use crate::mesh::QuantisedMesh;
use crate::pool::{MonitoredPool, Stage};
use crate::simplify::blocks::apply_last_levels;
use crate::simplify::blocks::merged::Merged;
use crate::simplify::deviation::Deviation;
use crate::simplify::extent::{corners_to_hold, diagonal};
use crate::simplify::level::Fixed;
use crate::simplify::levels::{Levels, Simplified};
use crate::simplify::limit::Limit;
use crate::simplify::live::Live;
use crate::simplify::reduce::{LevelParameters, LevelResult, Reduction};
use crate::simplify::resume::{End, Outcome};
use crate::simplify::settings::Settings;

/// If a level makes little progress, up to this many faces are put into one region.
const MAX_REGION_FACES: usize = *Settings::REGION_FACES.end();
/// A level that removes less than this share of the vertices ends the hierarchy.
const MIN_PROGRESS: f64 = 0.05;

/// Simplifies a mesh of any size. `settings` must have passed [`Settings::check`].
#[cfg(test)]
pub(crate) fn simplify<'a>(
    mesh: &'a QuantisedMesh,
    settings: &Settings,
    pool: &mut MonitoredPool<'_>,
    checkpoint: &'a dyn CheckpointStore,
) -> Result<Simplified<'a>, MeshError> {
    simplify_from(mesh, None, settings, pool, Levels::new(checkpoint))
}

/// Simplifies a mesh, or the merged result of blocks, whose levels are the first of `levels`. `settings` must have
/// passed [`Settings::check`].
pub(crate) fn simplify_from<'a>(
    mesh: &'a QuantisedMesh,
    merged: Option<&'a Merged>,
    settings: &Settings,
    pool: &mut MonitoredPool<'_>,
    mut levels: Levels<'a>,
) -> Result<Simplified<'a>, MeshError> {
    let left = merged.map_or(mesh, |merged| &merged.mesh);
    let mut live = Live::new(left, settings.codec);
    let inherited = merged.map(|merged| merged.inherited.clone()).unwrap_or_default();
    let diagonal = diagonal(mesh);
    let limit =
        Limit::new(&live, (settings.base_error * diagonal - inherited.max_geometric()).max(0.0), diagonal);
    let mut deviation = Deviation::new(&live, pool)?.with_inherited(inherited);
    let mut stray_error = merged.map_or(0.0, |merged| merged.stray_error);
    let mut shifts = vec![0; 1 + levels.count()];
    // Components of a mesh with parts keep their shape anyway.
    let mut held = if live.has_parts() { Vec::new() } else { corners_to_hold(&live, limit.error, diagonal) };
    if let Some(merged) = merged {
        apply_last_levels(merged, mesh, &mut live, &levels)?;
        deviation.search_all(&live, pool)?;
        held.iter_mut().for_each(|v| *v = live.successor(*v));
        held.sort_unstable();
        held.dedup();
    }
    let reduction = Reduction { settings, limit: &limit, fixed: Fixed { held: &held, locked: &[] } };
    // Faces removed by the levels of blocks.
    let gone = mesh.faces.len() - left.faces.len();
    let done = |live: &Live<'_>| gone + live.alive.len() - live.faces.len();
    let region_faces = settings.region_faces;
    let top_faces = (settings.top_regions * region_faces as f64) as usize;
    let top_faces = top_faces.min(2 * MAX_REGION_FACES);
    let mut stuck = false;
    let mut shift = 0;
    levels.rename_by(merged.map(|merged| &merged.names));
    while let Some(outcome) = levels.restore(&mut live, &mut deviation)? {
        (shift, stuck, stray_error) = (outcome.shift, outcome.little, outcome.stray_error);
        shifts.push(shift);
        pool.advance(done(&live), outcome.removed);
        pool.begin(Stage::Simplify)?;
        if outcome.last {
            live.finish();
            return Ok(Simplified::new(mesh, merged, levels, live, stray_error, shifts));
        }
    }
    loop {
        pool.begin(Stage::Simplify)?;
        let last = live.faces.len() <= if stuck { top_faces.max(MAX_REGION_FACES) } else { top_faces };
        let count = if last { 1 } else { live.faces.len() / region_faces };
        // The last level to the base mesh uses no coarser grid, because its error counts against the limit; a mesh with
        // parts uses none, because it would be coarser than its parts.
        let one_grid = last || settings.codec == Codec::AxisAligned || live.has_parts();
        let coarse_grid = if one_grid { 0.0 } else { settings.coarse_grid };
        let place = LevelParameters { number: levels.count(), count, last, shift, coarse_grid, done: gone };
        let wedges = live.wedges.len();
        let LevelResult { chunks, shift: next, removed, vertices } =
            reduction.level(&mut live, &mut deviation, place, &mut stray_error, pool)?;
        let little = (removed as f64) < MIN_PROGRESS * vertices as f64;
        let last = last || (little && (stuck || live.faces.len() > MAX_REGION_FACES));
        if !chunks.is_empty() {
            let outcome = Outcome { chunks: chunks.len(), shift: next, little, last, removed, stray_error };
            let moves = chunks.iter().flat_map(|chunk| &chunk.moves);
            let end = levels.resumes().then(|| End::new(outcome, moves, wedges, &live, &deviation));
            levels.push(chunks, &live)?;
            if let Some(end) = end {
                levels.close(&end)?;
            }
            shifts.push(next);
            shift = next;
        }
        if last {
            live.finish();
            return Ok(Simplified::new(mesh, merged, levels, live, stray_error, shifts));
        }
        // Outlines may be the obstacle: one more level, in one region.
        stuck = little;
    }
}
