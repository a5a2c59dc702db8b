//! GTAO: `gtao.wgsl`.

use std::f64::consts::FRAC_PI_2;

use super::receiver::{MIN_ELEVATION, Receiver};
use super::slices::{Slice, counts};

pub(super) fn sums(r: &Receiver<'_>) -> [f64; 2] {
    let (slices, steps) = counts(r);
    let mut sums = [0.0; 2];
    for slice in (0..slices).map(|number| Slice::new(r, number)) {
        for side in [-1.0, 1.0] {
            let mut horizon = -side * slice.sine;
            let mut open = slice.arc(slice.angle + side * FRAC_PI_2);
            sums[1] += slice.normal_length * open;
            let mut last = [0.0; 3];
            for step in 0..steps {
                let to = slice.drawn_at(r, step, side);
                let [x, y] = slice.within(r, to);
                let distance = x.hypot(y);
                let cosine = (y * slice.cosine - x * slice.sine) / distance.max(1e-30);
                let met = r.met_between(last, to);
                last = to;
                if y > MIN_ELEVATION * distance && cosine > horizon {
                    let left = slice.arc(side * cosine.clamp(-1.0, 1.0).acos());
                    sums[0] += slice.normal_length * met * (open - left);
                    (horizon, open) = (cosine, left);
                }
            }
        }
    }
    [sums[0].max(0.0), sums[1].max(1e-6)]
}
