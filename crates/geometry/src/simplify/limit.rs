//! Enforces the base mesh's error limit on every level.

use std::collections::BTreeMap;

use crate::collapse::NO_VERTEX;
use crate::collapse::Records;
use crate::error::{MeshError, SkippedTask};
use crate::mesh::corner::{next, previous};
use crate::mesh::rows::Rows;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::vec3::{Vec3, add, dot, length, scale, sub};
use crate::mesh::wide_bvh::{Hints, WideBvh};
use crate::pool::{MonitoredPool, Pool, Serial, map};
use crate::simplify::deviation::{Deviation, MARGIN};
use crate::simplify::level::Level;
use crate::simplify::live::Live;
use crate::simplify::settings::Settings;
use crate::simplify::surroundings::compact;
use crate::simplify::whole_components::MAX_DROPPED_VERTICES;

/// Input samples by which prefixes of a region's collapses are judged.
const SEARCH_SAMPLES: usize = 8000;
/// Fewest such samples per region.
const MIN_SEARCH_SAMPLES: usize = 1000;

/// Input faces with an edge longer than this share of the limit get extra points.
const LARGE: f64 = 0.25;
/// Spacing of points on large faces, as a share of the limit; and its minimum, as a share of the mesh's diagonal.
const POINT_SPACING: f64 = 0.5;
const MIN_SPACING: f64 = 0.01;
/// Most points with that spacing; beyond it each large face has four points.
const MAX_POINTS: usize = 1 << 20;
/// Subdivisions of a face for comparison with the input.
const LATTICE: u32 = 5;
/// Most times a region is simplified again, with more locked vertices each time.
const MAX_ATTEMPTS: usize = 8;
/// Samples and faces per task if there is only one region.
const SAMPLES_PER_TASK: usize = 4096;
const FACES_PER_TASK: usize = 64;

/// Brings each region's error within `limit`, so that no level makes the base mesh worse than allowed. If a region's
/// collapses exceed it, the vertices whose removal caused it are locked and the region is simplified again; if it is
/// still exceeded, the collapses are truncated.
pub(crate) fn limit_error(
    live: &Live<'_>,
    deviation: &Deviation,
    level: &Level<'_>,
    records: &mut [Records],
    limit: &Limit,
    settings: &Settings,
    pool: &MonitoredPool<'_>,
) -> Result<(), MeshError> {
    let shorten = |r: usize, threads| {
        let limited = || LimitedRegion::new(live, deviation, level, r, limit, threads);
        let region: &Records = &records[r];
        (region.reach > limit.error).then(|| limited().shorten(region, records.len(), settings))
    };
    let shortened = match records.len() {
        // The last level's only region has enough samples to split over threads.
        1 => vec![shorten(0, pool.threads())],
        count => pool.map(count, &|r| shorten(r, &Serial))?,
    };
    for (region, shortened) in records.iter_mut().zip(shortened) {
        if let Some(shortened) = shortened {
            *region = shortened?;
        }
    }
    Ok(())
}

/// The allowed error in grid cells, and the points that must satisfy it besides the input's vertices.
pub(crate) struct Limit {
    pub(crate) error: f64,
    /// Points of large input faces by nearest corner: four times the face plus an index of [`four_points`], or
    /// [`EXPLICIT`] plus an index of `explicit_points`.
    points: Rows<u32>,
    explicit_points: Vec<Vec3>,
}

/// Marks an explicit point. Meshes simplified at once have fewer faces than 2^29.
const EXPLICIT: u32 = 1 << 31;

/// The centre of a face, and the midpoints of its edges.
fn four_points([a, b, c]: [Vec3; 3]) -> [Vec3; 4] {
    let halfway = |p, q| scale(add(p, q), 0.5);
    [scale(add(add(a, b), c), 1.0 / 3.0), halfway(a, b), halfway(b, c), halfway(c, a)]
}

