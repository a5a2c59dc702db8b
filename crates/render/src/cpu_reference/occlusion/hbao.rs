//! HBAO: `hbao.wgsl`.

use std::f64::consts::TAU;

use super::receiver::{MIN_ELEVATION, Receiver};
use crate::cpu_reference::surface::dot;

pub(super) fn sums(r: &Receiver<'_>) -> [f64; 2] {
    let steps = (r.samples / 4).clamp(1, 4);
    let directions = (r.samples / steps).max(1);
    let mut occluded = 0.0;
    for i in 0..directions {
        let (sin, cos) = (TAU * (i as f64 + f64::from(r.rotation) / 16.0) / directions as f64).sin_cos();
        let mut horizon = MIN_ELEVATION * MIN_ELEVATION;
        let mut last = [0.0; 3];
        for k in 0..steps {
            let share = (k as f64 + r.march_offset()) / steps as f64;
            let to = r.drawn_at([cos, sin].map(|x| x * r.march_px(share)));
            let height = dot(to, r.normal);
            let squared = dot(to, to);
            let rise = height * height / squared.max(1e-30);
            let met = r.met_between(last, to);
            last = to;
            if height > 0.0 && rise > horizon {
                occluded += met * (rise - horizon);
                horizon = rise;
            }
        }
    }
    [occluded, directions as f64]
}
