//! Simplification: from the input to the base mesh, level by level, region by region.
//!
//! At a level's start the live faces are cut into regions. Within the level a collapse u → t is
//! allowed only if the whole stars of u *and* t lie in one region, so no outline changes and regions
//! are independent: simplified in any order, on any number of threads, with the same result. The next
//! level cuts anew, so outlines move. The collapses of one region are one chunk.

mod attributes;
mod deviation;
mod input_faces;
mod legality;
mod level;
mod limit;
pub(crate) mod live;
mod measure;
mod metric;
mod partition;
pub(crate) mod placement;
mod quadric;
mod queue;
pub(crate) mod records;
mod region;
mod star_table;
#[cfg(test)]
mod stops_test;
mod surroundings;

use crate::codec::Codec;
use crate::error::MeshError;
use crate::mesh::QuantisedMesh;
use crate::pool::{Stage, Watched};
use crate::simplify::deviation::{Deviation, extend};
use crate::simplify::level::{Level, truncate_globally};
use crate::simplify::limit::{Limit, limit_error};
use crate::simplify::live::Live;
use crate::simplify::measure::{Grids, measure};
use crate::simplify::placement::Placed;
use crate::simplify::records::Records;
use crate::vec3::{Vec3, length, sub};

/// A region with its collapses.
pub(crate) struct RegionChunk {
    pub(crate) records: Records,
    /// Faces of the region at the level's start.
    pub(crate) faces: Vec<u32>,
    /// Vertices whose whole star lay in the region, ascending.
    pub(crate) interior: Vec<u32>,
    /// Geometric error in grid cells while the chunk is missing, before it is made monotone.
    pub(crate) error: f64,
    /// How far attributes slide while the chunk is missing, in grid cells, before it is made monotone.
    pub(crate) attribute_error: f64,
    /// The same once the chunk is applied up to each stop of its records; falling, at most `error`.
    pub(crate) stop_errors: Vec<f64>,
    /// What becomes of the vertices of the region that are left.
    pub(crate) moves: Vec<Placed>,
    /// Bounding sphere in grid cells about the middle of the grid.
    pub(crate) center: Vec3,
    pub(crate) radius: f64,
}

impl RegionChunk {
    /// Leaves only the chunk as a whole.
    fn forget_stops(&mut self) {
        self.records.stops.clear();
        self.stop_errors.clear();
    }
}

/// A mesh reduced to its base, and the way there.
pub(crate) struct Simplified {
    /// Levels, finest first; each a list of chunks.
    pub(crate) levels: Vec<Vec<RegionChunk>>,
    /// What is left.
    pub(crate) live: Live,
    /// Error of regions that vanished or were dropped without a chunk of their own.
    pub(crate) stray_error: f64,
    /// How many bits the grids leave out that the levels' chunks bring vertices to; one more for the base mesh.
    pub(crate) shifts: Vec<u8>,
}

/// What a half-edge collapse is held to cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// The quadric error metric of Garland and Heckbert (1997): squared distances to the planes of the
    /// faces that a vertex stands for, and of its boundary and seam edges.
    #[default]
    Qem,
    /// Edge length × curvature, from the faces as they are (Melax, "A simple, fast, and effective
    /// polygon reduction algorithm", 1998); no face may turn by more than 90°.
    Melax,
}

