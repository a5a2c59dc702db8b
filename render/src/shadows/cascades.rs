//! Which parts of the world the maps of a frame show: cascades over ranges of depth (Engel, "Cascaded shadow maps", 2006;
//! Zhang et al., "Parallel-split shadow maps", 2006), each around a sphere that holds its slice of the view, so that
//! turning changes nothing, and moved by whole texels, so that edges stay where they are (Valient, "Stable rendering of
//! cascaded shadow maps", 2007).

use glam::{DMat3, DVec3};
use lodestream_protocol::pose::Pose;

/// Steps by which a map moves, to its side. Each is a whole number of texels; in between a map serves as it is.
const STEPS: f64 = 16.0;
/// The nearest map's depth, in distances to what is nearest.
const NEAREST_DEPTHS: f64 = 8.0;
/// Range of depths that maps of a frame may span: beyond it there are no shadows.
const MOST_RATIO: f64 = 128.0;
/// Depths of neighbouring maps differ by at most this factor where there are enough of them.
const RATIO: f64 = 4.0;

/// Distances between which a view shows surfaces, world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Receivers {
    pub(crate) nearest: f64,
    pub(crate) farthest: f64,
}

impl Receivers {
    /// Of nothing.
    pub(crate) const NONE: Self = Self { nearest: f64::INFINITY, farthest: 0.0 };

    /// Takes in what lies between two distances.
    pub(crate) fn add(&mut self, nearest: f64, farthest: f64) {
        self.nearest = self.nearest.min(nearest);
        self.farthest = self.farthest.max(farthest);
    }
}

/// One map's place: a square across the light, in axes of which the last points to the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cascade {
    /// Columns are the axes, world space.
    pub(crate) axes: DMat3,
    /// Its middle in these axes, world units: a multiple of its step.
    pub(crate) centre: DVec3,
    /// World units along a side.
    pub(crate) side: f64,
    /// How far above its middle, along the light, there are surfaces of its own range of depths.
    pub(crate) above: f64,
    /// How far below it serves surfaces: all that any map serves, so that what lies on a map is looked up there.
    pub(crate) below: f64,
}

impl Cascade {
    /// A place relative to the eye, in the map's axes from its middle.
    pub(crate) fn place_of(&self, eye: DVec3, at: DVec3) -> DVec3 {
        self.axes.transpose() * (eye + at) - self.centre
    }

    /// Whether a sphere may cast a shadow on what the map serves: how far its top lies above the map's middle then.
    pub(crate) fn top_of(&self, eye: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
        let at = self.place_of(eye, centre);
        let reach = 0.5 * self.side + radius;
        let top = at.z + radius;
        (at.x.abs() <= reach && at.y.abs() <= reach && top >= -self.below).then_some(top)
    }

    /// Whether all shadows of a sphere are looked up in this map or in a nearer one: those lie below it along the light,
    /// and what lies on a map further from its border than `margin`, a share of its side, is looked up nowhere else.
    pub(crate) fn holds(&self, eye: DVec3, centre: DVec3, radius: f64, margin: f64) -> bool {
        let at = self.place_of(eye, centre);
        at.x.abs().max(at.y.abs()) + radius <= (0.5 - margin) * self.side
    }

