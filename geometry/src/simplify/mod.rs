//! Simplification: from the input to the base mesh, level by level, region by region.
//!
//! At a level's start the live faces are cut into regions. Within the level a collapse u → t is
//! allowed only if the whole stars of u *and* t lie in one region, so no outline changes and regions
//! are independent: simplified in any order, on any number of threads, with the same result. The next
//! level cuts anew, so outlines move. The collapses of one region are one chunk.

mod deviation;
mod legality;
pub(crate) mod live;
mod measure;
mod partition;
mod quadric;
pub(crate) mod records;
mod region;
#[cfg(test)]
mod schedule_test;

use crate::error::MeshError;
use crate::mesh::QuantisedMesh;
use crate::pool::{Stage, Watched};
use crate::simplify::deviation::{Deviation, extend};
use crate::simplify::live::Live;
use crate::simplify::measure::measure;
use crate::simplify::partition::partition;
use crate::simplify::records::Records;
use crate::simplify::region::Region;
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
    /// Bounding sphere in grid cells about the middle of the grid.
    pub(crate) center: Vec3,
    pub(crate) radius: f64,
}

/// A mesh reduced to its base, and the way there.
pub(crate) struct Simplified {
    /// Levels, finest first; each a list of chunks.
    pub(crate) levels: Vec<Vec<RegionChunk>>,
    /// What is left.
    pub(crate) live: Live,
    /// Error of regions that vanished or were dropped without a chunk of their own.
    pub(crate) stray_error: f64,
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
    /// Largest error of the base mesh as a share of the bounding box's diagonal.
    pub base_error: f64,
    /// Fewest splits of a chunk; what falls short is left to the next level.
    pub min_splits: usize,
    /// Parts of a chunk, 1 to 16: between them a client may stop. More follow the view and a limit on
    /// faces more closely, and cost index bytes.
    pub parts: usize,
    /// Fewest splits of a part.
    pub min_part_splits: usize,
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
            base_error: 0.042,
            min_splits: 32,
            parts: 4,
            min_part_splits: 32,
            unlock_outlines: false,
        }
    }
}

/// A level's regions hold up to twice the faces asked for, and faces that share nothing have three
/// vertices each: one chunk then still splits fewer than its decoder accepts.
const MAX_REGION_FACES: usize = 20_000;
/// Most parts of a chunk.
const MAX_PARTS: usize = 16;
/// Marks a vertex whose star lies in several regions, or that has none.
const OUTLINE: u32 = u32::MAX;
/// Share of a region's interior that is tried, so that flat regions can give more than others.
const MOST_OF_A_REGION: f64 = 0.85;
/// Input samples by which a region is judged while a level that keeps within the base's error is
/// searched for.
const SEARCH_SAMPLES: usize = 20_000;
/// The least of them for one region.
const LEAST_SEARCH_SAMPLES: usize = 1500;
/// A level that removes less than this share of the vertices ends the hierarchy.
const LEAST_PROGRESS: f64 = 0.01;

