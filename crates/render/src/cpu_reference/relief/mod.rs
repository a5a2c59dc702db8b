//! Relief mapping: `relief_trace` of `relief_bisection.wgsl` and the exact intersection; further methods ([`methods`]) and test
//! maps ([`height_maps`]).

pub mod cones;
pub mod height_maps;
pub mod methods;
pub mod pyramid;
pub mod ray;

/// Halvings after the linear search, as in the shader.
pub const HALVINGS: u32 = 8;

/// Farthest that a ray is followed along the surface, in depths, as in the shader.
const MOST_SHIFT: f64 = 2.0;

/// Distance along the surface until a ray at this cosine is at full depth, as in the shader.
#[must_use]
pub fn reach(depth: f64, cosine: f64) -> f64 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    depth * (1.0 / cosine.max(1e-4)).min(MOST_SHIFT / sine.max(1e-4))
}

/// Linear steps for a cosine between ray and normal, of `most` at grazing angles, as in the shader.
#[must_use]
pub fn steps(most: u32, cosine: f64) -> u32 {
    let most = f64::from(most);
    (most + (0.25 * most - most) * cosine.clamp(0.0, 1.0)).ceil() as u32
}

/// A height map that repeats, sampled bilinearly with texel centres at (i + ½) / size.
#[derive(Clone, Debug)]
pub struct ReliefMap {
    /// Texels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Heights in 0..=1, rows from the top; as many as `width × height`.
    pub texels: Vec<f64>,
}

impl ReliefMap {
    fn texel(&self, x: i64, y: i64) -> f64 {
        let x = x.rem_euclid(self.width as i64) as usize;
        let y = y.rem_euclid(self.height as i64) as usize;
        self.texels[y * self.width + x]
    }

    /// Position in texels, such that texel centres lie at integers.
    fn to_texels(&self, uv: [f64; 2]) -> [f64; 2] {
        [uv[0] * self.width as f64 - 0.5, uv[1] * self.height as f64 - 0.5]
    }

    /// Height at a texture coordinate.
    #[must_use]
    pub fn sample(&self, uv: [f64; 2]) -> f64 {
        self.at_texels(self.to_texels(uv))
    }

    /// Height at a place in texels.
    fn at_texels(&self, [x, y]: [f64; 2]) -> f64 {
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let (i, j) = (x0 as i64, y0 as i64);
        let top = self.texel(i, j) * (1.0 - fx) + self.texel(i + 1, j) * fx;
        let bottom = self.texel(i, j + 1) * (1.0 - fx) + self.texel(i + 1, j + 1) * fx;
        top * (1.0 - fy) + bottom * fy
    }

    /// The shader's search: fraction of the way from `start` (at the surface) to `start + span` (at
    /// full depth) at which the ray meets the height field.
    #[must_use]
    pub fn trace(&self, start: [f64; 2], span: [f64; 2], steps: u32) -> f64 {
        let hidden = |s: f64| s >= 1.0 - self.sample([start[0] + span[0] * s, start[1] + span[1] * s]);
        let step = 1.0 / f64::from(steps.max(1));
        let mut below = step;
        for i in 1..steps {
            if hidden(below) {
                break;
            }
            below = f64::from(i + 1) * step;
        }
        let mut above = below - step;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (above + below);
            if hidden(middle) {
                below = middle;
            } else {
                above = middle;
            }
        }
        0.5 * (above + below)
    }

    /// Whether the shader's shadow test lets the sun reach a position: equal steps along its ray, which reaches the
    /// surface after `climb` times the position's depth.
    #[must_use]
    pub fn sunlit(&self, place: [f64; 2], climb: [f64; 2], steps: u32) -> bool {
        let below = 1.0 - self.sample(place);
        (1..steps).all(|i| {
            let risen = below * f64::from(i) / f64::from(steps);
            let there = [0, 1].map(|k| place[k] + climb[k] * risen);
            self.sample(there) <= 1.0 - below + risen + SHADOW_BIAS
        })
    }

    /// The exact first intersection: cell by cell, where clearance along the ray is a quadratic.
    #[must_use]
    pub fn intersect(&self, start: [f64; 2], span: [f64; 2]) -> f64 {
        let at = |s: f64| self.to_texels([start[0] + span[0] * s, start[1] + span[1] * s]);
        let clearance = |s: f64| 1.0 - self.sample([start[0] + span[0] * s, start[1] + span[1] * s]) - s;
        // Parameters at which the ray crosses a row or column of texel centres.
        let mut cuts = vec![0.0, 1.0];
        let (a, b) = (at(0.0), at(1.0));
        for axis in 0..2 {
            let (lo, hi) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
            let mut line = lo.ceil();
            while line < hi {
                cuts.push((line - a[axis]) / (b[axis] - a[axis]));
                line += 1.0;
            }
        }
        cuts.sort_by(f64::total_cmp);
        if clearance(0.0) <= 0.0 {
            return 0.0;
        }
        for cell in cuts.windows(2) {
            if let Some(hit) = within_patch(&clearance, [cell[0], cell[1]]) {
                return hit;
            }
        }
        1.0
    }
}

