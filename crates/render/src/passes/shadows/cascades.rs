//! Cascaded shadow maps (Engel 2006; parallel split, Zhang et al. 2006). Each cascade is a sphere around the eye, so
//! that turning changes nothing, and moves by whole texels, so that edges are stable (Valient, "Stable rendering of
//! cascaded shadow maps", 2007).

use glam::{DMat3, DVec3};

use crate::frame::receivers::Receivers;
use crate::frame::settings::Shadows;

/// Reach of the nearest cascade, as a multiple of the nearest distance.
const NEAREST_DISTANCES: f64 = 8.0;
/// Most ratio of the last cascade's reach to the first's; nearer surfaces use the first cascade's resolution.
const MOST_RATIO: f64 = 128.0;
/// Largest ratio of consecutive reaches, if there are enough cascades.
const RATIO: f64 = 4.0;

/// A cascade: a square perpendicular to the light, in axes of which the last points to the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cascade {
    /// Columns are the axes, world space.
    pub(crate) axes: DMat3,
    /// Centre in these axes, world units: a multiple of its step.
    pub(crate) centre: DVec3,
    /// World units along a side.
    pub(crate) side: f64,
    /// Extent of its surfaces above the centre, along the light.
    pub(crate) above: f64,
    /// Extent of its surfaces below the centre: as for all cascades, so that whatever lies on a map is looked up
    /// there.
    pub(crate) below: f64,
}

impl Cascade {
    /// Transforms a position relative to the eye into the map's axes.
    pub(crate) fn place_of(&self, eye: DVec3, at: DVec3) -> DVec3 {
        self.axes.transpose() * (eye + at) - self.centre
    }

    /// Height of a sphere's top above the map's centre, if it may cast a shadow on surfaces of the map.
    pub(crate) fn top_of(&self, eye: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
        let at = self.place_of(eye, centre);
        let reach = 0.5 * self.side + radius;
        let top = at.z + radius;
        (at.x.abs() <= reach && at.y.abs() <= reach && top >= -self.below).then_some(top)
    }

    /// Whether all shadows of a sphere are looked up in this cascade or nearer ones: they lie below it along the
    /// light, and surfaces farther from the border than `margin`, a share of the side, use no other cascade.
    pub(crate) fn holds(&self, eye: DVec3, centre: DVec3, radius: f64, margin: f64) -> bool {
        let at = self.place_of(eye, centre);
        at.x.abs().max(at.y.abs()) + radius <= (0.5 - margin) * self.side
    }

    #[cfg(any(test, feature = "client"))]
    /// Whether anything in a box in the world may cast a shadow on surfaces of the map.
    pub(crate) fn is_reached(&self, [low, high]: [DVec3; 2]) -> bool {
        let turned = self.axes.transpose();
        let middle = turned * (0.5 * (low + high)) - self.centre;
        let half = 0.5 * (high - low);
        let reach =
            turned.x_axis.abs() * half.x + turned.y_axis.abs() * half.y + turned.z_axis.abs() * half.z;
        let within = reach + 0.5 * self.side;
        middle.x.abs() <= within.x && middle.y.abs() <= within.y && middle.z + reach.z >= -self.below
    }
}

