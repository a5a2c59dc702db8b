//! The section plane that is moved in the window.

use glam::DVec3;
use lodestream_client::core::PartBounds;
use lodestream_client::streaming::{Answer, Streaming};
use lodestream_scene::section::{SectionPlane, SectionPlanes};

/// A plane across an axis of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// The axis: 0 x, 1 y, 2 z.
    pub(super) axis: usize,
    /// Whether what lies before the plane is cut away, instead of what lies beyond it.
    pub(super) flipped: bool,
    /// Where it is between the scene's bounds, 0 to 1.
    pub(super) share: f64,
}

/// The plane, if there is one, and the bounds of the scene that it cuts.
#[derive(Debug, Default)]
pub(super) struct Section {
    pub(super) plane: Option<Plane>,
    bounds: Option<[DVec3; 2]>,
    asked: Option<Answer<Option<PartBounds>>>,
}

impl Section {
    /// Adds or removes the plane. A new one halves the scene across the axis along which a camera looks most, and removes
    /// the half that is nearer.
    pub(super) fn toggle(&mut self, forward: DVec3, streaming: Option<&Streaming>) {
        if self.plane.take().is_some() {
            return;
        }
        let along = forward.abs().to_array();
        let axis = (0..3).fold(0, |most, axis| if along[axis] > along[most] { axis } else { most });
        // Towards the eye.
        let flipped = forward.to_array()[axis] > 0.0;
        self.plane = Some(Plane { axis, flipped, share: 0.5 });
        self.asked = streaming.and_then(|streaming| streaming.ask(|core| core.scene_bounds()).ok());
    }

    /// Whether an answer is awaited.
    pub(super) const fn awaits_answer(&self) -> bool {
        self.asked.is_some()
    }

    /// Takes the scene's bounds, if they have come; returns whether they have.
    pub(super) fn receive(&mut self, streaming: &Streaming) -> bool {
        let Some(asked) = &mut self.asked else { return false };
        match asked.take() {
            Ok(None) => return false,
            // Nothing has arrived yet.
            Ok(Some(None)) => {
                self.asked = streaming.ask(|core| core.scene_bounds()).ok();
                return false;
            }
            Ok(Some(Some(bounds))) => self.bounds = Some(bounds.extent),
            Err(_) => {}
        }
        self.asked = None;
        true
    }

    /// Where the plane is along its axis, in world units.
    pub(super) fn position(&self) -> Option<f64> {
        let (plane, [low, high]) = (self.plane?, self.bounds?);
        let [low, high] = [low, high].map(|corner| corner.to_array()[plane.axis]);
        Some(low + (high - low) * plane.share)
    }

    /// The plane with others, which it follows; of too many it is left out.
    pub(super) fn with(&self, others: &SectionPlanes) -> SectionPlanes {
        let plane = self.plane.zip(self.position()).and_then(|(plane, at)| {
            let sign = if plane.flipped { -1.0 } else { 1.0 };
            let mut normal = [0.0; 3];
            normal[plane.axis] = sign;
            SectionPlane::new(normal.into(), sign * at)
        });
        let all: Vec<SectionPlane> = others.iter().copied().chain(plane).collect();
        SectionPlanes::new(&all).unwrap_or(*others)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_halves_the_scene_and_removes_the_nearer_half() {
        let mut section = Section {
            bounds: Some([DVec3::new(-2.0, 0.0, 0.0), DVec3::new(4.0, 1.0, 8.0)]),
            ..Section::default()
        };
        assert!(section.with(&SectionPlanes::NONE).is_empty());
        section.toggle(DVec3::new(0.2, -0.1, -0.9), None);
        let cut = section.with(&SectionPlanes::NONE);
        // The eye is at large z.
        assert!(cut.cut_sphere(DVec3::new(0.0, 0.0, 5.0), 0.5) && !cut.cut_sphere(DVec3::ZERO, 0.5));
        assert_eq!(section.position(), Some(4.0));
        section.toggle(DVec3::Z, None);
        section.toggle(DVec3::X, None);
        let cut = section.with(&cut);
        assert_eq!((cut.iter().count(), section.position()), (2, Some(1.0)));
        assert!(cut.cut_sphere(DVec3::new(-1.0, 0.0, 0.0), 0.5));
    }
}
