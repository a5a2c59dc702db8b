//! Cost of collapses: quadrics, edge length × curvature, or octree cells for clustering.

use crate::mesh::corner;
use crate::mesh::vec3::{Vec3, dot, length, scale, sub, triangle_normal};
use crate::simplify::region::Region;
use crate::simplify::settings::Metric;

/// Orders edges of flat areas: cost per fourth power of the edge length (like a point quadric, without its memory).
const FLAT_ORDER: f64 = 1e-9;
/// Orders edges of flat areas with Melax's cost, per edge length.
const FLAT_CURVATURE: f64 = 1e-9;
/// Orders equal weights by distance: cost per edge length, as a share of the cell.
const NEAR_FIRST: f64 = 1e-3;

/// Computes costs, with buffers for the star of one vertex.
#[derive(Default)]
pub(crate) struct Pricer {
    /// Corners of each face of the star with its unit normal, zero for degenerate faces.
    star: Vec<([u32; 3], Vec3)>,
    /// Directions of its edges, and the vertex's weight for clustering.
    edges: Vec<Vec3>,
    weight: f64,
}

impl Pricer {
    /// Prepares for [`Pricer::cost`] of another `u`, or after a change at `u`.
    pub(crate) fn prepare(&mut self, region: &Region, u: u32) {
        if region.metric.clusters() {
            self.weight = self.clustering_weight(region, u);
        }
        if region.metric != Metric::Melax {
            return;
        }
        self.star.clear();
        self.star.extend(region.stars.corners(u).map(|corner| {
            let corners = region.corners[(corner / 3) as usize];
            let [a, b, c] = corners.map(|v| region.positions[v as usize]);
            let normal = triangle_normal(a, b, c);
            let size = length(normal);
            (corners, if size > 0.0 { scale(normal, 1.0 / size) } else { [0.0; 3] })
        }));
    }

    /// The cost of collapsing `u` onto `t`: cells⁴ for quadrics (area × squared distance), cells for the others.
    pub(crate) fn cost(&self, region: &Region, u: u32, t: u32) -> f64 {
        let edge = sub(region.positions[u as usize], region.positions[t as usize]);
        let square = dot(edge, edge);
        match region.metric {
            Metric::Qem => region.quadric_cost(u, t) + FLAT_ORDER * square * square,
            Metric::Melax => square.sqrt() * (self.curvature(t) + FLAT_CURVATURE),
            Metric::Clustering | Metric::ClusteringSeams => {
                let cell = f64::from(1_u32 << shared_level(region.cell(u), region.cell(t)));
                // Between this cell's size and the next, so cells are emptied level by level.
                cell * (1.0 + 0.9 * self.weight) + NEAR_FIRST * square.sqrt().min(cell)
            }
        }
    }

    /// cos(θ/2), where θ is the largest angle between two edges at `u` (Low and Tan 1997): 0 in a plane, 1 at a
    /// spike.
    fn clustering_weight(&mut self, region: &Region, u: u32) -> f64 {
        let at = region.positions[u as usize];
        self.edges.clear();
        self.edges.extend(region.stars.corners(u).flat_map(|corner| {
            let (corners, k) = (region.corners[corner::face_of(corner) as usize], corner::side_of(corner));
            [corners[corner::next(k)], corners[corner::previous(k)]].map(|v| {
                let edge = sub(region.positions[v as usize], at);
                let size = length(edge);
                if size > 0.0 { scale(edge, 1.0 / size) } else { [0.0; 3] }
            })
        }));
        let mut widest = 1.0_f64;
        for (i, a) in self.edges.iter().enumerate() {
            widest = self.edges[i + 1..].iter().map(|b| dot(*a, *b)).fold(widest, f64::min);
        }
        (0.5 * (1.0 + widest.max(-1.0))).sqrt()
    }

    /// Melax's curvature at the star's vertex towards `t`: the maximum over its faces of the smallest angle to a face
    /// at the edge; 0 flat, 1 folded back.
    fn curvature(&self, t: u32) -> f64 {
        let mut most = 0.0_f64;
        for (_, face) in &self.star {
            let mut least = 1.0_f64;
            for (_, side) in self.star.iter().filter(|(corners, _)| corners.contains(&t)) {
                least = least.min((1.0 - dot(*face, *side)) * 0.5);
            }
            most = most.max(least);
        }
        most
    }
}

/// Level of the smallest octree cell that contains both grid cells; 0 for a grid cell itself.
fn shared_level(a: [i32; 3], b: [i32; 3]) -> u32 {
    let differing = (0..3).map(|k| (a[k] ^ b[k]).unsigned_abs()).fold(0, |all, bits| all | bits);
    (u32::BITS - differing.leading_zeros()).min(u32::BITS - 1)
}

#[cfg(test)]
mod tests {
    use super::shared_level;

    #[test]
    fn cells_share_the_smallest_cell_of_the_octree_that_holds_both() {
        assert_eq!(shared_level([5, 6, 7], [5, 6, 7]), 0);
        assert_eq!(shared_level([4, 6, 7], [5, 6, 7]), 1);
        // Adjacent, but on different sides of the middle.
        assert_eq!(shared_level([7, 0, 0], [8, 0, 0]), 4);
        assert_eq!(shared_level([1, 9, 0], [0, 8, 2]), 2);
    }
}