/// The cascades of a view, nearest first; none if nothing receives light. They depend on the eye's position in whole
/// steps and on distances in powers of √2, so they do not change while the camera turns or moves slowly.
pub(crate) fn cascades(eye: DVec3, to_sun: DVec3, receivers: Receivers, shadows: Shadows) -> Vec<Cascade> {
    // Each step is a whole number of texels; within a step the map stays valid.
    let (most, steps) = (shadows.cascades as usize, shadows.grid());
    let Receivers { nearest, farthest, low, high } = receivers;
    let sun = to_sun.try_normalize().unwrap_or(DVec3::Y);
    if !(farthest > 0.0 && farthest.is_finite() && eye.is_finite()) {
        return Vec::new();
    }
    let (x, y) = sun.any_orthonormal_pair();
    let axes = DMat3::from_cols(x, y, sun);
    let around = |middle: DVec3, radius: f64| {
        let step = 2.0 * radius / (steps - 1.0);
        let centre = (axes.transpose() * middle / step).round() * step;
        Cascade { axes, centre, side: steps * step, above: radius + step, below: radius + step }
    };
    let last = up_to_a_step(farthest);
    let size = up_to_a_step(0.5 * low.distance(high));
    if size < last {
        // Few distant objects: one map around them is finer than cascades around the eye.
        return vec![around(eye + 0.5 * (low + high), size)];
    }
    let first = up_to_a_step(NEAREST_DISTANCES * nearest).clamp(last / MOST_RATIO, last);
    // Splits of equal ratios.
    let splits = ((last / first).log(RATIO).ceil() as usize).min(most.saturating_sub(1));
    let ratio = if splits == 0 { 1.0 } else { (last / first).powf(1.0 / splits as f64) };
    // If there is one cascade, it covers everything.
    let reach = |i: usize| if i == splits { last } else { first * ratio.powi(i as i32) };
    let mut all: Vec<_> = (0..=splits).map(|i| around(eye, reach(i))).collect();
    // All are centred on the eye, up to half a step.
    let below = all.last().map_or(0.0, |last| 2.0 * last.above);
    for cascade in &mut all {
        cascade.below = below;
    }
    all
}