pub(crate) fn simplify(
    mesh: &QuantisedMesh,
    settings: &Settings,
    pool: &mut Watched<'_>,
) -> Result<Simplified, MeshError> {
    let mut live = Live::new(mesh);
    let mut deviation = Deviation::new(&live);
    let mut levels = Vec::new();
    let mut stray_error = 0.0_f64;
    let diagonal = diagonal(mesh);
    let faces_total = live.face_count;
    let region_faces = settings.region_faces.clamp(50, MAX_REGION_FACES);
    loop {
        pool.begin(Stage::Simplify)?;
        let last = live.face_count <= region_faces + region_faces / 2;
        let level = Level::new(&live, levels.len(), if last { 1 } else { live.face_count / region_faces });
        let tear = settings.unlock_outlines && levels.is_empty();
        let mut records = level.simplify(&live, last, tear, settings, pool)?;
        if !last {
            truncate_globally(&mut records, &level, settings);
        }
        pool.begin(Stage::Measure)?;
        limit_error(&live, &deviation, &level, &mut records, settings.base_error * diagonal, pool)?;
        pool.begin(Stage::Simplify)?;
        let vertices = level.vertices;
        let mut touched = vec![false; live.alive.len()];
        let mut removed = 0;
        for region in &mut records {
            region.schedule(settings.parts.clamp(1, MAX_PARTS), settings.min_part_splits);
            region.commit(&mut live, &mut |face| touched[face as usize] = true);
            removed += region.collapses.len();
        }
        pool.begin(Stage::Measure)?;
        let chunks = measure(&live, &mut deviation, &level, records, &touched, pool, &mut stray_error)?;
        if !chunks.is_empty() {
            levels.push(chunks);
        }
        pool.advance(faces_total - live.face_count, removed);
        if last || (removed as f64) < LEAST_PROGRESS * vertices as f64 {
            return Ok(Simplified { levels, live, stray_error });
        }
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

/// The regions of one level.
struct Level {
    region_of_face: Vec<u32>,
    faces: Vec<Vec<u32>>,
    /// Region of each interior vertex, else [`OUTLINE`].
    interior: Vec<u32>,
    /// Interior vertices of each region.
    capacity: Vec<usize>,
    /// Live vertices.
    vertices: usize,
}

impl Level {
    fn new(live: &Live, number: usize, count: usize) -> Self {
        let list: Vec<u32> = (0..live.alive.len() as u32).filter(|&f| live.alive[f as usize]).collect();
        let centroids: Vec<Vec3> = list.iter().map(|&f| live.centroid(f as usize)).collect();
        let mut place = vec![u32::MAX; live.alive.len()];
        for (i, &f) in list.iter().enumerate() {
            place[f as usize] = i as u32;
        }
        let neighbours = |i: usize, visit: &mut dyn FnMut(usize)| {
            live.edge_neighbours(list[i] as usize, &mut |f| visit(place[f] as usize));
        };
        let regions = partition(&centroids, count, number, &neighbours);
        let mut region_of_face = vec![OUTLINE; live.alive.len()];
        let mut faces = vec![Vec::new(); count.max(1)];
        for (i, &f) in list.iter().enumerate() {
            region_of_face[f as usize] = regions[i];
            faces[regions[i] as usize].push(f);
        }
        let mut interior = vec![OUTLINE; live.positions.len()];
        let mut capacity = vec![0; faces.len()];
        let mut vertices = 0;
        for v in 0..live.positions.len() as u32 {
            let mut corners = live.stars.corners(v).map(|c| region_of_face[(c / 3) as usize]);
            let Some(first) = corners.next() else { continue };
            vertices += 1;
            if corners.all(|r| r == first) {
                interior[v as usize] = first;
                capacity[first as usize] += 1;
            }
        }
        Self { region_of_face, faces, interior, capacity, vertices }
    }

    fn simplify(
        &self,
        live: &Live,
        last: bool,
        tear: bool,
        settings: &Settings,
        pool: &Watched<'_>,
    ) -> Result<Vec<Records>, MeshError> {
        let share = MOST_OF_A_REGION.max(settings.level_share);
        pool.map(self.faces.len(), &|r| {
            let limit = if last { usize::MAX } else { (self.capacity[r] as f64 * share) as usize };
            let inside = |v: u32| self.interior[v as usize] == r as u32;
            let mut region = Region::new(live, self.faces[r].clone(), &inside);
            if tear {
                region.tear_outline();
            }
            region.simplify(limit)
        })
    }
}

/// Cuts all regions' collapses at one cost, so that a level removes its share where it hurts least;
/// regions left with too few splits keep none.
fn truncate_globally(records: &mut [Records], level: &Level, settings: &Settings) {
    let mut costs: Vec<f64> = records.iter().flat_map(|r| r.collapses.iter().map(|c| c.cost)).collect();
    let total: usize = level.capacity.iter().sum();
    let target = (total as f64 * settings.level_share) as usize;
    let limit = if target < costs.len() && target > 0 {
        *costs.select_nth_unstable_by(target - 1, f64::total_cmp).1
    } else {
        f64::INFINITY
    };
    for region in records {
        let mut keep = region.collapses.partition_point(|c| c.cost <= limit);
        if keep < settings.min_splits {
            keep = 0;
        }
        region.truncate(keep);
    }
}

/// Shortens each region's collapses until its error is within `limit`: no level may leave the base
/// mesh worse than it is allowed to be.
fn limit_error(
    live: &Live,
    deviation: &Deviation,
    level: &Level,
    records: &mut [Records],
    limit: f64,
    pool: &Watched<'_>,
) -> Result<(), MeshError> {
    let samples = deviation.by_region(&level.region_of_face, level.faces.len());
    let budget = (SEARCH_SAMPLES / records.len().max(1)).max(LEAST_SEARCH_SAMPLES);
    let keep = pool.map(records.len(), &|r| {
        let whole = records[r].collapses.len();
        let good = |count: usize| {
            let triangles = faces_after(live, &level.faces[r], &records[r], count);
            !triangles.is_empty() && deviation.within(&live.positions, &triangles, &samples[r], limit, budget)
        };
        if whole == 0 || good(whole) {
            return whole;
        }
        let (mut low, mut high) = (0, whole);
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if good(middle) { low = middle } else { high = middle }
        }
        low
    })?;
    for (region, keep) in records.iter_mut().zip(keep) {
        region.truncate(keep);
    }
    Ok(())
}

/// A region's triangles after its first `count` collapses.
fn faces_after(live: &Live, faces: &[u32], records: &Records, count: usize) -> Vec<[u32; 3]> {
    let place = |face: u32| faces.binary_search(&face).unwrap_or(0);
    let mut triangles: Vec<Option<[u32; 3]>> =
        faces.iter().map(|&f| Some(live.face_vertices[f as usize])).collect();
    for i in 0..count {
        let (collapse, moved, removed) = records.parts(i);
        for m in moved {
            if let Some(triangle) = &mut triangles[place(m.face)]
                && let Some(corner) = triangle.iter_mut().find(|v| **v == collapse.removed)
            {
                *corner = collapse.target;
            }
        }
        for r in removed {
            triangles[place(r.face)] = None;
        }
    }
    triangles.into_iter().flatten().collect()
}
