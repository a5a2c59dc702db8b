//! Stated geometric errors compared with measured distances, at ten or more points per face: validity and tightness.
//!
//! *Validity.* For an ancestor-closed cut, the error stated for the mesh is the largest of its missing chunks', and no
//! point may be further away. Views also rely on it locally: near a point, the error is at most that of the missing
//! chunks whose bounding sphere contains the point. Both are measured. A chunk applied up to a truncation point counts
//! as missing with that point's error.
//!
//! *Tightness.* For a chunk, the mesh with everything coarser and nothing else is compared with the input: the points
//! of the coarse faces that the chunk changes, the input points nearest to such a face, and those of the input faces
//! that the chunk adds. The largest of their distances is the smallest error that could be stated for the chunk alone.
//! Errors made by finer chunks (its descendants) count as far as they appear at those points. Errors of its neighbours
//! may appear there too, for example if a neighbour's component vanished and this one is nearest: a chunk whose stated
//! error is smaller than that is measured again with only it and its dependents missing.

use std::collections::HashMap;

use glam::DVec3;
use lodestream_geometry::ancestor_closed_cut::{self, Member};
use lodestream_geometry::index::{ChunkInfo, Sphere};
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::{ActiveMesh, Id};
use serde::Serialize;

use super::lattice::Target;
use super::model::Model;
use super::options::Options;
use crate::measure::Surface;

/// Distances below this share of the diagonal are rounding errors.
const NOISE: f64 = 1e-9;

/// Ratios of stated to measured errors.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Ratios {
    /// Number of ratios.
    pub count: usize,
    /// Least; below 1, a stated error was too low.
    pub least: f64,
    /// Median.
    pub median: f64,
    /// 90th percentile.
    pub p90: f64,
    /// Greatest.
    pub greatest: f64,
}

impl Ratios {
    fn of(mut ratios: Vec<f64>) -> Self {
        ratios.sort_by(f64::total_cmp);
        let at = |share: f64| ratios.get((ratios.len() as f64 * share) as usize).copied().unwrap_or(0.0);
        Self {
            count: ratios.len(),
            least: at(0.0),
            median: at(0.5),
            p90: at(0.9),
            greatest: ratios.last().copied().unwrap_or(0.0),
        }
    }
}

/// Stated against measured errors of random ancestor-closed cuts.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct RandomSets {
    /// For whole meshes: the largest error of the missing chunks over the largest distance.
    pub whole: Ratios,
    /// Least ratio at any point: the largest error of the missing chunks whose sphere contains the point, over its
    /// distance. Points nearer than a tenth of their cut's largest distance are omitted.
    pub least_at_a_point: f64,
}

/// Compares stated and measured errors of random ancestor-closed cuts.
pub(super) fn random_sets(model: &Model, options: &Options) -> anyhow::Result<RandomSets> {
    let mut random = Random::new(options.seed);
    let mut sets =
        (0..options.random_sets).map(|_| ancestor_closed_cut::random(&model.prepared.infos, &mut random));
    compare(model, &mut sets)
}

/// Compares stated and measured errors of the levels, each up to each of its truncation points.
pub(super) fn at_truncation_points(model: &Model) -> anyhow::Result<RandomSets> {
    let infos = &model.prepared.infos;
    let mut sets = Vec::new();
    for level in 1..=model.prepared.base.level_count {
        let truncation_points =
            infos.iter().filter(|i| i.level == level).map(|i| i.truncation_points.len()).max().unwrap_or(0);
        sets.extend((0..truncation_points).map(|truncation| {
            let member = |(chunk, info): (u32, &ChunkInfo)| {
                let partial = info.level == level && truncation < info.truncation_points.len();
                (info.level <= level)
                    .then_some(Member { chunk, truncation: partial.then_some(truncation as u8) })
            };
            (0..).zip(infos).filter_map(member).collect::<Vec<Member>>()
        }));
    }
    compare(model, &mut sets.into_iter())
}

fn compare(model: &Model, sets: &mut dyn Iterator<Item = Vec<Member>>) -> anyhow::Result<RandomSets> {
    let input = Target::new(&model.input);
    let area = input.mean_area();
    let mut ratios = Vec::new();
    let mut least = f64::INFINITY;
    for set in sets {
        let coarse = model.surface(&set)?;
        let coarse = Target::new(&coarse);
        let mut points: Vec<(DVec3, f64)> = Vec::new();
        for (from, to) in [(&input, &coarse), (&coarse, &input)] {
            for face in 0..from.faces() {
                from.distances(face, area, to, &mut |point, distance, _| points.push((point, distance)));
            }
        }
        let worst = points.iter().map(|p| p.1).fold(0.0, f64::max);
        if worst <= NOISE * model.diagonal() {
            continue;
        }
        let missing = MissingChunks::new(model, &set);
        ratios.push(missing.worst() / worst);
        for (point, distance) in points.into_iter().filter(|p| p.1 > 0.1 * worst) {
            least = least.min(missing.at(point) / distance);
        }
    }
    Ok(RandomSets {
        whole: Ratios::of(ratios),
        least_at_a_point: if least.is_finite() { least } else { 0.0 },
    })
}

