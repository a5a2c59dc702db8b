//! Partitions the live faces of a level into regions: balanced, compact, in different places at each level.
//!
//! Recursive bisection of face centroids (a k-d split by count), in a frame that rotates from level to level and with
//! an uneven first cut, so that the outlines of one level lie inside the regions of the next. A few rounds of
//! majority voting straighten the outlines, which leaves more interior vertices.

use crate::error::MeshError;
use crate::mesh::vec3::{Vec3, dot};
use crate::pool::MonitoredPool;

/// Rounds of majority voting.
const SMOOTHING_ROUNDS: usize = 3;

/// No adjacent face.
pub(crate) const NO_FACE: u32 = u32::MAX;

/// Assigns each face to a region `0..count`.
///
/// `adjacent` is called if there is more than one region; it returns a face across each edge of each face, or
/// [`NO_FACE`].
pub(crate) fn partition<C: ExactSizeIterator<Item = Vec3>>(
    centroids: &(dyn Fn() -> C + Sync),
    adjacent: &(dyn Fn() -> Vec<[u32; 3]> + Sync),
    count: usize,
    level: usize,
    pool: &MonitoredPool<'_>,
) -> Result<Vec<u32>, MeshError> {
    if count <= 1 {
        return Ok(halves(centroids(), count, level));
    }
    let (mut region, adjacent) = pool.both(&|| halves(centroids(), count, level), adjacent)?;
    smooth(&mut region, count, &adjacent);
    Ok(region)
}

/// The partition without smoothing of outlines.
pub(crate) fn halves(centroids: impl ExactSizeIterator<Item = Vec3>, count: usize, level: usize) -> Vec<u32> {
    let mut region = vec![0_u32; centroids.len()];
    if count <= 1 {
        return region;
    }
    let axes = FRAMES[level % FRAMES.len()];
    let mut points: Vec<Point> = centroids
        .zip(0..)
        .map(|(c, face)| Point { at: axes.map(|axis| dot(c, axis) as f32), face })
        .collect();
    bisect(&mut points, 0, count, FIRST_CUTS[level % FIRST_CUTS.len()], &mut region);
    region
}

/// A face's centroid in the level's frame. Single precision: cuts need not be exact, only reproducible.
#[derive(Clone, Copy)]
struct Point {
    at: [f32; 3],
    face: u32,
}

/// Share of the regions on the lower side of a cut, by level.
const FIRST_CUTS: [f64; 5] = [0.5, 0.38, 0.62, 0.44, 0.56];

/// Orthogonal frames (rows) by level: multiples of rational rotations, so exact on every machine.
const FRAMES: [[Vec3; 3]; 4] = [
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [
        [2.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0],
        [-2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0],
        [1.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0],
    ],
    [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]],
    [
        [6.0 / 7.0, 2.0 / 7.0, 3.0 / 7.0],
        [2.0 / 7.0, 3.0 / 7.0, -6.0 / 7.0],
        [-3.0 / 7.0, 6.0 / 7.0, 2.0 / 7.0],
    ],
];

fn bisect(points: &mut [Point], first: u32, count: usize, cut: f64, region: &mut [u32]) {
    if count <= 1 || points.len() <= 1 {
        for point in points.iter() {
            region[point.face as usize] = first;
        }
        return;
    }
    let lower = ((count as f64 * cut).round() as usize).clamp(1, count - 1);
    let at = (points.len() * lower / count).clamp(1, points.len() - 1);
    let axis = longest_axis(points);
    points.select_nth_unstable_by(at, |a, b| a.at[axis].total_cmp(&b.at[axis]).then(a.face.cmp(&b.face)));
    let (low, high) = points.split_at_mut(at);
    bisect(low, first, lower, cut, region);
    bisect(high, first + lower as u32, count - lower, 1.0 - cut, region);
}

fn longest_axis(points: &[Point]) -> usize {
    let mut min = [f32::INFINITY; 3];
    let mut max = [f32::NEG_INFINITY; 3];
    for point in points {
        for axis in 0..3 {
            min[axis] = min[axis].min(point.at[axis]);
            max[axis] = max[axis].max(point.at[axis]);
        }
    }
    let extent = [0, 1, 2].map(|axis| max[axis] - min[axis]);
    (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b]).then(b.cmp(&a))).unwrap_or(0)
}

/// Moves faces to the region of most of their neighbours, in index order, a few times.
fn smooth(region: &mut [u32], count: usize, adjacent: &[[u32; 3]]) {
    let mut size = vec![0_usize; count];
    for &r in region.iter() {
        size[r as usize] += 1;
    }
    for _ in 0..SMOOTHING_ROUNDS {
        for face in 0..region.len() {
            let own = region[face];
            let around =
                adjacent[face].map(|other| if other == NO_FACE { NO_FACE } else { region[other as usize] });
            let same = around.iter().filter(|&&r| r == own).count();
            let votes = |r: u32| around.iter().filter(|&&x| x == r).count();
            let others = around.iter().copied().filter(|&r| r != own && r != NO_FACE);
            let best = others.max_by_key(|&r| (votes(r), std::cmp::Reverse(r)));
            if let Some(best) = best.filter(|&r| votes(r) > same && size[own as usize] > 1) {
                region[face] = best;
                size[own as usize] -= 1;
                size[best as usize] += 1;
            }
        }
    }
}
