//! Searches for the intersection of a ray with a height field, with their cost in lookups.
//!
//! A ray goes from `start`, on the surface, to `start + span`, at full depth; results are fractions of that way.

use super::cones::Cones;
use super::pyramid::Pyramid;
use super::ray::{Ray, ReliefHit, clearance};
use super::{HALVINGS, ReliefMap};

/// Search method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The surface itself.
    None,
    /// One lookup, the offset not divided by the cosine: Welsh, "Parallax mapping with offset limiting", 2004.
    Parallax,
    /// The first of equal steps that lies below: McGuire and McGuire, "Steep parallax mapping", 2005.
    SteepParallax,
    /// Linear search, then the intersection of the last step's chords: Tatarchuk, "Dynamic parallax occlusion mapping
    /// with approximate soft shadows", 2006; Brawley and Tatarchuk 2004.
    ParallaxOcclusion,
    /// Linear search, then bisection: Policarpo, Oliveira and Comba, "Real-time relief mapping on arbitrary polygonal
    /// surfaces", 2005. Used by `relief_bisection.wgsl`.
    Relief,
    /// Steps to the edge of empty cones: Dummer, "Cone step mapping", 2006.
    ConeStepping,
    /// Steps to the edge of cones that a ray may pierce once, then halvings: Policarpo and Oliveira, "Relaxed cone stepping
    /// for relief mapping", GPU Gems 3, 2007.
    RelaxedConeStepping,
    /// Over cells of a pyramid of largest heights: Drobot, "Quadtree displacement mapping with height blending", GPU Pro,
    /// 2010; Tevs, Ihrke and Seidel, "Maximum mipmaps", 2008.
    Quadtree,
}

/// A height map with precomputed acceleration data.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Heights.
    pub heights: ReliefMap,
    /// For [`Method::ConeStepping`].
    pub cones: Cones,
    /// For [`Method::RelaxedConeStepping`].
    pub relaxed: Cones,
    /// For [`Method::Quadtree`].
    pub pyramid: Pyramid,
}

impl Prepared {
    /// Cost: the fourth power of the longer side, for cones.
    #[must_use]
    pub fn new(heights: ReliefMap) -> Self {
        let (cones, relaxed) = (Cones::safe(&heights), Cones::relaxed(&heights));
        Self { cones, relaxed, pyramid: Pyramid::new(&heights), heights }
    }
}

impl Method {
    /// All variants.
    pub const ALL: [Self; 8] = [
        Self::None,
        Self::Parallax,
        Self::SteepParallax,
        Self::ParallaxOcclusion,
        Self::Relief,
        Self::ConeStepping,
        Self::RelaxedConeStepping,
        Self::Quadtree,
    ];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Parallax => "parallax, offset limited",
            Self::SteepParallax => "steep parallax",
            Self::ParallaxOcclusion => "parallax occlusion",
            Self::Relief => "relief",
            Self::ConeStepping => "cone stepping",
            Self::RelaxedConeStepping => "relaxed cone stepping",
            Self::Quadtree => "quadtree",
        }
    }

    /// Whether the method uses all the steps it is given.
    #[must_use]
    pub fn steps(self) -> bool {
        !matches!(self, Self::None | Self::Parallax)
    }

    /// Searches for the intersection with at most `steps` steps.
    #[must_use]
    pub fn find(self, map: &Prepared, ray: &Ray, steps: u32) -> ReliefHit {
        let steps = steps.max(1);
        match self {
            Self::None => ReliefHit { at: 0.0, lookups: 0 },
            Self::Parallax => {
                let depth = 1.0 - map.heights.sample(ray.start);
                ReliefHit { at: depth * ray.cosine.clamp(0.0, 1.0), lookups: 1 }
            }
            Self::SteepParallax => {
                let found = linear(&map.heights, ray, steps);
                ReliefHit { at: found.below, lookups: found.lookups }
            }
            Self::ParallaxOcclusion => {
                let found = linear(&map.heights, ray, steps);
                ReliefHit { at: found.secant(), lookups: found.lookups }
            }
            Self::Relief => {
                let Linear { above, below, lookups, .. } = linear(&map.heights, ray, steps);
                ReliefHit { at: halve(&map.heights, ray, above, below), lookups: lookups + HALVINGS }
            }
            Self::ConeStepping => map.cones.step(&map.heights, ray, steps).1,
            Self::RelaxedConeStepping => {
                let (above, ReliefHit { at, lookups }) = map.relaxed.step(&map.heights, ray, steps);
                ReliefHit { at: halve(&map.heights, ray, above, at), lookups: lookups + HALVINGS }
            }
            Self::Quadtree => map.pyramid.find(&map.heights, ray, steps),
        }
    }
}

/// The last of equal steps: from above the surface to below.
struct Linear {
    above: f64,
    below: f64,
    /// Clearance at both.
    clearance: [f64; 2],
    lookups: u32,
}

