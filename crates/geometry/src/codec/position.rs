//! Prediction and coding of a new vertex's position.
//!
//! Connectivity is coded first, so the complete one-ring is known. In the tangent plane the prediction is the ring's
//! mean, shifted by shares of the neighbours' Laplacian, of the old vertex and of the ends of the new edges. The two
//! axes nearest the tangent plane are coded first. Then a small network predicts the height above the ring's plane
//! and its error from the ring's shape around the known coordinates ([`crate::codec::height`]). With
//! [`Codec::AxisAligned`](crate::entropy::Codec::AxisAligned) the prediction differs, and each coordinate may repeat
//! a neighbour's ([`crate::codec::repeat`]). Only + − × ÷ √ in a fixed order are used, so every machine predicts the
//! same integers.

use crate::codec::chunk_coder::ChunkCoder;
use crate::codec::fan::StarFace;
use crate::codec::height::{self, INPUTS};
use crate::codec::local::Local;
use crate::codec::model::{
    MIX_RESIDUAL, RESIDUAL_OTHER, RESIDUAL_RECENT, RESIDUAL_REST, RESIDUAL_SIGN, SIZE_OTHER_CONTEXTS,
    SIZE_RECENT_CONTEXTS,
};
use crate::codec::repeat::Coordinate;
use crate::codec::residual::{Residual, quarter_octaves};
use crate::entropy::range_coder::Coder;
use crate::error::DecodeError;
use crate::mesh::vec3::{Vec3, add, cross, dot, scale, sub};
use crate::numbers::{real, truncated};

/// Shares of the neighbours' Laplacian, of the old vertex and of each end of the new edges, relative to the ring's
/// mean. Least squares over the benchmark models without the bunny.
const LAPLACIAN_SHARE: f64 = 0.23;
const TARGET_SHARE: f64 = 0.22;
/// Share of the old vertex with the axis-aligned codec.
const AXIS_ALIGNED_TARGET_SHARE: f64 = 0.6;
const END_SHARE: f64 = -0.075;
/// Expected residual in the tangent plane over the ring's radius.
const TANGENTIAL_SIZE: f64 = 0.18;

/// Contexts of the three steps.
pub(crate) const POSITION: [Residual; 3] = [step(0), step(1), step(2)];

const fn step(step: usize) -> Residual {
    Residual {
        recent: RESIDUAL_RECENT + step * SIZE_RECENT_CONTEXTS,
        other: RESIDUAL_OTHER + step * SIZE_OTHER_CONTEXTS,
        sign: RESIDUAL_SIGN + step,
        rest: RESIDUAL_REST,
        mixer: MIX_RESIDUAL + step,
    }
}

/// The ring around a new vertex.
struct Ring {
    mean: Vec3,
    /// Unit normal.
    normal: Vec3,
    laplacian: Vec3,
    /// Root of the mean square distance from the mean; not zero.
    radius: f64,
    /// Axes in coding order; the last is the one nearest the normal.
    axes: [usize; 3],
}

/// Neighbours with a role in the split: the vertex it splits from, and the ends of the new edges.
#[derive(Clone, Copy)]
pub(crate) struct Roles {
    pub(crate) target: u32,
    pub(crate) ends: [Option<u32>; 2],
}

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes the position of `vertex`, whose star is given, on a grid that leaves out `shift` bits.
    pub(crate) fn position(
        &mut self,
        vertex: u32,
        star: &[StarFace],
        roles: Roles,
        shift: u8,
        actual: Option<[i32; 3]>,
    ) -> Result<[i32; 3], DecodeError> {
        let bits = self.resolution.bits;
        let ring = ring(&self.local, star, vertex);
        let top = f64::from((1_u32 << bits) - 1);
        let built = self.axis_aligned();
        let mut exact = tangential_guess(&self.local, &ring, roles, TARGET_SHARE);
        let aim = if built {
            tangential_guess(&self.local, &ring, roles, AXIS_ALIGNED_TARGET_SHARE)
        } else {
            exact
        };
        let mut position = [0_i32; 3];
        let mut other = 3;
        let mut before = 0;
        for (step, &axis) in ring.axes.iter().enumerate() {
            let mut size = quarter_octaves(ring.radius * TANGENTIAL_SIZE);
            if step == 2 && ring.normal[axis] != 0.0 {
                let (third, log) = third_axis(&self.local, star, &ring, roles.target, exact);
                exact[axis] = third;
                size = log;
            }
            // Nothing here is negative, so truncation rounds down.
            let cell = 1.0 / f64::from(1_u32 << shift);
            let cell_of = |x: f64| truncated(x.clamp(0.0, top) * cell + 0.5);
            let guess = cell_of(exact[axis]);
            let size = size - 4 * i32::from(shift);
            let residual = actual.map_or(0, |p| (p[axis] >> shift) - guess);
            let shared = if built {
                let (radius, normal_component) = (ring.radius, ring.normal[axis].abs());
                let of =
                    Coordinate { step, axis, shift, guess: cell_of(aim[axis]), radius, normal_component };
                let want = self.guide.as_ref().map(|_| guess.wrapping_add(residual));
                self.repeated(star, roles.target, &of, &mut before, want)
            } else {
                None
            };
            let got = match shared {
                Some(cell) => cell.wrapping_sub(guess),
                None => POSITION[step].code(self.coder, size, self.recent.class(step), other, residual),
            };
            position[axis] = guess.wrapping_add(got).wrapping_shl(shift.into());
            if position[axis] < 0 || position[axis] >= 1 << bits {
                return Err(DecodeError::new("chunk", "a position is off the grid"));
            }
            exact[axis] = f64::from(position[axis]);
            other = self.recent.follow(step, got, size);
        }
        Ok(position)
    }
}