/// The missing chunks of a mesh, including partly applied ones, in descending order of error.
struct MissingChunks {
    chunks: Vec<(f64, DVec3, f64)>,
}

impl MissingChunks {
    fn new(model: &Model, applied: &[Member]) -> Self {
        let origin = DVec3::from_array(model.mesh.grid.origin);
        let left = model.left(applied);
        let mut chunks: Vec<(f64, DVec3, f64)> = (0..left.len())
            .filter(|&id| left[id] > 0.0)
            .map(|id| {
                let Sphere { center, radius } = model.prepared.infos[id].sphere;
                let center = origin + DVec3::from_array(center.map(f64::from));
                // The centre is relative to the grid's origin; the addition rounds.
                let slack = NOISE * model.diagonal();
                (left[id], center, f64::from(radius) + slack)
            })
            .collect();
        chunks.sort_by(|a, b| b.0.total_cmp(&a.0));
        Self { chunks }
    }

    fn worst(&self) -> f64 {
        self.chunks.first().map_or(0.0, |c| c.0)
    }

    /// Error stated near a point.
    fn at(&self, point: DVec3) -> f64 {
        self.chunks.iter().find(|c| c.1.distance_squared(point) <= c.2 * c.2).map_or(0.0, |c| c.0)
    }
}

/// Compares each chunk's stated error with the distances in the area that it would change.
pub(super) fn per_chunk(model: &Model) -> anyhow::Result<Ratios> {
    let infos = &model.prepared.infos;
    let mut active = ActiveMesh::new(&model.prepared.base);
    for delta in &model.deltas {
        active.apply(delta)?;
    }
    let (input, input_ids) = with_ids(model, &active);
    let input = Target::new(&input);
    let area = input.mean_area();
    let mut measured = vec![0.0_f64; infos.len()];
    let mut at = ActiveMesh::new(&model.prepared.base);
    for run in model.deltas.chunk_by(|a, b| infos[a.chunk as usize].level == infos[b.chunk as usize].level) {
        let changes: HashMap<Id, u32> =
            run.iter().flat_map(|d| d.repoints.iter().map(|r| (r.face, d.chunk))).collect();
        let (coarse, ids) = with_ids(model, &at);
        let owner: Vec<Option<u32>> = ids.iter().map(|id| changes.get(id).copied()).collect();
        let coarse = Target::new(&coarse);
        let brings = run[0].chunk..run[0].chunk + run.len() as u32;
        for (face, id) in input_ids.iter().enumerate() {
            let own = id.owner.checked_sub(1).filter(|chunk| brings.contains(chunk));
            input.distances(face, area, &coarse, &mut |_, distance, nearest| {
                for chunk in owner[nearest as usize].iter().chain(&own) {
                    measured[*chunk as usize] = measured[*chunk as usize].max(distance);
                }
            });
        }
        for (face, owner) in owner.iter().enumerate() {
            if let Some(chunk) = *owner {
                coarse.distances(face, area, &input, &mut |_, distance, _| {
                    measured[chunk as usize] = measured[chunk as usize].max(distance);
                });
            }
        }
        for delta in run {
            at.apply(delta)?;
        }
    }
    let mut ratios = Vec::new();
    for (chunk, (&charged, info)) in (0..).zip(measured.iter().zip(infos)) {
        if charged > NOISE * model.diagonal() {
            let stated = f64::from(info.error);
            let measured = if charged > stated { missing_alone(model, &input, chunk)? } else { charged };
            ratios.push(stated / measured);
        }
    }
    Ok(Ratios::of(ratios))
}

/// The largest distance while only a chunk and its dependents are missing.
fn missing_alone(model: &Model, input: &Target<'_>, chunk: u32) -> anyhow::Result<f64> {
    let mut lacks = vec![false; model.prepared.infos.len()];
    for (id, info) in (0..).zip(&model.prepared.infos) {
        lacks[id as usize] = id == chunk || info.parents.iter().any(|&p| lacks[p as usize]);
    }
    let there = (0..).zip(&lacks).filter(|(_, lacks)| !**lacks);
    let there: Vec<Member> = there.map(|(chunk, _)| Member { chunk, truncation: None }).collect();
    let coarse = model.surface(&there)?;
    let coarse = Target::new(&coarse);
    let mut worst = 0.0_f64;
    for (from, to) in [(input, &coarse), (&coarse, input)] {
        for face in 0..from.faces() {
            from.distances(face, input.mean_area(), to, &mut |_, distance, _| worst = worst.max(distance));
        }
    }
    Ok(worst)
}

/// The surface of a mesh in the asset's units, with each face's id.
fn with_ids(model: &Model, active: &ActiveMesh) -> (Surface, Vec<Id>) {
    let snapshot = active.snapshot();
    let vertex = |wedge: Id| {
        let at = snapshot.wedges.partition_point(|w| w.0 < wedge);
        snapshot.vertices.partition_point(|v| v.0 < snapshot.wedges[at].1) as u32
    };
    let surface = Surface {
        positions: snapshot.vertices.iter().map(|v| model.mesh.grid.position(v.1)).collect(),
        triangles: snapshot.faces.iter().map(|f| f.1.map(vertex)).collect(),
    };
    (surface, snapshot.faces.iter().map(|f| f.0).collect())
}
