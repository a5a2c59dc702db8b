//! What collapses cost: quadrics, or edge length × curvature.

use crate::mesh::vec3::{Vec3, dot, length, scale, sub, triangle_normal};
use crate::simplify::region::Region;
use crate::simplify::settings::Metric;

/// Gives edges of flat areas an order: cost per fourth power of the edge length (a point quadric
/// would do the same; this needs no memory).
const FLAT_ORDER: f64 = 1e-9;
/// The same for Melax's cost, per edge length.
const FLAT_CURVATURE: f64 = 1e-9;

/// Computes costs; keeps room for the normals of a star.
#[derive(Default)]
pub(crate) struct Pricer {
    /// Corners of each face of the star and its unit normal, zero where it has none.
    star: Vec<([u32; 3], Vec3)>,
}

impl Pricer {
    /// Must be called before [`Pricer::cost`] for another `u`, or after a change at `u`.
    pub(crate) fn look_at(&mut self, region: &Region, u: u32) {
        if region.metric == Metric::Qem {
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

    /// The cost of `u` onto `t`: cells⁴ for quadrics (area × squared distance), cells for Melax.
    pub(crate) fn cost(&self, region: &Region, u: u32, t: u32) -> f64 {
        let edge = sub(region.positions[u as usize], region.positions[t as usize]);
        let square = dot(edge, edge);
        match region.metric {
            Metric::Qem => region.quadric_cost(u, t) + FLAT_ORDER * square * square,
            Metric::Melax => square.sqrt() * (self.curvature(t) + FLAT_CURVATURE),
        }
    }

    /// Melax's curvature at the star's vertex towards `t`: over the faces around it, the most that the
    /// nearest in direction of the faces at the edge turns away; 0 flat, 1 folded back.
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
