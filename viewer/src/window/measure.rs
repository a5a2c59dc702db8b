//! Measuring: coordinates of a point, the distance of two, the angle at the second of three, each with a bound of its
//! error.

use std::collections::VecDeque;

use glam::DVec3;
use lodestream_client::core::Ray;
use lodestream_client::streaming::{Answer, Streaming};
use lodestream_scene::parts::ScenePart;
use lodestream_scene::placement::Placement;

use super::visible::Visible;

/// Most points at once.
const POINTS: usize = 3;
/// Error in pixels at which a point is not looked up again.
const SHARP_PX: f64 = 1.0;
/// Coordinates that differ by less, as a share of their size, are the same.
const SAME: f64 = 1e-9;
/// Share of its bound to which a point's error must have fallen to be looked up again.
const SHARPER: f64 = 0.8;

/// Where a ray met a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Found {
    place: DVec3,
    distance: f64,
    /// The part, if it is drawn itself.
    part: Option<ScenePart>,
    /// The place in the units and axes of the asset.
    in_asset: Option<DVec3>,
    /// Bound of the error by which positions are rounded, world units.
    rounding: f64,
}

/// A point that was clicked.
#[derive(Clone, Copy, Debug)]
struct Point {
    ray: Ray,
    found: Found,
    /// Bound of its distance from the surface of the input, world units; infinite before all in view can be drawn.
    bound: f64,
}

#[derive(Debug)]
struct Asked {
    ray: Ray,
    /// The point that is looked up again; `None` for a new one.
    again: Option<usize>,
    answer: Answer<Option<Found>>,
}

/// How large errors are: of the picture in pixels, and of a pixel at a distance in world units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Accuracy {
    /// Bound of the screen error over all visible parts, in pixels.
    pub(super) error_px: f64,
    /// World units per pixel at distance 1.
    pub(super) per_px: f64,
}

impl Accuracy {
    /// World units of a pixel where a surface was found.
    fn pixel(&self, found: &Found) -> f64 {
        self.per_px * found.distance
    }

    /// Bound of the distance between what is drawn and the input, where a surface was found.
    fn bound(&self, found: &Found) -> f64 {
        self.error_px * self.pixel(found) + found.rounding
    }
}

/// Points that are measured.
#[derive(Debug, Default)]
pub(super) struct Measure {
    active: bool,
    points: Vec<Point>,
    /// In the order of the clicks.
    asked: VecDeque<Asked>,
}

impl Measure {
    /// Starts or ends measuring.
    pub(super) fn toggle(&mut self) {
        *self = Self { active: !self.active, ..Self::default() };
    }

    /// Whether clicks are points.
    pub(super) const fn is_active(&self) -> bool {
        self.active
    }

    /// Whether an answer is awaited.
    pub(super) fn awaits_answer(&self) -> bool {
        !self.asked.is_empty()
    }

    /// Adds the point that a ray meets; after three, a new first one.
    pub(super) fn click(&mut self, ray: Ray, streaming: &Streaming, visible: Visible) {
        self.ask(ray, None, streaming, visible);
    }

    fn ask(&mut self, ray: Ray, again: Option<usize>, streaming: &Streaming, visible: Visible) {
        let answer = streaming.ask(move |core| {
            let hit = visible.pick(core, ray)?;
            let in_asset = core.in_asset(hit.instance, hit.place);
            let rounding = core.rounding(hit.instance).unwrap_or(f64::INFINITY);
            let (place, distance, part) = (hit.place, hit.distance, hit.scene_part());
            Some(Found { place, distance, part, in_asset, rounding })
        });
        self.asked.extend(answer.ok().map(|answer| Asked { ray, again, answer }));
    }

    /// Takes an answer, and looks points up again that were found in a coarser picture than the present one; returns
    /// whether the points have changed.
    pub(super) fn receive(
        &mut self,
        accuracy: &Accuracy,
        streaming: &Streaming,
        visible: impl FnOnce() -> Visible,
    ) -> bool {
        let mut changed = false;
        while let Some(asked) = self.asked.front_mut() {
            let (ray, again, taken) = (asked.ray, asked.again, asked.answer.take());
            if matches!(taken, Ok(None)) {
                return changed;
            }
            self.asked.pop_front();
            changed |= self.answered(ray, again, taken.ok().flatten().flatten(), accuracy);
        }
        let coarser = |point: &Point| {
            let now = accuracy.bound(&point.found);
            now < SHARPER * point.bound && point.bound > SHARP_PX * accuracy.pixel(&point.found)
        };
        if let Some(number) = self.points.iter().position(coarser)
            && let Some(point) = self.points.get(number)
        {
            self.ask(point.ray, Some(number), streaming, visible());
        }
        changed
    }

    /// Takes what a ray met; returns whether the points have changed.
    fn answered(
        &mut self,
        ray: Ray,
        again: Option<usize>,
        found: Option<Found>,
        accuracy: &Accuracy,
    ) -> bool {
        let Some(found) = found else { return false };
        let point = Point { ray, found, bound: accuracy.bound(&found) };
        match again.map(|number| self.points.get_mut(number)) {
            Some(Some(old)) => *old = point,
            // Points that are looked up again have gone.
            Some(None) => return false,
            None => {
                if self.points.len() == POINTS {
                    self.points.clear();
                }
                self.points.push(point);
            }
        }
        true
    }

    /// The part of a point that is alone, whose coordinates are shown.
    pub(super) fn part(&self) -> Option<ScenePart> {
        let [point] = &self.points[..] else { return None };
        point.found.part
    }