impl Limit {
    pub(crate) fn new(live: &Live<'_>, error: f64, diagonal: f64) -> Self {
        let spacing = (POINT_SPACING * error).max(MIN_SPACING * diagonal);
        // Large faces, each with the number of points before it; per point, the nearest corner.
        let mut large: Vec<(u32, u32)> = Vec::new();
        let (mut explicit_points, mut nearest) = (Vec::new(), Vec::new());
        let mut count = 0;
        for (face, &corners) in (0..).zip(&live.face_vertices) {
            let [a, b, c] = corners.map(|v| live.positions[v as usize]);
            let longest = [sub(b, a), sub(c, b), sub(a, c)].map(length).into_iter().fold(0.0, f64::max);
            let before = explicit_points.len();
            if longest > 2.0 * spacing && count < MAX_POINTS {
                cover([a, b, c], spacing, &mut |point| {
                    let distance = |v: u32| length(sub(live.positions[v as usize], point));
                    let by_distance = |v: &u32, w: &u32| distance(*v).total_cmp(&distance(*w));
                    nearest.extend(corners.into_iter().min_by(by_distance));
                    explicit_points.push(point);
                });
                count += explicit_points.len() - before;
            } else if longest > LARGE * error {
                count += 4;
            } else {
                continue;
            }
            large.push((face, explicit_points.len() as u32));
        }
        let points = || {
            large.iter().scan(0, |from, &(face, end)| {
                let own = std::mem::replace(from, end)..end;
                let [v, next, last] = live.face_vertices[face as usize];
                let four = own.is_empty().then(|| [v, v, next, last].into_iter().zip(face * 4..));
                let explicit_points = own.map(|at| (nearest[at as usize], EXPLICIT | at));
                Some(four.into_iter().flatten().chain(explicit_points))
            })
        };
        let points = Rows::new(live.positions.len(), || points().flatten());
        // They live until the base mesh is done.
        explicit_points.shrink_to_fit();
        Self { error, points, explicit_points }
    }

    /// A vertex of the input with the points assigned to it.
    fn points_at<'a>(
        &'a self,
        live: &'a Live<'_>,
        input: &WideBvh,
        vertex: u32,
    ) -> impl Iterator<Item = Vec3> + 'a {
        let point = |&code: &u32| match code {
            EXPLICIT.. => self.explicit_points[(code - EXPLICIT) as usize],
            _ => four_points(live.first_triangle(code / 4))[(code % 4) as usize],
        };
        std::iter::once(input.position(vertex)).chain(self.points.row(vertex).iter().map(point))
    }
}

/// Covers a face with points so that no part wider than `spacing` is without one, by bisecting the longest edge;
/// long, narrow faces get few.
fn cover(corners: [Vec3; 3], spacing: f64, visit: &mut impl FnMut(Vec3)) {
    let edge = |k: usize| length(sub(corners[next(k)], corners[k]));
    let longest = (0..3).fold(0, |longest, k| if edge(k) > edge(longest) { k } else { longest });
    if edge(longest).is_nan() || edge(longest) <= spacing {
        let [a, b, c] = corners;
        return visit(scale(add(add(a, b), c), 1.0 / 3.0));
    }
    let [a, b, c] = [longest, next(longest), previous(longest)].map(|k| corners[k]);
    let middle = scale(add(a, b), 0.5);
    visit(middle);
    cover([a, middle, c], spacing, visit);
    cover([middle, b, c], spacing, visit);
}

/// A region whose error may exceed the limit.
struct LimitedRegion<'a> {
    live: &'a Live<'a>,
    deviation: &'a Deviation,
    level: &'a Level<'a>,
    r: usize,
    samples: &'a [u32],
    points: &'a Limit,
    limit: f64,
    /// Successor before this level of each sample that is a vertex (these come first).
    roots: Vec<u32>,
    threads: &'a dyn Pool,
}

/// A point that is too far from the remaining mesh: its distance, the successor's distance, and the vertex to lock.
struct LimitViolation {
    distance: f64,
    root: u32,
    point: Vec3,
}

/// The farthest violation (the first of equal ones) by successor of the point's vertex.
type Farthest = BTreeMap<u32, LimitViolation>;

fn insert_farther(farthest: &mut Farthest, successor: u32, found: LimitViolation) {
    if farthest.get(&successor).is_none_or(|known| found.distance > known.distance) {
        farthest.insert(successor, found);
    }
}

