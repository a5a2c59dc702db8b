//! Error of relief mapping methods against the exact intersection of a ray with the height map's surface, by angle.
//!
//! Everything is computed in f64 by the shaders' CPU references, so figures are reproducible to the digit. Cost is
//! counted in lookups, which dominate a fragment's time.

use std::f64::consts::TAU;
use std::fmt;

use lodestream_render::cpu_reference::relief::ReliefMap;
use lodestream_render::cpu_reference::relief::height_maps;
use lodestream_render::cpu_reference::relief::methods::{Method, Prepared};
use lodestream_render::cpu_reference::relief::ray::Ray;
use serde::Serialize;

/// Texels along a side of the published table's maps.
pub const SIDE: usize = 128;
/// Depth of the relief in texture widths.
const DEPTH: f64 = 0.05;
/// Angles between ray and normal, degrees.
pub const ANGLES: [f64; 6] = [0.0, 45.0, 75.0, 85.0, 89.9, 89.99];
/// Step limit in the main table: the shader's linear steps at grazing angles.
const STEPS: u32 = 48;
/// Step limits and angle of the table of error by cost.
const CURVE: ([u32; 5], f64) = ([8, 16, 32, 64, 128], 75.0);
/// A hit further off than this along the surface counts as wrong.
const WRONG_TEXELS: f64 = 1.0;

/// Error of a method at an angle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtAngle {
    /// Angle between ray and normal, in degrees.
    pub degrees: f64,
    /// Share of rays whose hit is more than a texel off along the surface.
    pub wrong: f64,
    /// Root of the mean squared distance along the surface, texels.
    pub rms_texels: f64,
    /// Mean lookups per ray.
    pub lookups: f64,
}

/// A method on a height map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OfMap {
    /// Name of the map.
    pub map: &'static str,
    /// Name of the method.
    pub method: &'static str,
    /// By [`ANGLES`].
    pub angles: Vec<AtAngle>,
}

/// A method with a step limit, over all maps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WithSteps {
    /// Name of the method.
    pub method: &'static str,
    /// Step limit.
    pub steps: u32,
    /// At 75°.
    #[serde(flatten)]
    pub at: AtAngle,
}

/// All methods on all maps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// By map and method, with the shader's step limit.
    pub maps: Vec<OfMap>,
    /// Error by cost at 75°.
    pub steps: Vec<WithSteps>,
}

/// Compares on maps of `side` × `side` texels, with `rays` rays per map and angle.
///
/// Deriving the relaxed cones of a map takes O(`side`⁴).
#[must_use]
pub fn compare(side: usize, rays: u32) -> Comparison {
    let maps: [(&str, ReliefMap); 4] = [
        ("brick", height_maps::bricks(side)),
        ("cobble", height_maps::cobble(side)),
        ("noise", height_maps::noise(side)),
        ("lettering", height_maps::lettering(side)),
    ];
    let maps = maps.map(|(name, heights)| (name, Prepared::new(heights)));
    let mut result = Comparison { maps: Vec::new(), steps: Vec::new() };
    for (name, map) in &maps {
        // The exact intersections do not depend on the method.
        let truth = ANGLES.map(|degrees| Truth::new(&map.heights, degrees, rays));
        for method in Method::ALL {
            let angles = truth.iter().map(|truth| truth.judge(map, method, STEPS)).collect();
            result.maps.push(OfMap { map: name, method: method.name(), angles });
        }
    }
    let (counts, degrees) = CURVE;
    let truth: Vec<Truth> = maps.iter().map(|(_, map)| Truth::new(&map.heights, degrees, rays)).collect();
    for method in Method::ALL {
        for &steps in counts.iter().take(if method.steps() { counts.len() } else { 1 }) {
            let of: Vec<AtAngle> =
                maps.iter().zip(&truth).map(|((_, map), truth)| truth.judge(map, method, steps)).collect();
            let mean = |figure: fn(&AtAngle) -> f64| of.iter().map(figure).sum::<f64>() / of.len() as f64;
            let at = AtAngle {
                degrees,
                wrong: mean(|a| a.wrong),
                rms_texels: mean(|a| a.rms_texels * a.rms_texels).sqrt(),
                lookups: mean(|a| a.lookups),
            };
            result.steps.push(WithSteps { method: method.name(), steps, at });
        }
    }
    result
}

