//! Arithmetic that gives the same bits on every machine.
//!
//! The scene must be the same byte for byte everywhere, but `f64::sin`, `powf` and similar functions use the platform's
//! maths library, whose last bits differ. IEEE 754 fixes the results of `+ − × ÷ √`, `floor` and comparisons, and Rust
//! never contracts `a * b + c`, so everything here is built from those. Angles are in turns (1 = 360°), which makes the
//! range reduction exact.

use glam::DVec3;

const TAU: f64 = std::f64::consts::TAU;

/// Sine of `turns`; absolute error below 1e-11 (Taylor series to x¹⁵ on a quarter turn).
pub(super) fn sin_turns(turns: f64) -> f64 {
    let mut r = turns - (turns + 0.5).floor();
    if r > 0.25 {
        r = 0.5 - r;
    } else if r < -0.25 {
        r = -0.5 - r;
    }
    let x = r * TAU;
    let x2 = x * x;
    let mut sum = 1.0;
    for k in (1..=7).rev() {
        let k = f64::from(2 * k);
        sum = 1.0 - sum * x2 / (k * (k + 1.0));
    }
    x * sum
}

/// Cosine of `turns`; see [`sin_turns`].
pub(super) fn cos_turns(turns: f64) -> f64 {
    sin_turns(turns + 0.25)
}

/// The angle of `(x, y)` in turns, from −0.5 to 0.5; 0 at the origin.
pub(super) fn atan2_turns(y: f64, x: f64) -> f64 {
    let (ax, ay) = (x.abs(), y.abs());
    let big = ax.max(ay);
    if big == 0.0 {
        return 0.0;
    }
    let small = ax.min(ay) / big;
    // Two half-angle steps bring the argument below tan(π/16), where a short series suffices.
    let half = small / (1.0 + (1.0 + small * small).sqrt());
    let quarter = half / (1.0 + (1.0 + half * half).sqrt());
    let q2 = quarter * quarter;
    let series = 1.0 - q2 * (1.0 / 3.0 - q2 * (1.0 / 5.0 - q2 * (1.0 / 7.0 - q2 * (1.0 / 9.0 - q2 / 11.0))));
    let mut turns = 4.0 * quarter * series / TAU;
    if ay > ax {
        turns = 0.25 - turns;
    }
    if x < 0.0 {
        turns = 0.5 - turns;
    }
    if y < 0.0 { -turns } else { turns }
}

/// Hermite step: 0 below `low`, 1 above `high`, smooth between.
pub(super) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Linear interpolation.
pub(super) fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// `v` at length 1, or `fallback` where `v` has no length.
pub(super) fn unit_or(v: DVec3, fallback: DVec3) -> DVec3 {
    let length = v.length();
    if length > 1e-30 { v / length } else { fallback }
}

/// Position at `t` in 0..=1 on the Catmull–Rom spline through `points` (end tangents clamped).
pub(super) fn catmull_rom(points: &[DVec3], t: f64) -> DVec3 {
    let Some(last) = points.len().checked_sub(1) else { return DVec3::ZERO };
    if last == 0 {
        return points[0];
    }
    let x = t.clamp(0.0, 1.0) * last as f64;
    let i = (x.floor() as usize).min(last - 1);
    let f = x - i as f64;
    let p0 = points[i.saturating_sub(1)];
    let p1 = points[i];
    let p2 = points[i + 1];
    let p3 = points[(i + 2).min(last)];
    (p1 * 2.0
        + (p2 - p0) * f
        + (p0 * 2.0 - p1 * 5.0 + p2 * 4.0 - p3) * (f * f)
        + (p1 * 3.0 - p0 - p2 * 3.0 + p3) * (f * f * f))
        * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_trigonometry_agrees_with_the_library() {
        for i in -4000..4000 {
            let turns = f64::from(i) / 1000.0;
            let angle = turns * TAU;
            assert!((sin_turns(turns) - angle.sin()).abs() < 1e-10, "sin {turns}");
            assert!((cos_turns(turns) - angle.cos()).abs() < 1e-10, "cos {turns}");
            let (s, c) = (0.3 * angle.sin(), 0.3 * angle.cos());
            let difference = atan2_turns(s, c) * TAU - s.atan2(c);
            assert!(difference.abs() < 1e-8, "atan2 {turns}: {difference}");
        }
        assert_eq!(atan2_turns(0.0, 0.0), 0.0);
    }

    #[test]
    fn spline_passes_through_its_points() {
        let points = [DVec3::ZERO, DVec3::X, DVec3::new(2.0, 1.0, 0.0), DVec3::Y];
        for (i, p) in points.iter().enumerate() {
            assert!(catmull_rom(&points, i as f64 / 3.0).distance(*p) < 1e-12);
        }
    }
}
