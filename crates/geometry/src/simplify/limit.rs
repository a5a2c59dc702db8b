//! Keeps every level within the error that the base mesh is allowed.

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

/// Input samples by which a region is judged while a level that keeps within the base's error is
/// searched for.
const SEARCH_SAMPLES: usize = 8000;
/// The least of them for one region.
const LEAST_SEARCH_SAMPLES: usize = 1000;

/// Input faces with an edge longer than this share of the limit have points of their own.
const LARGE: f64 = 0.25;
/// How far apart the points of the largest faces are, as a share of the limit, and at least, as a share of the mesh's
/// diagonal.
const POINT_SPACING: f64 = 0.5;
const LEAST_SPACING: f64 = 0.01;
/// Beyond so many, large faces have four points each, however large they are.
const MOST_POINTS: usize = 1 << 20;
/// Parts of a face's edges between the points that are compared with the input.
const LATTICE: u32 = 5;
/// How often a region is simplified again, each time with more vertices held.
const MOST_ATTEMPTS: usize = 8;
/// Samples, and faces, of a region that a task looks at where there is no other region.
const SAMPLES_A_TASK: usize = 4096;
const FACES_A_TASK: usize = 64;

/// Brings each region's error within `limit`: no level may leave the base mesh worse than it is allowed
/// to be. Where a region's collapses go too far, the vertices whose removal did it are held and the
/// region is simplified again; what is still too far then ends the collapses.
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
        let limited = || Limited::new(live, deviation, level, r, limit, threads);
        let region: &Records = &records[r];
        (region.reach > limit.error).then(|| limited().shorten(region, records.len(), settings))
    };
    let shortened = match records.len() {
        // The last level's one region has samples in plenty.
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

/// The error that is allowed, in grid cells, and what must keep to it besides the input's vertices.
pub(crate) struct Limit {
    pub(crate) error: f64,
    /// Points of large input faces, by their nearest corner: four times the face and which of its [`four_points`], or
    /// [`LAID`] and a place among those.
    points: Rows<u32>,
    laid: Vec<Vec3>,
}

/// Marks a point that was laid. What is simplified at once has fewer faces than 2^29.
const LAID: u32 = 1 << 31;

/// The middle of a face, and those of its edges.
fn four_points([a, b, c]: [Vec3; 3]) -> [Vec3; 4] {
    let halfway = |p, q| scale(add(p, q), 0.5);
    [scale(add(add(a, b), c), 1.0 / 3.0), halfway(a, b), halfway(b, c), halfway(c, a)]
}

impl Limit {
    pub(crate) fn new(live: &Live<'_>, error: f64, diagonal: f64) -> Self {
        let spacing = (POINT_SPACING * error).max(LEAST_SPACING * diagonal);
        // Large faces, and how many points were laid until then; of those, the nearest corners.
        let mut large: Vec<(u32, u32)> = Vec::new();
        let (mut laid, mut nearest) = (Vec::new(), Vec::new());
        let mut count = 0;
        for (face, &corners) in (0..).zip(&live.face_vertices) {
            let [a, b, c] = corners.map(|v| live.positions[v as usize]);
            let longest = [sub(b, a), sub(c, b), sub(a, c)].map(length).into_iter().fold(0.0, f64::max);
            let before = laid.len();
            if longest > 2.0 * spacing && count < MOST_POINTS {
                lay([a, b, c], spacing, &mut |point| {
                    let distance = |v: u32| length(sub(live.positions[v as usize], point));
                    let by_distance = |v: &u32, w: &u32| distance(*v).total_cmp(&distance(*w));
                    nearest.extend(corners.into_iter().min_by(by_distance));
                    laid.push(point);
                });
                count += laid.len() - before;
            } else if longest > LARGE * error {
                count += 4;
            } else {
                continue;
            }
            large.push((face, laid.len() as u32));
        }
        let points = || {
            large.iter().scan(0, |from, &(face, end)| {
                let own = std::mem::replace(from, end)..end;
                let [v, next, last] = live.face_vertices[face as usize];
                let four = own.is_empty().then(|| [v, v, next, last].into_iter().zip(face * 4..));
                let laid = own.map(|at| (nearest[at as usize], LAID | at));
                Some(four.into_iter().flatten().chain(laid))
            })
        };
        let points = Rows::new(live.positions.len(), || points().flatten());
        // They stay until the base mesh is there.
        laid.shrink_to_fit();
        Self { error, points, laid }
    }

    /// A vertex of the input and the points for which it stands.
    fn points_at<'a>(
        &'a self,
        live: &'a Live<'_>,
        input: &WideBvh,
        vertex: u32,
    ) -> impl Iterator<Item = Vec3> + 'a {
        let point = |&code: &u32| match code {
            LAID.. => self.laid[(code - LAID) as usize],
            _ => four_points(live.first_triangle(code / 4))[(code % 4) as usize],
        };
        std::iter::once(input.position(vertex)).chain(self.points.row(vertex).iter().map(point))
    }
}