fn ring(local: &Local<'_>, star: &[StarFace], vertex: u32) -> Ring {
    let at = local.position(vertex);
    let mean = local.mean_of_ends(vertex, 0, at).unwrap_or(at);
    let mut laplacian = [0.0; 3];
    let mut counted = 0.0;
    let mut square = 0.0;
    let mut normal = [0.0; 3];
    for s in star {
        let (a, b) = (local.position(s.a), local.position(s.b));
        let from = sub(a, mean);
        square += dot(from, from);
        normal = add(normal, cross(from, sub(b, mean)));
        // Each neighbour in a closed star is an `a` once, and shares two faces with the vertex.
        if let Some(around) = local.mean_of_ends(s.a, 2, at) {
            laplacian = add(laplacian, sub(a, around));
            counted += 1.0;
        }
    }
    if counted > 0.0 {
        laplacian = scale(laplacian, 1.0 / counted);
    }
    let size = dot(normal, normal).sqrt();
    if size > 0.0 {
        normal = scale(normal, 1.0 / size);
    }
    let axes = axes(normal);
    let radius = (square / real(star.len().max(1))).sqrt().max(0.25);
    Ring { mean, normal, laplacian, radius, axes }
}

/// The axes, ordered so that the one nearest a normal is last.
pub(crate) fn axes(normal: Vec3) -> [usize; 3] {
    let last = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())).unwrap_or(2);
    match last {
        0 => [1, 2, 0],
        1 => [0, 2, 1],
        _ => [0, 1, 2],
    }
}

fn tangential_guess(local: &Local<'_>, ring: &Ring, roles: Roles, target_share: f64) -> Vec3 {
    let mut guess = add(ring.mean, scale(ring.laplacian, LAPLACIAN_SHARE));
    guess = add(guess, scale(sub(local.position(roles.target), ring.mean), target_share));
    for end in roles.ends.into_iter().flatten() {
        guess = add(guess, scale(sub(local.position(end), ring.mean), END_SHARE));
    }
    guess
}

/// Predicts the third axis when the first two coordinates of `known` are set: the coordinate, and the expected
/// residual in quarter octaves.
fn third_axis(local: &Local<'_>, star: &[StarFace], ring: &Ring, target: u32, known: Vec3) -> (f64, i32) {
    let [a, b, c] = ring.axes;
    let n = ring.normal;
    let inverse = 1.0 / ring.radius;
    // Intersection of the axis through the known coordinates with the plane through the mean.
    let slope = (n[a] * (known[a] - ring.mean[a]) + n[b] * (known[b] - ring.mean[b])) / n[c];
    let mut foot = known;
    foot[c] = ring.mean[c] - slope;
    let place = scale(sub(foot, ring.mean), inverse);
    // A frame in the plane: away from the old vertex, and across.
    let from = sub(ring.mean, local.position(target));
    let along = sub(from, scale(n, dot(from, n)));
    let size = dot(along, along).sqrt();
    let e1 = if size > 0.0 { scale(along, 1.0 / size) } else { [0.0; 3] };
    let e2 = cross(n, e1);
    let lift = dot(ring.laplacian, n) * inverse;
    let (x, y) = (dot(place, e1), dot(place, e2));
    let mut sums = [0.0; 4];
    let (mut near, mut weight) = (0.0, 0.0);
    for s in star {
        let q = scale(sub(local.position(s.a), ring.mean), inverse);
        let (u, v, h) = (dot(q, e1), dot(q, e2), dot(q, n));
        let gap = sub(q, place);
        let w = 1.0 / (dot(gap, gap) + 0.05);
        near += w * h;
        weight += w;
        for (sum, x) in sums.iter_mut().zip([h * u * u, h * v * v, h * h, 1.0]) {
            *sum += x;
        }
    }
    let count = 1.0 / f64::max(sums[3], 1.0);
    let distance = x * x + y * y;
    let radius = (f64::from(quarter_octaves(ring.radius)) * 0.25 - 5.0).clamp(-3.0, 3.0) / 3.0;
    let inputs: [f64; INPUTS] = [
        near / weight.max(1e-9),
        lift,
        x,
        y,
        distance,
        sums[0] * count,
        sums[1] * count,
        sums[2] * count,
        -dot(from, n) * inverse,
        distance * lift,
        sums[3] / 6.0 - 1.0,
        radius,
    ];
    let (height, log) = height::predict(&inputs);
    let third = foot[c] + height * ring.radius / n[c];
    (third, log + quarter_octaves(ring.radius / n[c].abs()))
}