/// Rays at an angle, with their exact intersections.
struct Truth {
    degrees: f64,
    rays: Vec<(Ray, f64)>,
}

impl Truth {
    fn new(map: &ReliefMap, degrees: f64, count: u32) -> Self {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let reach = DEPTH * sine / cosine;
        let rays = (0..count).map(|i| {
            // Golden-ratio sequences in one and two dimensions: even and deterministic (Roberts 2018).
            let even = |step: f64| (0.5 + f64::from(i) * step).fract();
            let (along, across) = (even(0.618_033_988_749_894_9) * TAU).sin_cos();
            let start = [even(0.754_877_666_246_692_8), even(0.569_840_290_998_053_2)];
            let ray = Ray { start, span: [reach * along, reach * across], cosine };
            (ray, map.intersect(ray.start, ray.span))
        });
        Self { degrees, rays: rays.collect() }
    }

    fn judge(&self, map: &Prepared, method: Method, steps: u32) -> AtAngle {
        let (mut wrong, mut squares, mut lookups) = (0_u32, 0.0, 0_u64);
        for (ray, exact) in &self.rays {
            let found = method.find(map, ray, steps);
            let texels = (found.at - exact).abs() * ray.span[0].hypot(ray.span[1]) * map.heights.width as f64;
            wrong += u32::from(texels > WRONG_TEXELS);
            squares += texels * texels;
            lookups += u64::from(found.lookups);
        }
        let count = self.rays.len().max(1) as f64;
        AtAngle {
            degrees: self.degrees,
            wrong: f64::from(wrong) / count,
            rms_texels: (squares / count).sqrt(),
            lookups: lookups as f64 / count,
        }
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:10} {:25}", "map", "wrong %, RMS texels at")?;
        ANGLES.iter().try_for_each(|degrees| write!(f, "{:>15}", format!("{degrees}°")))?;
        for OfMap { map, method, angles } in &self.maps {
            write!(f, "\n{map:10} {method:25}")?;
            for AtAngle { wrong, rms_texels, .. } in angles {
                write!(f, "{:>15}", format!("{:.1}, {rms_texels:.3}", wrong * 100.0))?;
            }
        }
        write!(f, "\n\nat {}°, all maps: steps, lookups, wrong %, RMS texels", CURVE.1)?;
        for WithSteps { method, steps, at } in &self.steps {
            let AtAngle { wrong, rms_texels, lookups, .. } = at;
            write!(f, "\n{method:25} {steps:>4} {lookups:>7.1} {:>6.1} {rms_texels:>8.3}", wrong * 100.0)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exact_method_has_no_error_and_none_has_the_largest() {
        let all = compare(64, 100);
        assert_eq!(all.maps.len(), 4 * Method::ALL.len());
        for of in &all.maps {
            for at in &of.angles {
                let at_rest = at.degrees == 0.0;
                match of.method {
                    "none" => assert!(at_rest || at.rms_texels > 0.5, "{of:?}"),
                    // At 89.9° and beyond, 48 cells do not cover the whole ray.
                    "quadtree" if at.degrees < 80.0 => assert!(at.rms_texels < 1e-6, "{of:?}"),
                    _ => assert!(at.rms_texels.is_finite(), "{of:?}"),
                }
            }
        }
        let of = |method: Method| all.steps.iter().filter(move |row| row.method == method.name());
        let last = |method| of(method).next_back().map_or(f64::NAN, |row| row.at.rms_texels);
        assert!(last(Method::Relief) < last(Method::SteepParallax));
        assert_eq!(compare(64, 100), all, "figures repeat");
    }
}