/// Lays points over a face so that no part of it is wider than `spacing` without one, by halving the longest edge: a face
/// that is long and narrow has few.
fn lay(corners: [Vec3; 3], spacing: f64, visit: &mut impl FnMut(Vec3)) {
    let edge = |k: usize| length(sub(corners[next(k)], corners[k]));
    let longest = (0..3).fold(0, |longest, k| if edge(k) > edge(longest) { k } else { longest });
    if edge(longest).is_nan() || edge(longest) <= spacing {
        let [a, b, c] = corners;
        return visit(scale(add(add(a, b), c), 1.0 / 3.0));
    }
    let [a, b, c] = [longest, next(longest), previous(longest)].map(|k| corners[k]);
    let middle = scale(add(a, b), 0.5);
    visit(middle);
    lay([a, middle, c], spacing, visit);
    lay([middle, b, c], spacing, visit);
}

/// A region that may go too far.
struct Limited<'a> {
    live: &'a Live<'a>,
    deviation: &'a Deviation,
    level: &'a Level<'a>,
    r: usize,
    samples: &'a [u32],
    points: &'a Limit,
    limit: f64,
    /// What each of the samples that are vertices, which come first, had become before this level.
    roots: Vec<u32>,
    threads: &'a dyn Pool,
}

/// A point that is too far from what is left, how far what became of the vertex that stood for it is, and the vertex to hold.
struct LimitViolation {
    distance: f64,
    root: u32,
    point: Vec3,
}

/// The farthest of them, the first of those that are as far, by what became of the vertex that stood for it.
type Farthest = BTreeMap<u32, LimitViolation>;

fn keep_farther(farthest: &mut Farthest, heir: u32, found: LimitViolation) {
    if farthest.get(&heir).is_none_or(|known| found.distance > known.distance) {
        farthest.insert(heir, found);
    }
}