    /// Whether anything in a box in the world may cast a shadow on what the map serves.
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

/// The cascades of a view into a picture of `size` pixels, nearest first, none where nothing receives light. What they
/// depend on besides the eye's place is the camera's opening, its direction by whole steps, and powers of √2 of the
/// distances: they stay as they are while the camera moves slowly.
pub(crate) fn cascades(
    camera: &Pose,
    size: (u32, u32),
    to_sun: DVec3,
    receivers: Receivers,
    most: usize,
) -> Vec<Cascade> {
    let Receivers { nearest, farthest } = receivers;
    let sun = to_sun.try_normalize().unwrap_or(DVec3::Y);
    if !(farthest > 0.0 && farthest.is_finite() && camera.eye.is_finite()) {
        return Vec::new();
    }
    let last = up_to_a_step(farthest);
    let first = up_to_a_step(NEAREST_DEPTHS * nearest).clamp(last / MOST_RATIO, last);
    // In equal ratios.
    let splits = ((last / first).log(RATIO).ceil() as usize).min(most.saturating_sub(1));
    let ratio = if splits == 0 { 1.0 } else { (last / first).powf(1.0 / splits as f64) };
    let (x, y) = sun.any_orthonormal_pair();
    let axes = DMat3::from_cols(x, y, sun);
    let (tx, ty) = camera.tan_half_fov(size.0, size.1);
    let forward = camera.rotation * DVec3::NEG_Z;
    let mut begin = 0.0;
    let mut all: Vec<_> = (0..=splits)
        .map(|i| {
            // The one map there is shows all where no more may be drawn.
            let end = if i == splits { last } else { first * ratio.powi(i as i32) };
            let (along, radius) = sphere(begin, end, tx * tx + ty * ty);
            begin = end;
            let step = 2.0 * radius / (STEPS - 1.0);
            let at = axes.transpose() * (camera.eye + forward * along);
            let centre = (at / step).round() * step;
            Cascade { axes, centre, side: STEPS * step, above: radius + step, below: radius + step }
        })
        .collect();
    // Middles of maps lie no further apart than the view is deep, which is at most twice the last radius.
    let below = all.last().map_or(0.0, |last| 3.0 * last.above);
    for cascade in &mut all {
        cascade.below = below;
    }
    all
}

/// The next power of √2 that is not less.
fn up_to_a_step(distance: f64) -> f64 {
    2.0_f64.powf((2.0 * distance.max(f64::MIN_POSITIVE).log2() - 1e-9).ceil() / 2.0)
}

/// The least sphere around the part of a view between two depths: how far along the view its middle lies, and its radius.
/// `tangents` is the sum of the squares of the tangents of half the view's angles.
fn sphere(begin: f64, end: f64, tangents: f64) -> (f64, f64) {
    let along = (0.5 * (begin + end) * (1.0 + tangents)).min(end);
    let far = (end - along).hypot(end * tangents.sqrt());
    let near = (along - begin).hypot(begin * tangents.sqrt());
    (along, far.max(near))
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    const SIZE: (u32, u32) = (1280, 720);
    const SUN: DVec3 = DVec3::new(0.3, 0.8, -0.4);
    const FAR: Receivers = Receivers { nearest: 1.7, farthest: 900.0 };

    fn camera(eye: DVec3) -> Pose {
        Pose::look_at(eye, eye + DVec3::new(1.0, -0.2, 0.3), DVec3::Y, 0.9)
    }

    #[test]
    fn all_of_the_view_lies_in_a_map_that_serves_its_depth() {
        for (eye, receivers) in [
            (DVec3::ZERO, FAR),
            (DVec3::new(6.4e6, 3.0, -2e6), FAR),
            (DVec3::X, Receivers { nearest: 2e-4, farthest: 9e-3 }),
            (DVec3::X, Receivers { nearest: 3.0, farthest: 4.0 }),
        ] {
            let camera = camera(eye);
            let maps = cascades(&camera, SIZE, SUN, receivers, 4);
            let (tx, ty) = camera.tan_half_fov(SIZE.0, SIZE.1);
            let mut begin = 0.0;
            let last = receivers.farthest;
            let depths = (1..=64).map(|i| last * f64::from(i) / 64.0);
            let mut served = 0;
            for map in &maps {
                // What this map's slice holds: until where a corner of the view leaves it.
                let inside = |depth: f64| {
                    [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)].into_iter().all(|(x, y)| {
                        let corner = camera.rotation * (DVec3::new(x * tx, y * ty, -1.0) * depth);
                        let at = map.place_of(eye, corner);
                        let half = 0.5 * map.side * (1.0 + 1e-9);
                        at.x.abs() <= half && at.y.abs() <= half && at.z <= map.above && at.z >= -map.below
                    })
                };
                let run: Vec<f64> = depths.clone().filter(|&d| d > begin && inside(d)).collect();
                if let Some(&reached) = run.last() {
                    served += run.len();
                    begin = reached;
                }
            }
            assert_eq!(served, 64, "{receivers:?}: {maps:?}");
        }
    }

    #[test]
    fn turning_and_small_moves_keep_a_map_on_its_grid() {
        let eye = DVec3::new(100.0, 2.0, -40.0);
        let first = cascades(&camera(eye), SIZE, SUN, FAR, 4);
        assert_eq!(first.len(), 4);
        for turn in 0..40 {
            let mut pose = camera(eye + DVec3::new(0.01, 0.002, -0.003) * f64::from(turn));
            pose.rotation = DQuat::from_rotation_y(f64::from(turn) * 0.05) * pose.rotation;
            for (a, b) in first.iter().zip(cascades(&pose, SIZE, SUN, FAR, 4)) {
                // Turning goes through a square root: equal but for its last bits.
                assert!((a.side - b.side).abs() <= 1e-12 * a.side, "a texel keeps its size");
                // A step is as many texels for each power of two of them.
                let steps = (b.centre - a.centre) / (a.side / STEPS);
                assert!((steps - steps.round()).abs().max_element() < 1e-6, "{steps}");
            }
        }
    }

    #[test]
    fn a_camera_that_barely_moves_needs_no_new_map() {
        let eye = DVec3::new(100.0, 2.0, -40.0);
        let first = cascades(&camera(eye), SIZE, SUN, FAR, 4);
        let moved = cascades(&camera(eye + DVec3::splat(1e-3)), SIZE, SUN, FAR, 4);
        let same = first.iter().zip(&moved).filter(|(a, b)| a == b).count();
        assert!(same >= 3, "{first:?} {moved:?}");
    }

    #[test]
    fn as_few_maps_as_are_worth_it() {
        let of = |receivers, most| cascades(&camera(DVec3::ZERO), SIZE, SUN, receivers, most).len();
        assert_eq!(of(Receivers::NONE, 4), 0);
        assert_eq!(of(Receivers { nearest: 3.0, farthest: 4.0 }, 4), 1, "a statue from afar");
        assert_eq!(of(Receivers { nearest: 1.0, farthest: 30.0 }, 4), 2);
        assert_eq!(of(FAR, 4), 4);
        assert_eq!(of(FAR, 1), 1);
        assert_eq!(of(Receivers { nearest: 0.0, farthest: 1e9 }, 4), 4);
        assert_eq!(of(Receivers { nearest: 0.0, farthest: f64::INFINITY }, 4), 0);
    }

    #[test]
    fn what_casts_a_shadow_into_a_map_is_found() {
        let maps =
            cascades(&camera(DVec3::ZERO), SIZE, DVec3::Y, Receivers { nearest: 1.0, farthest: 2.0 }, 1);
        let map = maps[0];
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
