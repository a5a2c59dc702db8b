//! Cuts the live faces of a level into regions: balanced, compact, in a different place each level.
//!
//! Recursive bisection of face centroids (a k-d split by count), in a frame that is turned from level
//! to level and with an uneven first cut, so that the outlines of one level lie inside the regions of
//! the next. A few rounds of majority voting then straighten the outlines: a straight outline leaves
//! more interior vertices.

use crate::vec3::{Vec3, dot};

/// Rounds of majority voting.
const SMOOTHING_ROUNDS: usize = 3;

/// Calls its second argument with every face that shares an edge with the first.
pub(crate) type Neighbours<'a> = &'a dyn Fn(usize, &mut dyn FnMut(usize));

/// Assigns each face to a region `0..count`; `centroids[i]` belongs to `faces[i]`.
///
/// `neighbours(i, f)` calls `f(j)` for every face `j` (as an index into `centroids`) that shares an edge with face `i`.
pub(crate) fn partition(
    centroids: &[Vec3],
    count: usize,
    level: usize,
    neighbours: Neighbours<'_>,
) -> Vec<u32> {
    let mut region = vec![0_u32; centroids.len()];
    if count <= 1 {
        return region;
    }
    let axes = FRAMES[level % FRAMES.len()];
    let turned: Vec<Vec3> =
        centroids.iter().map(|c| [dot(*c, axes[0]), dot(*c, axes[1]), dot(*c, axes[2])]).collect();
    let mut order: Vec<u32> = (0..centroids.len() as u32).collect();
    bisect(&turned, &mut order, 0, count, FIRST_CUTS[level % FIRST_CUTS.len()], &mut region);
    smooth(&mut region, count, neighbours);
    region
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

fn bisect(points: &[Vec3], order: &mut [u32], first: u32, count: usize, cut: f64, region: &mut [u32]) {
    if count <= 1 || order.len() <= 1 {
        for &face in order.iter() {
            region[face as usize] = first;
        }
        return;
    }
    let lower = ((count as f64 * cut).round() as usize).clamp(1, count - 1);
    let at = (order.len() * lower / count).clamp(1, order.len() - 1);
    let axis = longest_axis(points, order);
    let key = |face: &u32| (points[*face as usize][axis], *face);
    order.select_nth_unstable_by(at, |a, b| {
        let (ka, kb) = (key(a), key(b));
        ka.0.total_cmp(&kb.0).then(ka.1.cmp(&kb.1))
    });
    let (low, high) = order.split_at_mut(at);
    bisect(points, low, first, lower, cut, region);
    bisect(points, high, first + lower as u32, count - lower, 1.0 - cut, region);
}

fn longest_axis(points: &[Vec3], order: &[u32]) -> usize {
    let mut min = [f64::INFINITY; 3];
    let mut max = [f64::NEG_INFINITY; 3];
    for &face in order {
        for axis in 0..3 {
            min[axis] = min[axis].min(points[face as usize][axis]);
            max[axis] = max[axis].max(points[face as usize][axis]);
        }
    }
    let extent = [0, 1, 2].map(|axis| max[axis] - min[axis]);
    (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b]).then(b.cmp(&a))).unwrap_or(0)
}

/// Moves a face to the region that holds most of its neighbours, in index order, a few times.
fn smooth(region: &mut [u32], count: usize, neighbours: Neighbours<'_>) {
    let mut size = vec![0_usize; count];
    for &r in region.iter() {
        size[r as usize] += 1;
    }
    for _ in 0..SMOOTHING_ROUNDS {
        for face in 0..region.len() {
            let own = region[face];
            let (mut around, mut same) = ([u32::MAX; 8], 0);
            let mut n = 0;
            neighbours(face, &mut |other| {
                if region[other] == own {
                    same += 1;
                } else if n < around.len() {
                    around[n] = region[other];
                    n += 1;
                }
            });
            if n <= same || size[own as usize] <= 1 {
                continue;
            }
            let votes = |r: u32| around[..n].iter().filter(|&&x| x == r).count();
            let best = around[..n].iter().copied().max_by_key(|&r| (votes(r), std::cmp::Reverse(r)));
            if let Some(best) = best.filter(|&r| votes(r) > same) {
                region[face] = best;
                size[own as usize] -= 1;
                size[best as usize] += 1;
            }
        }
    }
}
