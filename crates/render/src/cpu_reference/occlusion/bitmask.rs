//! Visibility bitmasks: `bitmask.wgsl`.

use std::f64::consts::{FRAC_PI_2, PI};

use super::receiver::{MIN_ELEVATION, Receiver};
use super::slices::{Slice, counts};

const THICKNESS: f64 = 0.5;

fn sectors(low: f64, high: f64, dither: f64) -> u32 {
    let [first, last] = [low, high].map(|share| (share * 32.0 + dither).clamp(0.0, 32.0) as u32);
    if last <= first { 0 } else { (u32::MAX >> (32 - (last - first))) << first }
}

pub(super) fn sums(r: &Receiver<'_>) -> [f64; 2] {
    let (slices, steps) = counts(r);
    let dither = (f64::from((r.rotation * 7 + 1) & 15) + 0.5) / 16.0;
    let mut sums = [0.0; 2];
    for slice in (0..slices).map(|number| Slice::new(r, number)) {
        let begin = slice.signed_arc(slice.angle - FRAC_PI_2);
        let whole = slice.signed_arc(slice.angle + FRAC_PI_2) - begin;
        let (mut hidden, mut occluded, mut last) = (0_u32, 0.0, [[0.0; 3]; 2]);
        for (step, end) in (0..steps).flat_map(|step| [(step, 0), (step, 1)]) {
            let to = slice.drawn_at(r, step, [-1.0, 1.0][end]);
            let [x, y] = slice.within(r, to);
            let met = r.met_between(last[end], to);
            last[end] = to;
            if y <= MIN_ELEVATION * x.hypot(y) {
                continue;
            }
            let behind = THICKNESS * r.radius;
            let near = x.atan2(y);
            let far = (x + behind * slice.sine).atan2(y - behind * slice.cosine);
            let [low, high] = if near >= -slice.angle {
                [near, if far < near { PI } else { far }]
            } else {
                [if far > near { -PI } else { far }, near]
            };
            let share =
                |end: f64| (slice.signed_arc(end.clamp(-FRAC_PI_2, FRAC_PI_2) + slice.angle) - begin) / whole;
            let covered = sectors(share(low), share(high), dither);
            occluded += met * f64::from((covered & !hidden).count_ones()) / 32.0;
            hidden |= covered;
        }
        sums[0] += slice.normal_length * whole * occluded;
        sums[1] += slice.normal_length * whole;
    }
    [sums[0], sums[1].max(1e-6)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_are_as_many_as_their_share_in_the_mean() {
        assert_eq!(sectors(0.0, 1.0, 0.03), u32::MAX);
        assert_eq!((sectors(0.5, 0.5, 0.9), sectors(0.25, 0.5, 0.0)), (0, 0xff00));
        for (low, high) in [(0.1, 0.13), (0.0, 0.41), (0.6, 0.98)] {
            let n = 1000;
            let count = |i| sectors(low, high, (f64::from(i) + 0.5) / f64::from(n)).count_ones();
            let mean = (0..n).map(count).sum::<u32>() as f64 / f64::from(n);
            assert!((mean / 32.0 - (high - low)).abs() < 1e-3, "{low} {high}: {mean}");
        }
    }
}
