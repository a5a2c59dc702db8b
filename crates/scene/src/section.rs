//! Section planes: what lies beyond one is cut away.

use glam::DVec3;

/// Most section planes at a time.
pub const MAX_SECTION_PLANES: usize = 3;

/// A plane `normal · p = distance` in the world. What lies on the side that its normal points to is cut away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SectionPlane {
    normal: DVec3,
    distance: f64,
}

impl SectionPlane {
    /// The plane `normal · p = distance`, with a normal of any length but 0. `None` if a number is not finite or the
    /// normal has no direction.
    #[must_use]
    pub fn new(normal: DVec3, distance: f64) -> Option<Self> {
        let length = normal.length();
        let (normal, distance) = (normal / length, distance / length);
        (normal.is_finite() && distance.is_finite()).then_some(Self { normal, distance })
    }

    /// The plane through a point.
    #[must_use]
    pub fn through(point: DVec3, normal: DVec3) -> Option<Self> {
        Self::new(normal, normal.dot(point))
    }

    /// Unit vector towards the side that is cut away.
    #[must_use]
    pub const fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Distance of the plane from the world's origin along its normal, in world units.
    #[must_use]
    pub const fn distance(&self) -> f64 {
        self.distance
    }

    /// How far a point lies beyond the plane, in world units; negative on the side that is kept.
    #[must_use]
    pub fn beyond(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.distance
    }
}

/// Up to [`MAX_SECTION_PLANES`] planes. What is left, beyond none of them, is convex.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SectionPlanes([Option<SectionPlane>; MAX_SECTION_PLANES]);

impl SectionPlanes {
    /// No plane: nothing is cut.
    pub const NONE: Self = Self([None; MAX_SECTION_PLANES]);

    /// These planes; `None` if there are more than [`MAX_SECTION_PLANES`].
    #[must_use]
    pub fn new(planes: &[SectionPlane]) -> Option<Self> {
        let mut all = Self::NONE;
        for (at, plane) in planes.iter().enumerate() {
            *all.0.get_mut(at)? = Some(*plane);
        }
        Some(all)
    }

    /// Whether nothing is cut.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.iter().next().is_none()
    }

    /// The planes.
    pub fn iter(&self) -> impl Iterator<Item = &SectionPlane> {
        self.0.iter().flatten()
    }

    /// Whether all of a sphere is cut away.
    #[must_use]
    pub fn cut_sphere(&self, centre: DVec3, radius: f64) -> bool {
        self.iter().any(|plane| plane.beyond(centre) > radius)
    }

    /// The stretch of a ray that is kept, as multiples of its direction from 0 to infinity; `None` if all is cut away.
    #[must_use]
    pub fn kept_stretch(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 2]> {
        let [mut from, mut to] = [0.0_f64, f64::INFINITY];
        for plane in self.iter() {
            let (beyond, slope) = (plane.beyond(origin), plane.normal.dot(direction));
            if slope < 0.0 {
                from = from.max(-beyond / slope);
            } else if slope > 0.0 {
                to = to.min(-beyond / slope);
            } else if beyond > 0.0 {
                return None;
            }
        }
        (from <= to).then_some([from, to])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_need_a_direction_and_may_have_normals_of_any_length() {
        let plane = SectionPlane::new(DVec3::new(0.0, 4.0, 0.0), 2.0).unwrap();
        assert_eq!((plane.normal(), plane.distance()), (DVec3::Y, 0.5));
        assert_eq!(plane, SectionPlane::through(DVec3::new(7.0, 0.5, -3.0), DVec3::Y).unwrap());
        assert_eq!(plane.beyond(DVec3::new(0.0, 2.0, 0.0)), 1.5);
        for (normal, distance) in
            [(DVec3::ZERO, 1.0), (DVec3::NAN, 1.0), (DVec3::X, f64::INFINITY), (DVec3::INFINITY, 0.0)]
        {
            assert_eq!(SectionPlane::new(normal, distance), None);
        }
        assert!(SectionPlanes::new(&[plane; MAX_SECTION_PLANES]).is_some());
        assert_eq!(SectionPlanes::new(&[plane; MAX_SECTION_PLANES + 1]), None);
        assert!(SectionPlanes::new(&[]).unwrap().is_empty());
    }

    #[test]
    fn the_kept_stretch_of_a_ray_agrees_with_points_along_it() {
        let planes = [(DVec3::new(1.0, 0.3, 0.0), 1.0), (DVec3::new(-1.0, 0.5, 0.2), 2.0), (DVec3::Z, 1.5)];
        let planes = planes.map(|(normal, distance)| SectionPlane::new(normal, distance).unwrap());
        let all = SectionPlanes::new(&planes).unwrap();
        let mut found = [0, 0];
        for i in 0..500_u32 {
            let f = f64::from(i);
            let origin = DVec3::new((f * 0.37).sin(), (f * 0.73).cos(), (f * 0.11).sin()) * 6.0;
            let direction = DVec3::new((f * 0.29).cos(), (f * 0.53).sin(), (f * 0.83).cos());
            let stretch = all.kept_stretch(origin, direction);
            found[usize::from(stretch.is_some())] += 1;
            for step in 0..200_u32 {
                let at = f64::from(step) * 0.1;
                let point = origin + direction * at;
                let beyond = all.iter().map(|plane| plane.beyond(point)).fold(f64::MIN, f64::max);
                let within = stretch.is_some_and(|[from, to]| at >= from && at <= to);
                assert!(beyond.abs() < 1e-9 || within == (beyond < 0.0), "{origin} {direction} {at}");
                assert!(!all.cut_sphere(point, 0.25) || beyond > 0.25);
            }
        }
        assert!(found.iter().all(|&number| number > 50), "{found:?}");
        assert_eq!(SectionPlanes::NONE.kept_stretch(DVec3::ZERO, DVec3::X), Some([0.0, f64::INFINITY]));
    }
}
