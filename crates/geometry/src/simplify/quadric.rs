//! Quadric error metric: Garland and Heckbert, "Surface simplification using quadric error metrics",
//! SIGGRAPH 1997, eq. 2; constraint planes of boundaries as in their §6.

use crate::mesh::vec3::{Vec3, dot};

/// A weighted sum of squared distances to planes, `vᵀAv + 2bᵀv + c`, with the symmetric part stored once.
///
/// Evaluated in f64 relative to the centre of the grid: in f32, cancellation dominates in flat regions far from the
/// origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Quadric([f64; 10]);

impl Quadric {
    /// `weight × (n·v + d)²` for the plane through `point` with the unit normal `n`.
    pub(crate) fn plane(n: Vec3, point: Vec3, weight: f64) -> Self {
        let d = -dot(n, point);
        let w = n.map(|x| x * weight);
        Self([
            w[0] * n[0],
            w[0] * n[1],
            w[0] * n[2],
            w[1] * n[1],
            w[1] * n[2],
            w[2] * n[2],
            w[0] * d,
            w[1] * d,
            w[2] * d,
            weight * d * d,
        ])
    }

    pub(crate) fn add(&mut self, other: &Self) {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a += b;
        }
    }

    /// Evaluates the sum at `v`; negative rounding errors are clamped to 0.
    pub(crate) fn evaluate(&self, v: Vec3) -> f64 {
        let q = &self.0;
        let [x, y, z] = v;
        let sum = q[0] * x * x
            + q[3] * y * y
            + q[5] * z * z
            + 2.0 * (q[1] * x * y + q[2] * x * z + q[4] * y * z + q[6] * x + q[7] * y + q[8] * z)
            + q[9];
        sum.max(0.0)
    }

    /// Sum of the planes' weights.
    pub(crate) fn weight(&self) -> f64 {
        self.0[0] + self.0[3] + self.0[5]
    }
}