impl<'a> LimitedRegion<'a> {
    fn new(
        live: &'a Live<'a>,
        deviation: &'a Deviation,
        level: &'a Level<'a>,
        r: usize,
        points: &'a Limit,
        threads: &'a dyn Pool,
    ) -> Self {
        let samples = level.samples.of(r).list;
        let count = samples.partition_point(|&sample| (sample as usize) < live.positions.len());
        let roots = samples[..count].iter().map(|&sample| live.successor(sample)).collect();
        Self { live, deviation, level, r, samples, points, limit: points.error, roots, threads }
    }

    fn shorten(&self, whole: &Records, regions: usize, settings: &Settings) -> Result<Records, SkippedTask> {
        let highest_cost = whole.costs.last().copied().unwrap_or(0.0);
        let mut records = whole.clone();
        let mut held: Vec<u32> = Vec::new();
        for _ in 0..MAX_ATTEMPTS {
            let far = self.vertices_to_lock(&records, &held)?;
            if far.is_empty() {
                return Ok(records);
            }
            held.extend(far);
            held.sort_unstable();
            held.dedup();
            let most = (whole.collapses.len(), highest_cost);
            records = self.level.simplify_with_locked(self.live, self.r, &held, most, settings);
        }
        let mut keep = self.longest_good_prefix(&records, regions);
        if self.level.components.is_some() {
            keep = records.aligned(keep, MAX_DROPPED_VERTICES as usize);
        }
        records.truncate(keep);
        Ok(records)
    }

    /// Removed vertices that should be locked: among input points too far from the remaining mesh, the farthest per
    /// successor, unless a locked vertex is close enough; and the last vertex that moved a face that is too far.
    fn vertices_to_lock(&self, records: &Records, held: &[u32]) -> Result<Vec<u32>, SkippedTask> {
        let (live, limit) = (self.live, self.limit);
        let faces = &self.level.faces[self.r];
        let after = faces_after(live, faces, records, records.collapses.len());
        let mut far = Farthest::new();
        for (successor, found) in self.far_from(records, &after)?.into_iter().flatten() {
            insert_farther(&mut far, successor, found);
        }
        let mut far: Vec<LimitViolation> = far.into_values().collect();
        if let Some(components) = &self.level.components {
            // Large components first, so that they stand for small ones near by.
            far.sort_by(|a, b| components.diagonal(b.root).total_cmp(&components.diagonal(a.root)));
        }
        let near = |point: Vec3, v: u32| length(sub(point, live.positions[v as usize])) <= limit / MARGIN;
        let mut hold: Vec<u32> = Vec::new();
        for LimitViolation { root, point, .. } in far {
            if !hold.iter().chain(held).any(|&h| near(point, h)) {
                hold.push(root);
            }
        }
        let moved_last = |face: u32| {
            let moved = |i: &usize| records.parts(*i).1.iter().any(|moved| moved.face == face);
            (0..records.collapses.len()).rev().find(moved).map(|i| records.collapses[i].removed)
        };
        let far_faces = map(self.threads, faces.len().div_ceil(FACES_PER_TASK), &|task| -> Vec<u32> {
            let from = task * FACES_PER_TASK;
            let some = faces.iter().zip(&after).skip(from).take(FACES_PER_TASK);
            some.filter_map(|(&face, triangle)| {
                let corners = triangle.filter(|c| *c != live.face_vertices[face as usize])?;
                if self.near_input(corners) { None } else { moved_last(face) }
            })
            .collect()
        })?;
        hold.extend(far_faces.into_iter().flatten());
        Ok(hold)
    }