impl<'a> Limited<'a> {
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
        let roots = samples[..count].iter().map(|&sample| live.heir(sample)).collect();
        Self { live, deviation, level, r, samples, points, limit: points.error, roots, threads }
    }

    fn shorten(&self, whole: &Records, regions: usize, settings: &Settings) -> Result<Records, SkippedTask> {
        let highest_cost = whole.costs.last().copied().unwrap_or(0.0);
        let mut records = whole.clone();
        let mut held: Vec<u32> = Vec::new();
        for _ in 0..MOST_ATTEMPTS {
            let far = self.gone_too_far(&records, &held)?;
            if far.is_empty() {
                return Ok(records);
            }
            held.extend(far);
            held.sort_unstable();
            held.dedup();
            let most = (whole.collapses.len(), highest_cost);
            records = self.level.simplify_again(self.live, self.r, &held, most, settings);
        }
        let keep = self.longest_good_prefix(&records, regions);
        records.truncate(keep);
        Ok(records)
    }

    /// The removed vertices that should have stayed: of the input's vertices that are too far from what is
    /// left, the farthest that went to each place, unless one that is held is near enough; and the last
    /// that moved a face that is too far.
    fn gone_too_far(&self, records: &Records, held: &[u32]) -> Result<Vec<u32>, SkippedTask> {
        let (live, limit) = (self.live, self.limit);
        let faces = &self.level.faces[self.r];
        let after = faces_after(live, faces, records, records.collapses.len());
        let mut far = Farthest::new();
        for (heir, found) in self.far_from(records, &after)?.into_iter().flatten() {
            keep_farther(&mut far, heir, found);
        }
        let near = |point: Vec3, v: u32| length(sub(point, live.positions[v as usize])) <= limit / MARGIN;
        let mut hold: Vec<u32> = Vec::new();
        for LimitViolation { root, point, .. } in far.into_values() {
            if !hold.iter().chain(held).any(|&h| near(point, h)) {
                hold.push(root);
            }
        }
        let moved_last = |face: u32| {
            let moved = |i: &usize| records.parts(*i).1.iter().any(|moved| moved.face == face);
            (0..records.collapses.len()).rev().find(moved).map(|i| records.collapses[i].removed)
        };
        let far_faces = map(self.threads, faces.len().div_ceil(FACES_A_TASK), &|task| -> Vec<u32> {
            let from = task * FACES_A_TASK;
            let some = faces.iter().zip(&after).skip(from).take(FACES_A_TASK);
            some.filter_map(|(&face, triangle)| {
                let corners = triangle.filter(|c| *c != live.face_vertices[face as usize])?;
                if self.near_input(corners) { None } else { moved_last(face) }
            })
            .collect()
        })?;
        hold.extend(far_faces.into_iter().flatten());
        Ok(hold)
    }

    /// The points of the input that are too far from what is left after the collapses, in parts, in order.
    fn far_from(&self, records: &Records, after: &[Option<[u32; 3]>]) -> Result<Vec<Farthest>, SkippedTask> {
        let live = self.live;
        let enough = self.limit / MARGIN;
        let triangles: Vec<[u32; 3]> = after.iter().copied().flatten().collect();
        // Of its own corners alone: a hierarchy copies the positions that it is given, and regions that go too far are many.
        let (places, compacted) = compact(&live.positions, &triangles);
        let surface = WideBvh::new(&places, &compacted);
        let went = heirs(records);
        map(self.threads, self.roots.len().div_ceil(SAMPLES_A_TASK), &|task| {
            let mut hints = Hints::new(self.limit, None);
            let mut far = Farthest::new();
            let some = self.samples.iter().zip(&self.roots).skip(task * SAMPLES_A_TASK).take(SAMPLES_A_TASK);
            for (&sample, &root) in some {
                let heir = went.get(root).unwrap_or(root);
                let lost = went.get(heir).is_some() || live.stars.corners(heir).next().is_none();
                for point in self.points.points_at(live, &self.deviation.input, sample) {
                    let distance = length(sub(point, live.positions[heir as usize]));
                    if (distance > enough || lost)
                        && (triangles.is_empty() || !surface.any_within_again(point, enough, &mut hints))
                        && let Some(root) = self.removed_near(sample, root, point, &went)
                    {
                        keep_farther(&mut far, heir, LimitViolation { distance, root, point });
                    }
                }
            }
            far
        })
    }

    /// The vertex to hold for a point of an input vertex's: what that had become before this level or,
    /// where it had removed_wedges, the nearest corner of the face that stood for it.
    fn removed_near(&self, sample: u32, root: u32, point: Vec3, went: &SlotMap) -> Option<u32> {
        let live = self.live;
        if went.get(root).is_some() {
            return Some(root);
        }
        let corners = live.face_vertices[self.deviation.face_near(sample) as usize];
        let distance = |v: u32| length(sub(live.positions[v as usize], point));
        let removed = corners.into_iter().filter(|&v| went.get(v).is_some());
        removed.min_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)))
    }

    /// Whether a lattice of points on a face is within the limit of the input.
    fn near_input(&self, corners: [u32; 3]) -> bool {
        let [a, b, c] = corners.map(|v| self.live.positions[v as usize]);
        // The corners are this near the input, and no point is farther from all of them than a longest edge
        // over the root of 3.
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

    /// How many collapses leave the region within the limit, judged by some of the samples.
    fn longest_good_prefix(&self, records: &Records, regions: usize) -> usize {
        let budget = (SEARCH_SAMPLES / regions.max(1)).max(LEAST_SEARCH_SAMPLES);
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

/// What has become of each vertex that collapses remove; itself, where its faces vanished without another.
fn heirs(records: &Records) -> SlotMap {
    let mut heirs = SlotMap::with_room(records.collapses.len());
    // The last first: what became of a target is known.
    for collapse in records.collapses.iter().rev() {
        let heir = match collapse.target {
            NO_VERTEX => collapse.removed,
            target => heirs.get(target).unwrap_or(target),
        };
        heirs.insert(collapse.removed, heir);
    }
    heirs
}

/// A region's faces after its first `count` collapses; `None` where one has vanished.
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