fn linear(map: &ReliefMap, ray: &Ray, steps: u32) -> Linear {
    let step = 1.0 / f64::from(steps);
    // The surface's own height is not looked up: a ray begins at its highest.
    let mut before = 1.0;
    let mut lookups = 1;
    loop {
        let below = f64::from(lookups) * step;
        let now = clearance(map, ray, below);
        if now <= 0.0 || lookups >= steps {
            return Linear { above: below - step, below, clearance: [before, now], lookups };
        }
        before = now;
        lookups += 1;
    }
}

impl Linear {
    /// Intersection of the chords of ray and surface.
    fn secant(&self) -> f64 {
        let [before, now] = self.clearance;
        if now > 0.0 || before <= now {
            return self.below;
        }
        // The start's height is guessed as the highest; a surface below it lets the chord cross a little late.
        self.above + (self.below - self.above) * (before / (before - now)).clamp(0.0, 1.0)
    }
}

/// Halvings between a place above and one below.
fn halve(map: &ReliefMap, ray: &Ray, mut above: f64, mut below: f64) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (above + below);
        if clearance(map, ray, middle) <= 0.0 {
            below = middle;
        } else {
            above = middle;
        }
    }
    0.5 * (above + below)
}

#[cfg(test)]
mod tests {
    use super::super::height_maps;
    use super::*;

    /// Rays spread over a map, at a given cosine, for a depth of a tenth of the map's width.
    fn rays(cosine: f64, count: u32) -> impl Iterator<Item = Ray> {
        let reach = 0.1 * (1.0 - cosine * cosine).sqrt() / cosine;
        (0..count).map(move |i| {
            let f = |k: f64| (f64::from(i) * k).fract();
            let angle = f(0.732) * std::f64::consts::TAU;
            Ray { start: [f(0.618), f(0.414)], span: [reach * angle.cos(), reach * angle.sin()], cosine }
        })
    }

    #[test]
    fn relief_is_what_the_shaders_cpu_reference_does() {
        let map = Prepared::new(height_maps::bricks(32));
        for ray in rays(0.4, 300) {
            let cpu_reference = map.heights.trace(ray.start, ray.span, 17);
            let found = Method::Relief.find(&map, &ray, 17);
            assert!((found.at - cpu_reference).abs() < 1e-12, "{} and {cpu_reference}", found.at);
        }
    }

    #[test]
    fn the_quadtree_finds_the_exact_hit_and_safe_cones_hardly_ever_pass_a_texel() {
        for heights in [height_maps::bricks(64), height_maps::noise(64), height_maps::lettering(64)] {
            let mut passed = 0;
            let map = Prepared::new(heights);
            for ray in [0.95, 0.5, 0.2].into_iter().flat_map(|cosine| rays(cosine, 400)) {
                let exact = map.heights.intersect(ray.start, ray.span);
                let quadtree = Method::Quadtree.find(&map, &ray, 10_000);
                assert!((quadtree.at - exact).abs() < 1e-9, "{} and {exact}: {ray:?}", quadtree.at);
                // Cones are computed at texel centres and interpolated between them, so a ray may pass a texel.
                let cones = Method::ConeStepping.find(&map, &ray, 10_000);
                let texels = (cones.at - exact) * ray.span[0].hypot(ray.span[1]) * 64.0;
                passed += usize::from(texels > 1.0);
            }
            assert!(passed * 50 < 1200, "{passed} of 1200 rays passed a texel");
        }
    }

    #[test]
    fn more_steps_come_nearer_and_what_costs_more_is_worth_it() {
        let map = Prepared::new(height_maps::bricks(64));
        let mean = |method: Method, steps: u32| {
            let off = rays(0.4, 600).map(|ray| {
                (method.find(&map, &ray, steps).at - map.heights.intersect(ray.start, ray.span)).abs()
            });
            off.sum::<f64>() / 600.0
        };
        for method in Method::ALL.into_iter().filter(|method| method.steps()) {
            assert!(mean(method, 32) < mean(method, 4), "{}", method.name());
        }
        let of = |method| mean(method, 32);
        assert!(of(Method::Parallax) < of(Method::None));
        assert!(of(Method::SteepParallax) < of(Method::Parallax));
        assert!(of(Method::ParallaxOcclusion) < of(Method::SteepParallax));
        assert!(of(Method::Relief) < of(Method::ParallaxOcclusion));
    }

    #[test]
    fn rays_along_the_surface_end_and_stay_within_their_way() {
        let map = Prepared::new(height_maps::cobble(32));
        // 89.9° and 89.99°: 57 and 573 times the width; and a ray without length.
        for span in [[57.3, 0.0], [-40.0, 410.0], [0.0, 0.0]] {
            for method in Method::ALL {
                let ray = Ray { start: [0.3, 0.7], span, cosine: 1e-4 };
                let found = method.find(&map, &ray, 64);
                assert!((0.0..=1.0).contains(&found.at), "{}: {}", method.name(), found.at);
                assert!(found.lookups <= 4 * 64 + HALVINGS, "{}: {}", method.name(), found.lookups);
            }
        }
    }
}
