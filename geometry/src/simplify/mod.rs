//! Simplification: from the input to the base mesh, level by level, region by region.
//!
//! At a level's start the live faces are cut into regions. Within the level a collapse u → t is
//! allowed only if the whole stars of u *and* t lie in one region, so no outline changes and regions
//! are independent: simplified in any order, on any number of threads, with the same result. The next
//! level cuts anew, so outlines move. The collapses of one region are one chunk.

mod attributes;
mod commit;
mod deviation;
mod extent;
pub(crate) mod hierarchy;
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
mod quadric;
mod queue;
mod region;
mod resume;
pub(crate) mod settings;
mod star_table;
#[cfg(test)]
mod stops_test;
mod surroundings;

use crate::entropy::Codec;
use crate::error::MeshError;
use crate::mesh::QuantisedMesh;
use crate::mesh::vec3::{length, sub};
use crate::pool::{Stage, Watched};
use crate::simplify::deviation::{Deviation, extend};
use crate::simplify::extent::corners_to_hold;
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::level::{Level, truncate_globally};
use crate::simplify::levels::{Levels, Simplified};
use crate::simplify::limit::{Limit, limit_error};
use crate::simplify::live::Live;
use crate::simplify::measure::{Coarsening, measure};
use crate::simplify::resume::{End, Outcome};
use crate::simplify::settings::Settings;
use crate::spill::Spill;

/// Where a level is stuck, as many faces still fit into one region.
const MAX_REGION_FACES: usize = *Settings::REGION_FACES.end();
/// A level that removes less than this share of the vertices ends the hierarchy.
const LEAST_PROGRESS: f64 = 0.05;

/// `settings` must have passed [`Settings::check`].
pub(crate) fn simplify<'a>(
    mesh: &'a QuantisedMesh,
    settings: &Settings,
    pool: &mut Watched<'_>,
    spill: &'a dyn Spill,
) -> Result<Simplified<'a>, MeshError> {
    let mut live = Live::new(mesh);
    let mut deviation = Deviation::new(&live, mesh.uv_grid);
    let mut levels = Levels::new(spill);
    let mut stray_error = 0.0_f64;
    let diagonal = diagonal(mesh);
    let limit = Limit::new(&live, settings.base_error * diagonal, diagonal);
    let held = corners_to_hold(&live, limit.error, diagonal);
    let faces_total = live.faces.len();
    let region_faces = settings.region_faces;
    let top_faces = (settings.top_regions * region_faces as f64) as usize;
    let top_faces = top_faces.min(2 * MAX_REGION_FACES);
    let mut stuck = false;
    let mut shifts = vec![0];
    let mut shift = 0;
    while let Some(done) = levels.redo(&mut live, &mut deviation)? {
        (shift, stuck, stray_error) = (done.shift, done.little, done.stray_error);
        shifts.push(shift);
        pool.advance(faces_total - live.faces.len(), done.removed);
        pool.begin(Stage::Simplify)?;
        if done.last {
            live.finish();
            return Ok(Simplified { levels, live, stray_error, shifts });
        }
    }
    loop {
        pool.begin(Stage::Simplify)?;
        let last = live.faces.len() <= if stuck { top_faces.max(MAX_REGION_FACES) } else { top_faces };
        let count = if last { 1 } else { live.faces.len() / region_faces };
        let level = Level::new(&live, &deviation, levels.count(), count, &held);
        let tear = settings.unlock_outlines && levels.count() == 0;
        let mut records = level.simplify(&live, last, tear, settings, pool)?;
        if !last {
            truncate_globally(&mut records, &level, settings);
        }
        pool.begin(Stage::Measure)?;
        limit_error(&live, &deviation, &level, &mut records, &limit, settings, pool)?;
        pool.begin(Stage::Simplify)?;
        let vertices = level.vertices;
        for region in &mut records {
            region.choose_stops(settings.parts, settings.min_part_splits);
            region.costs = Vec::new();
        }
        let removed: usize = records.iter().map(|r| r.collapses.len()).sum();
        let wedges = live.wedges.len();
        pool.begin(Stage::Measure)?;
        // What the base mesh lacks besides counts against what it may: no coarser grid on the last way there.
        let share = if last { 0.0 } else { settings.coarse_grid };
        let coarsening = Coarsening { shift, share, limit: limit.error };
        let (mut chunks, next) =
            measure(&mut live, &mut deviation, &level, records, coarsening, pool, &mut stray_error)?;
        if settings.codec == Codec::Plain {
            chunks.iter_mut().for_each(RegionChunk::forget_stops);
        }
        drop(level);
        pool.advance(faces_total - live.faces.len(), removed);
        let little = (removed as f64) < LEAST_PROGRESS * vertices as f64;
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
            return Ok(Simplified { levels, live, stray_error, shifts });
        }
        // Outlines may be what is in the way: one more level, in one region.
        stuck = little;
    }
}

/// Diagonal of the bounding box in grid cells.
fn diagonal(mesh: &QuantisedMesh) -> f64 {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for p in &mesh.positions {
        extend(&mut bounds, p.map(f64::from));
    }
    length(sub(bounds[1], bounds[0]))
}