    /// What was measured, for the line below the picture; `None` while nothing is. `in_file` takes places of a part's
    /// asset to those of its file, if that is known.
    pub(super) fn describe(&self, in_file: impl Fn(ScenePart) -> Option<Placement>) -> Option<String> {
        if !self.active {
            return None;
        }
        let places: Vec<DVec3> = self.points.iter().map(|point| point.found.place).collect();
        let bound: f64 = self.points.iter().map(|point| point.bound).sum();
        Some(match places[..] {
            [a, b, c] => {
                let angle = (a - b).angle_between(c - b).to_degrees();
                format!("angle {angle:.2}°, {} and {}", length(a, b, bound), length(b, c, bound))
            }
            [a, b] => format!("distance {}", length(a, b, bound)),
            [a] => {
                let own = self
                    .points
                    .first()
                    .and_then(|Point { found, .. }| Some(in_file(found.part?)?.to_world(found.in_asset?)));
                // Placements are rounded to f32.
                let own = own.filter(|own| own.distance(a) > SAME * a.length());
                let own = own.map(|own| format!(", in its file {}", coordinates(own, bound)));
                format!("at {}{} ± {}", coordinates(a, bound), own.unwrap_or_default(), short(bound))
            }
            _ => "measure: click a point".into(),
        })
    }

    /// Places of the points, for drawing.
    pub(super) fn places(&self) -> Vec<DVec3> {
        self.points.iter().map(|point| point.found.place).collect()
    }
}

fn length(a: DVec3, b: DVec3, bound: f64) -> String {
    format!("{:.*} ± {}", decimals(bound), (a - b).length(), short(bound))
}

fn coordinates(place: DVec3, bound: f64) -> String {
    let decimals = decimals(bound);
    format!("{:.decimals$} {:.decimals$} {:.decimals$}", place.x, place.y, place.z)
}

/// Decimals that tell a tenth of the bound apart.
fn decimals(bound: f64) -> usize {
    // Between the bounds of the range.
    if bound.is_finite() && bound > 0.0 { (1.0 - bound.log10()).ceil().clamp(0.0, 12.0) as usize } else { 3 }
}

/// A bound with one digit, rounded up.
fn short(bound: f64) -> String {
    if !(bound.is_finite() && bound > 0.0) {
        return "?".into();
    }
    let unit = 10_f64.powf(bound.log10().floor());
    format!("{:.*}", decimals(bound).saturating_sub(1), (bound / unit * (1.0 - 1e-9)).ceil() * unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(places: &[[f64; 3]], bound: f64) -> String {
        let ray = Ray { origin: DVec3::ZERO, direction: DVec3::Z };
        let point = |place: &[f64; 3]| {
            let place = DVec3::from(*place);
            let found = Found { place, distance: 1.0, part: None, in_asset: None, rounding: 0.0 };
            Point { ray, found, bound }
        };
        let points = places.iter().map(point).collect();
        Measure { active: true, points, asked: VecDeque::new() }.describe(|_| None).unwrap()
    }

    #[test]
    fn points_distances_and_angles_have_a_bound_and_no_more_digits_than_it_allows() {
        assert_eq!(measured(&[], 0.1), "measure: click a point");
        assert_eq!(measured(&[[408_201.123_456, 0.0, -2.5]], 0.001), "at 408201.1235 0.0000 -2.5000 ± 0.001");
        assert_eq!(measured(&[[0.0; 3], [3.0, 4.0, 0.0]], 0.002), "distance 5.0000 ± 0.004");
        assert_eq!(
            measured(&[[1.0, 0.0, 0.0], [0.0; 3], [0.0, 2.0, 0.0]], 0.01),
            "angle 90.00°, 1.000 ± 0.03 and 2.000 ± 0.03"
        );
        assert_eq!(measured(&[[1.0, 2.0, 3.0]], f64::INFINITY), "at 1.000 2.000 3.000 ± ?");
        assert_eq!(Measure::default().describe(|_| None), None);
    }

    #[test]
    fn a_point_alone_has_coordinates_of_its_file_where_they_are_others() {
        let part = ScenePart { instance: 3, part: 0 };
        let measure = |place: DVec3, in_asset: DVec3| {
            let found =
                Found { place, distance: 1.0, part: Some(part), in_asset: Some(in_asset), rounding: 0.0 };
            let ray = Ray { origin: DVec3::ZERO, direction: DVec3::Z };
            let points = vec![Point { ray, found, bound: 0.01 }];
            Measure { active: true, points, asked: VecDeque::new() }
        };
        // A node of the file is 5 up and turned about y; the scene has the file elsewhere.
        let node = Placement { rotation: [0.0, 1.0, 0.0, 0.0], ..Placement::at([100.0, 5.0, 0.0]) };
        let measured = measure(DVec3::new(-7.0, 6.0, 0.0), DVec3::new(2.0, 1.0, 0.0));
        assert_eq!(measured.part(), Some(part));
        let known = |of: ScenePart| (of == part).then_some(node);
        let text = "at -7.000 6.000 0.000, in its file 98.000 6.000 0.000 ± 0.01";
        assert_eq!(measured.describe(known).unwrap(), text);
        assert_eq!(measured.describe(|_| None).unwrap(), "at -7.000 6.000 0.000 ± 0.01", "not known yet");
        let same = measure(DVec3::new(98.0, 6.0, 0.0), DVec3::new(2.0, 1.0, 0.0));
        assert_eq!(same.describe(known).unwrap(), "at 98.000 6.000 0.000 ± 0.01");
    }

    #[test]
    fn bounds_are_the_pictures_error_where_the_surface_is_and_rounding() {
        let accuracy = Accuracy { error_px: 2.0, per_px: 0.01 };
        let found = Found { place: DVec3::ZERO, distance: 5.0, part: None, in_asset: None, rounding: 0.25 };
        assert!((accuracy.bound(&found) - 0.35).abs() < 1e-12);
    }
}