    /// Input points too far from the mesh after the collapses, in parts, in order.
    fn far_from(&self, records: &Records, after: &[Option<[u32; 3]>]) -> Result<Vec<Farthest>, SkippedTask> {
        let live = self.live;
        let enough = self.limit / MARGIN;
        let triangles: Vec<[u32; 3]> = after.iter().copied().flatten().collect();
        // With its own vertices only: a hierarchy copies the positions it is given, and many regions are affected.
        let (places, compacted) = compact(&live.positions, &triangles);
        let surface = WideBvh::new(&places, &compacted);
        let successors = successors(records);
        map(self.threads, self.roots.len().div_ceil(SAMPLES_PER_TASK), &|task| {
            let mut hints = Hints::new(self.limit, None);
            let mut far = Farthest::new();
            let some =
                self.samples.iter().zip(&self.roots).skip(task * SAMPLES_PER_TASK).take(SAMPLES_PER_TASK);
            for (&sample, &root) in some {
                let successor = successors.get(root).unwrap_or(root);
                let lost =
                    successors.get(successor).is_some() || live.stars.corners(successor).next().is_none();
                for point in self.points.points_at(live, &self.deviation.input, sample) {
                    let distance = length(sub(point, live.positions[successor as usize]));
                    if (distance > enough || lost)
                        && (triangles.is_empty() || !surface.any_within_hinted(point, enough, &mut hints))
                        && let Some(root) = self.removed_near(sample, root, point, &successors)
                    {
                        insert_farther(&mut far, successor, LimitViolation { distance, root, point });
                    }
                }
            }
            far
        })
    }

    /// The vertex to lock for a point of an input vertex: its successor before this level or, if that vanished, the
    /// nearest corner of the face that represented it.
    fn removed_near(&self, sample: u32, root: u32, point: Vec3, successors: &SlotMap) -> Option<u32> {
        let live = self.live;
        if successors.get(root).is_some() {
            return Some(root);
        }
        let corners = live.face_vertices[self.deviation.face_near(sample) as usize];
        let distance = |v: u32| length(sub(live.positions[v as usize], point));
        let removed = corners.into_iter().filter(|&v| successors.get(v).is_some());
        removed.min_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)))
    }

    /// Whether lattice points of a face are within the limit of the input.
    fn near_input(&self, corners: [u32; 3]) -> bool {
        let [a, b, c] = corners.map(|v| self.live.positions[v as usize]);
        // Bounds by the corners: they are this close to the input, and every point is within longest edge / √3 of a
        // corner.
        let off = |v: u32| length(sub(self.live.positions[v as usize], self.deviation.input.position(v)));
        let near = self.limit / MARGIN - corners.map(off).into_iter().fold(0.0, f64::max);
        let edges = [sub(b, a), sub(c, b), sub(a, c)].map(|e| dot(e, e));
        if near > 0.0 && edges.iter().all(|e| *e <= 3.0 * near * near) {
            return true;
        }
        let step = 1.0 / f64::from(LATTICE);
        (0..=LATTICE).all(|i| {
            (0..=LATTICE - i).all(|j| {
                let (s, t) = (f64::from(i) * step, f64::from(j) * step);
                let point = add(add(scale(a, s), scale(b, t)), scale(c, 1.0 - s - t));
                self.deviation.input_within(point, self.limit)
            })
        })
    }

    /// Number of collapses after which the region is still within the limit, judged by some samples.
    fn longest_good_prefix(&self, records: &Records, regions: usize) -> usize {
        let budget = (SEARCH_SAMPLES / regions.max(1)).max(MIN_SEARCH_SAMPLES);
        let good = |count: usize| {
            let after = faces_after(self.live, &self.level.faces[self.r], records, count);
            let triangles: Vec<[u32; 3]> = after.into_iter().flatten().collect();
            !triangles.is_empty()
                && triangles.iter().all(|t| self.near_input(*t))
                && self.deviation.within(self.live, &triangles, self.samples, self.limit, budget)
        };
        let whole = records.collapses.len();
        if whole == 0 || records.reach <= self.limit || good(whole) {
            return whole;
        }
        let (mut low, mut high) = (0, whole);
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if good(middle) { low = middle } else { high = middle }
        }
        low
    }
}

/// The successor of each vertex that collapses remove; itself if its faces vanished without a target.
fn successors(records: &Records) -> SlotMap {
    let mut successors = SlotMap::with_capacity(records.collapses.len());
    // In reverse, so that the target's successor is known.
    for collapse in records.collapses.iter().rev() {
        let successor = match collapse.target {
            NO_VERTEX => collapse.removed,
            target => successors.get(target).unwrap_or(target),
        };
        successors.insert(collapse.removed, successor);
    }
    successors
}

/// A region's faces after its first `count` collapses; `None` for removed ones.
fn faces_after(live: &Live<'_>, faces: &[u32], records: &Records, count: usize) -> Vec<Option<[u32; 3]>> {
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
    triangles
}