/// Heights that reach into the sun's ray by less than this hide nothing, as in the shader.
const SHADOW_BIAS: f64 = 0.02;
/// Least sine of the sun's height over the surface, as in the shader.
const LOWEST_SUN: f64 = 0.1;

/// Change of texture coordinates along the sun's ray until it has climbed a full depth; `along` is the change along
/// its unit vector, `cosine` its angle to the normal. As in the shader.
#[must_use]
pub fn climb(depth: f64, along: [f64; 2], cosine: f64) -> [f64; 2] {
    along.map(|along| along * depth / cosine.max(LOWEST_SUN))
}

/// First zero of the clearance between two positions within one patch of four texels.
fn within_patch(clearance: &dyn Fn(f64) -> f64, [s0, s1]: [f64; 2]) -> Option<f64> {
    if s1 - s0 < 1e-15 {
        return None;
    }
    // Clearance is a quadratic in t over the patch: c0 (1-t)² + … from three values.
    let (c0, ch, c1) = (clearance(s0), clearance(0.5 * (s0 + s1)), clearance(s1));
    let (qa, qb) = (2.0 * (c0 + c1) - 4.0 * ch, 4.0 * ch - 3.0 * c0 - c1);
    first_root(qa, qb, c0).map(|t| s0 + t * (s1 - s0))
}

/// Smallest root of a t² + b t + c in [0, 1].
fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let roots = if a.abs() < 1e-14 {
        [-c / b, f64::NAN]
    } else {
        let disc = b * b - 4.0 * a * c;
        if disc < 0.0 {
            return None;
        }
        let q = -0.5 * (b + disc.sqrt().copysign(b));
        [q / a, c / q]
    };
    roots.into_iter().filter(|t| (0.0..=1.0).contains(t)).min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::height_maps::bricks;
    use super::*;

    #[test]
    fn exact_intersection_of_a_ramp() {
        // One row rising from 0 to 1 over 4 texels: 1 − h = 1 − x/4 + 1/8…; solved by hand below.
        let map = ReliefMap { width: 8, height: 1, texels: (0..8).map(|i| f64::from(i) / 8.0).collect() };
        // Over texel centres 0..7 height is (8u − 0.5)/8. From u = 0.1, span 0.4:
        // s = 1 − (8(0.1 + 0.4 s) − 0.5)/8  =>  1.4 s = 1 − 0.1 + 0.0625.
        let want = 0.9625 / 1.4;
        assert!((map.intersect([0.1, 0.5], [0.4, 0.0]) - want).abs() < 1e-12);
        assert!((map.trace([0.1, 0.5], [0.4, 0.0], 16) - want).abs() < 1.0 / 16.0 / 256.0);
    }

    #[test]
    fn exact_intersection_lies_on_the_surface_and_is_the_first() {
        let map = bricks(32);
        for i in 0..500 {
            let f = |k: f64| (f64::from(i) * k).fract();
            let (start, span) = ([f(0.618), f(0.414)], [f(0.732) - 0.5, f(0.236) - 0.5]);
            let s = map.intersect(start, span);
            let clearance = |s: f64| 1.0 - map.sample([0, 1].map(|a| start[a] + span[a] * s)) - s;
            assert!(s == 0.0 || clearance(s).abs() < 1e-9, "{}", clearance(s));
            for k in 0..1000 {
                let t = s * f64::from(k) / 1000.0;
                assert!(t == s || clearance(t) > -1e-9);
            }
        }
    }

    #[test]
    fn the_search_finds_the_exact_hit_almost_everywhere() {
        let map = bricks(64);
        let (mut wrong, mut n) = (0, 0);
        for cosine in [0.9, 0.6, 0.3] {
            // Relief with a depth of 0.04 texture widths, seen at this angle.
            let reach = 0.04 * (1.0f64 - cosine * cosine).sqrt() / cosine;
            for i in 0..2000 {
                let f = |k: f64| (f64::from(i) * k).fract();
                let angle = f(0.732) * std::f64::consts::TAU;
                let (start, span) = ([f(0.618), f(0.414)], [reach * angle.cos(), reach * angle.sin()]);
                let exact = map.intersect(start, span);
                let traced = map.trace(start, span, steps(48, cosine));
                // A linear step can jump over a crest (it then hits later), never stop early.
                assert!(traced > exact - 1.0 / f64::from(steps(48, cosine)) / 256.0 - 1e-9);
                wrong += usize::from(traced - exact > 0.01);
                n += 1;
            }
        }
        assert!(wrong * 100 < n, "{wrong} of {n} rays jumped over a crest");
    }
}
