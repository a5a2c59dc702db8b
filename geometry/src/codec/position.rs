//! Predicting and coding where a new vertex is.
//!
//! Connectivity comes first, so the whole one-ring is known. The prediction is the ring's mean plus a
//! quarter of the neighbours' Laplacian; the two axes nearest the tangent plane are coded first, then
//! the third, predicted on the ring's plane through them plus 0.7 of the Laplacian's normal part. The
//! two shares come from a prototype on scans and have not been tuned here. Only + − × ÷ √ on f64 in a
//! fixed order, so every machine predicts the same integers.

use crate::codec::local::Local;
use crate::codec::model::Residual;
use crate::error::DecodeError;
use crate::range_coder::Coder;
use crate::vec3::{Vec3, add, cross, dot, length, scale, sub};

/// Share of the Laplacian added to the mean.
const TANGENTIAL: f64 = 0.25;
/// Share of its normal part added to the third axis.
const NORMAL: f64 = 0.7;
/// Class of a residual as long as the mean edge.
const CENTER: i32 = 32;

/// What the ring says about its centre.
struct Prediction {
    guess: Vec3,
    mean: Vec3,
    normal: Vec3,
    lift: f64,
    /// Axes in coding order; the last is the one nearest the normal.
    axes: [usize; 3],
    /// Bits of the ring's mean radius.
    scale_bits: i32,
}

/// Codes the position of `vertex`, whose faces are in place, and sets it.
pub(crate) fn code_position<C: Coder>(
    coder: &mut C,
    models: &mut [Residual; 3],
    local: &mut Local<'_>,
    vertex: u32,
    actual: Option<[i32; 3]>,
    bits: u8,
) -> Result<(), DecodeError> {
    let prediction = predict(local, vertex);
    let mut position = [0_i32; 3];
    let mut exact = prediction.guess;
    for (step, &axis) in prediction.axes.iter().enumerate() {
        let guess = if step < 2 || prediction.normal[axis] == 0.0 {
            exact[axis]
        } else {
            let (a, b) = (prediction.axes[0], prediction.axes[1]);
            let n = prediction.normal;
            let m = prediction.mean;
            m[axis] + (prediction.lift - (n[a] * (exact[a] - m[a]) + n[b] * (exact[b] - m[b]))) / n[axis]
        };
        let top = f64::from((1_u32 << bits) - 1);
        let guess = (guess.clamp(0.0, top) + 0.5).floor() as i32;
        let residual = actual.map_or(0, |p| p[axis] - guess);
        let got = code_residual(coder, &mut models[step], prediction.scale_bits, residual);
        position[axis] = guess.wrapping_add(got);
        if position[axis] < 0 || position[axis] >= 1 << bits {
            return Err(DecodeError::new("chunk", "a position is off the grid"));
        }
        exact[axis] = f64::from(position[axis]);
    }
    local.vertices[vertex as usize].position = position;
    Ok(())
}

fn code_residual<C: Coder>(coder: &mut C, model: &mut Residual, scale_bits: i32, value: i32) -> i32 {
    let class = 32 - value.unsigned_abs().leading_zeros() as i32;
    let symbol = model.class.code(coder, (class - scale_bits + CENTER).clamp(0, 63) as u32);
    let class = (symbol as i32 - CENTER + scale_bits).clamp(0, 30);
    if class == 0 {
        return 0;
    }
    let magnitude = value.unsigned_abs();
    let mut got = 1_u32;
    if class >= 2 {
        let below = class as u32 - 1;
        let second = coder.bit(&mut model.second[symbol as usize], (magnitude >> (below - 1)) & 1 == 1);
        let rest = coder.raw(below - 1, magnitude & ((1 << (below - 1)) - 1));
        got = (1 << below) | (u32::from(second) << (below - 1)) | rest;
    }
    if coder.raw(1, u32::from(value < 0)) == 1 { -(got as i32) } else { got as i32 }
}

fn predict(local: &Local<'_>, vertex: u32) -> Prediction {
    let star = local.star(vertex);
    let mut ring = Vec::with_capacity(2 * star.len());
    local.ring(vertex, &mut ring);
    let mean = mean_of(local, &ring);
    let mut laplacian = [0.0; 3];
    let mut counted = 0.0;
    let mut radius = 0.0;
    let mut around = Vec::new();
    for &w in &ring {
        let at = local.position(w);
        radius += length(sub(at, mean));
        local.ring(w, &mut around);
        around.retain(|&x| x != vertex);
        if around.len() >= 3 {
            laplacian = add(laplacian, sub(at, mean_of(local, &around)));
            counted += 1.0;
        }
    }
    if counted > 0.0 {
        laplacian = scale(laplacian, 1.0 / counted);
    }
    let radius = radius / (ring.len().max(1) as f64);
    let mut normal = [0.0; 3];
    for s in &star {
        normal = add(normal, cross(sub(local.position(s.a), mean), sub(local.position(s.b), mean)));
    }
    let size = length(normal);
    if size > 0.0 {
        normal = scale(normal, 1.0 / size);
    }
    let last = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())).unwrap_or(2);
    let axes = match last {
        0 => [1, 2, 0],
        1 => [0, 2, 1],
        _ => [0, 1, 2],
    };
    Prediction {
        guess: add(mean, scale(laplacian, TANGENTIAL)),
        mean,
        normal,
        lift: NORMAL * dot(laplacian, normal),
        axes,
        scale_bits: 32 - (radius.min(1e9) as u32).leading_zeros() as i32,
    }
}

fn mean_of(local: &Local<'_>, vertices: &[u32]) -> Vec3 {
    let mut sum = [0.0; 3];
    for &v in vertices {
        sum = add(sum, local.position(v));
    }
    scale(sum, 1.0 / vertices.len().max(1) as f64)
}