/// Knobs of the simplification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Faces per region, 50 to 20,000. Smaller regions follow the view more closely but lock more
    /// outlines (worse meshes at equal size) and need more chunks and index bytes.
    pub region_faces: usize,
    /// Share of the removable vertices that one level removes, 0.1 to 0.9. More means fewer levels, so
    /// fewer ancestors per chunk, but coarser steps.
    pub level_share: f64,
    /// Regions that are merged into one at the top, 0.25 to 16: once no more faces are left than so many
    /// regions hold (40,000 at most), one region of all of them goes as far as the base mesh's error
    /// allows. More means fewer levels and slightly fewer bytes in all, but a larger first step, which no
    /// view can do without; it is simplified on one thread.
    pub top_regions: f64,
    /// Largest error of the base mesh as a share of the bounding box's diagonal.
    pub base_error: f64,
    /// Fewest splits of a chunk; what falls short is left to the next level.
    pub min_splits: usize,
    /// Parts of a chunk, 1 to 16: between them a client may stop. More follow the view and a limit on
    /// faces more closely, and cost index bytes.
    pub parts: usize,
    /// Fewest splits of a part.
    pub min_part_splits: usize,
    /// What a collapse is held to cost.
    pub metric: Metric,
    /// `None`: the cheapest collapse of a region first, from a heap. `Some(share)`: rounds of
    /// collapses that share no face, each of this share of the vertices, 0.01 to 0.5: coarser.
    pub round_share: Option<f64>,
    /// How the result is coded. [`Codec::Plain`] has no stopping points, whatever `parts` says.
    pub codec: Codec,
    /// How far apart the points of a level's grid of positions may be, as a share of the median of the errors of
    /// the level's regions, 0 to 4; 0 keeps one grid for all levels. More makes coarse levels smaller and
    /// the whole larger: what a coarse grid leaves out comes later.
    pub coarse_grid: f64,
    /// Lets each region of the finest level collapse one vertex of its outline, which tears the mesh.
    /// Only for showing that the checks notice.
    #[doc(hidden)]
    pub unlock_outlines: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            region_faces: 1000,
            level_share: 2.0 / 3.0,
            top_regions: 1.5,
            base_error: 0.042,
            min_splits: 32,
            parts: 4,
            min_part_splits: 32,
            metric: Metric::Qem,
            round_share: None,
            codec: Codec::Range,
            coarse_grid: 0.7,
            unlock_outlines: false,
        }
    }
}

/// A level's regions hold up to twice the faces asked for, and faces that share nothing have three
/// vertices each: one chunk then still splits fewer than its decoder accepts.
const MAX_REGION_FACES: usize = 20_000;
/// Most parts of a chunk.
const MAX_PARTS: usize = 16;
/// Largest [`Settings::coarse_grid`].
const MAX_COARSE_GRID: f64 = 4.0;
/// A level that removes less than this share of the vertices ends the hierarchy.
const LEAST_PROGRESS: f64 = 0.05;

pub(crate) fn simplify(
    mesh: &QuantisedMesh,
    settings: &Settings,
    pool: &mut Watched<'_>,
) -> Result<Simplified, MeshError> {
    let mut live = Live::new(mesh);
    let mut deviation = Deviation::new(&live, mesh.uv_grid);
    let mut levels = Vec::new();
    let mut stray_error = 0.0_f64;
    let limit = Limit::new(&live, settings.base_error * diagonal(mesh));
    let faces_total = live.faces.len();
    let region_faces = settings.region_faces.clamp(50, MAX_REGION_FACES);
    let top_faces = (settings.top_regions.clamp(0.25, 16.0) * region_faces as f64) as usize;
    let top_faces = top_faces.min(2 * MAX_REGION_FACES);
    let mut stuck = false;
    let mut shifts = vec![0];
    let mut shift = 0;
    loop {
        pool.begin(Stage::Simplify)?;
        let last = live.faces.len() <= if stuck { top_faces.max(MAX_REGION_FACES) } else { top_faces };
        let level = Level::new(&live, levels.len(), if last { 1 } else { live.faces.len() / region_faces });
        let tear = settings.unlock_outlines && levels.is_empty();
        let mut records = level.simplify(&live, last, tear, settings, pool)?;
        if !last {
            truncate_globally(&mut records, &level, settings);
        }
        pool.begin(Stage::Measure)?;
        limit_error(&live, &deviation, &level, &mut records, &limit, settings, pool)?;
        pool.begin(Stage::Simplify)?;
        let vertices = level.vertices;
        for region in &mut records {
            region.choose_stops(settings.parts.clamp(1, MAX_PARTS), settings.min_part_splits);
        }
        let removed: usize = records.iter().map(|r| r.collapses.len()).sum();
        pool.begin(Stage::Measure)?;
        // What the base mesh lacks besides counts against what it may: no coarser grid on the last way there.
        let share = if last { 0.0 } else { settings.coarse_grid.clamp(0.0, MAX_COARSE_GRID) };
        let grids = Grids { shift, share, limit: limit.error };
        let (mut chunks, next) =
            measure(&mut live, &mut deviation, &level, records, grids, pool, &mut stray_error)?;
        if settings.codec == Codec::Plain {
            chunks.iter_mut().for_each(RegionChunk::forget_stops);
        }
        if !chunks.is_empty() {
            levels.push(chunks);
            shifts.push(next);
            shift = next;
        }
        pool.advance(faces_total - live.faces.len(), removed);
        let little = (removed as f64) < LEAST_PROGRESS * vertices as f64;
        if last || (little && (stuck || live.faces.len() > MAX_REGION_FACES)) {
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