/// Rounds up to a power of √2.
fn up_to_a_step(distance: f64) -> f64 {
    2.0_f64.powf((2.0 * distance.max(f64::MIN_POSITIVE).log2() - 1e-9).ceil() / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At most this many maps.
    fn maps(cascades: u32) -> Shadows {
        Shadows { cascades, ..Shadows::default() }
    }

    const SUN: DVec3 = DVec3::new(0.3, 0.8, -0.4);

    /// Ground between two distances around the eye.
    fn around(nearest: f64, farthest: f64) -> Receivers {
        let mut all = Receivers::NONE;
        all.add_around(nearest, farthest);
        all
    }

    #[test]
    fn all_visible_surfaces_lie_in_a_cascade() {
        let mut few = Receivers::NONE;
        few.add(DVec3::new(30.0, 2.0, -7.0), 1.5);
        few.add(DVec3::new(31.0, 0.0, -5.0), 0.5);
        for eye in [DVec3::ZERO, DVec3::new(6.4e6, 3.0, -2e6)] {
            for receivers in [around(1.7, 900.0), around(2e-4, 9e-3), few] {
                let Receivers { low, high, .. } = receivers;
                for i in 0..1000 {
                    let shadows = Shadows { steps: [4, 8, 16][i as usize % 3], ..Shadows::default() };
                    let maps = cascades(eye, SUN, receivers, shadows);
                    let share =
                        DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)) / 9.0;
                    let at = low + (high - low) * share;
                    // The box's corners lie outside the sphere that it surrounds.
                    if at.length() > receivers.farthest {
                        continue;
                    }
                    let inside = |map: &Cascade| {
                        let at = map.place_of(eye, at);
                        let half = 0.5 * map.side * (1.0 + 1e-9);
                        at.x.abs() <= half && at.y.abs() <= half && at.z <= map.above && at.z >= -map.below
                    };
                    assert!(maps.iter().any(inside), "{at} {maps:?}");
                }
            }
        }
    }

    #[test]
    fn small_moves_keep_a_map_on_its_grid() {
        let eye = DVec3::new(100.0, 2.0, -40.0);
        let first = cascades(eye, SUN, around(1.7, 900.0), maps(4));
        assert_eq!(first.len(), 4);
        for i in 0..40 {
            let moved = eye + DVec3::new(0.01, 0.002, -0.003) * f64::from(i * i);
            for (a, b) in first.iter().zip(cascades(moved, SUN, around(1.8, 910.0), maps(4))) {
                assert_eq!((a.side, a.above, a.below), (b.side, b.above, b.below), "a texel keeps its size");
                // A step is a number of texels that doubles with the power of two of the map's side.
                let steps = (b.centre - a.centre) / (a.side / 16.0);
                assert!((steps - steps.round()).abs().max_element() < 1e-6, "{steps}");
            }
        }
        let near = cascades(eye + DVec3::splat(1e-3), SUN, around(1.7, 900.0), maps(4));
        assert!(first.iter().zip(&near).filter(|(a, b)| a == b).count() >= 3, "{first:?} {near:?}");
    }

    /// A near map is redrawn for one frame in five, not for every second or third, of a flying camera.
    #[test]
    fn few_steps_redraw_maps_five_times_less_often() {
        let redrawn = |steps: u32| {
            let at = |i: u32| DVec3::new(100.0 + 0.1 * f64::from(i), 2.0, -40.0);
            let shadows = Shadows { steps, ..Shadows::default() };
            let near: Vec<_> =
                (0..2000).map(|i| cascades(at(i), SUN, around(1.7, 900.0), shadows)[0]).collect();
            (near.windows(2).filter(|pair| pair[0] != pair[1]).count(), near[0].side)
        };
        let [(often, side), (seldom, larger)] = [16, 4].map(redrawn);
        assert!(2 * often > 9 * seldom && seldom > 0, "{often} {seldom}");
        assert!(larger < 1.26 * side, "{side} {larger}");
        assert_eq!(Shadows { steps: 0, ..Shadows::default() }.grid(), 4.0);
        assert_eq!(Shadows { steps: 15, ..Shadows::default() }.grid(), 8.0);
        assert_eq!(Shadows { steps: u32::MAX, ..Shadows::default() }.grid(), 16.0);
    }

    #[test]
    fn fewer_cascades_are_drawn_where_they_suffice() {
        let of = |receivers, most| cascades(DVec3::ZERO, SUN, receivers, maps(most));
        assert_eq!(of(Receivers::NONE, 4).len(), 0);
        let mut statue = Receivers::NONE;
        statue.add(DVec3::Z * 1000.0, 1.0);
        let alone = of(statue, 4);
        assert_eq!(alone.len(), 1, "a statue far away");
        assert!(alone[0].side < 6.0, "{alone:?}");
        assert_eq!(of(around(1.0, 30.0), 4).len(), 2);
        assert_eq!(of(around(1.7, 900.0), 4).len(), 4);
        assert_eq!(of(around(1.7, 900.0), 1).len(), 1);
        assert_eq!(of(around(0.0, 1e9), 4).len(), 4);
        assert_eq!(of(around(0.0, f64::INFINITY), 4).len(), 0);
    }

    #[test]
    fn casters_of_a_map_are_found() {
        let map = cascades(DVec3::ZERO, DVec3::Y, around(1.0, 2.0), maps(1))[0];
        let middle = map.axes * map.centre;
        let top = |offset: DVec3, radius| map.top_of(DVec3::ZERO, middle + offset, radius);
        assert_eq!(top(DVec3::Y * 50.0, 1.0).map(f64::round), Some(51.0), "high above");
        assert!(top(DVec3::Y * -map.above, 1.0).is_some(), "within what any map serves");
        assert_eq!(top(DVec3::Y * -50.0, 1.0), None, "below all that the map serves");
        assert_eq!(top(DVec3::X * map.side, 1.0), None, "beside it");
        assert!(top(DVec3::X * map.side, map.side).is_some(), "beside it, but large");
        let held = |offset: DVec3, radius| map.holds(DVec3::ZERO, middle + offset, radius, 0.1);
        assert!(held(DVec3::Y * 50.0, 0.39 * map.side) && !held(DVec3::ZERO, 0.41 * map.side));
        assert!(!held(DVec3::X * 0.3 * map.side, 0.11 * map.side));
        let reached = |offset: DVec3, half: f64| {
            map.is_reached([-1.0, 1.0].map(|sign| middle + offset + DVec3::splat(sign * half)))
        };
        assert!(reached(DVec3::Y * 50.0, 1.0) && reached(DVec3::X * map.side, map.side));
        assert!(!reached(DVec3::Y * -50.0, 1.0) && !reached(DVec3::X * map.side, 1.0));
    }
}
