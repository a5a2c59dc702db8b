//! Alchemy ambient obscurance: `alchemy.wgsl`.

use std::f64::consts::TAU;

use super::receiver::{MIN_ELEVATION, Receiver};
use crate::cpu_reference::surface::dot;

const TURNS: f64 = 7.0;
const GAIN: f64 = 1.5;

pub(super) fn sums(r: &Receiver<'_>) -> [f64; 2] {
    let mut occluded = 0.0;
    for i in 0..r.samples {
        let share = (i as f64 + r.march_offset()) / r.samples as f64;
        let (sin, cos) = (TAU * (share * TURNS + f64::from(r.rotation) / 16.0)).sin_cos();
        let to = r.drawn_at([cos, sin].map(|x| x * r.march_px(share)));
        let squared = dot(to, to) / (r.radius * r.radius);
        let height = dot(to, r.normal) / r.radius - MIN_ELEVATION * squared.sqrt();
        occluded += (1.0 - squared).max(0.0).powi(3) * height.max(0.0) / (squared + 0.01);
    }
    [GAIN * occluded, r.samples as f64]
}
