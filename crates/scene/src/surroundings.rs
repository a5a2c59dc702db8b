//! What surrounds a scene's models. On the wire it is a pair of colours: a renderer that knows no studios shows a grey
//! sky.

use crate::description::{DEFAULT_AMBIENT, DEFAULT_BACKGROUND, SceneHeader};

/// Background that together with [`STUDIO_AMBIENT`] stands for a studio, linear RGB.
pub const STUDIO_BACKGROUND: [f32; 3] = [0.23; 3];
/// Ambient light of a studio, linear RGB: as bright as the horizon of the grey sky in its place.
pub const STUDIO_AMBIENT: [f32; 3] = [0.299; 3];
/// Unit vector towards the key light of a studio that states none: from the upper left of the start camera of models.
pub const STUDIO_LIGHT: [f32; 3] = [-0.390_562_8, 0.737_729_7, 0.550_650_1];

/// What surrounds the models of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surroundings {
    /// A sky with a sun, and haze over terrain.
    Sky,
    /// A grey background, soft light from all sides, and ground that shows shadows only.
    Studio,
    /// The background and ambient light that the header states.
    Colors,
}

impl SceneHeader {
    /// What surrounds the models: the colours that the header states, unless they are a pair that stands for more.
    /// Scenes with terrain have no studio.
    #[must_use]
    pub fn surroundings(&self) -> Surroundings {
        let colors = (self.background, self.light.ambient);
        if colors == (DEFAULT_BACKGROUND, DEFAULT_AMBIENT) {
            Surroundings::Sky
        } else if colors == (STUDIO_BACKGROUND, STUDIO_AMBIENT) && self.terrain.is_none() {
            Surroundings::Studio
        } else {
            Surroundings::Colors
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::description::{Camera, SceneLighting};

    #[test]
    fn surroundings_are_a_pair_of_colors() {
        let of = |background, ambient| {
            let header = SceneHeader {
                name: String::new(),
                fingerprint: Default::default(),
                asset_count: 0,
                instance_count: 0,
                page_count: 0,
                light: SceneLighting { direction: STUDIO_LIGHT, color: [1.0; 3], ambient },
                background,
                terrain: None,
                camera: Camera { eye: [0.0; 3], target: [1.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 },
                root_slope: 0.0,
            };
            header.check().unwrap();
            header.surroundings()
        };
        assert_eq!(of(DEFAULT_BACKGROUND, DEFAULT_AMBIENT), Surroundings::Sky);
        assert_eq!(of(STUDIO_BACKGROUND, STUDIO_AMBIENT), Surroundings::Studio);
        assert_eq!(of(STUDIO_BACKGROUND, DEFAULT_AMBIENT), Surroundings::Colors);
        assert_eq!(of([1.0; 3], [0.0; 3]), Surroundings::Colors);
        assert!((Vec3::from(STUDIO_LIGHT).length() - 1.0).abs() < 1e-6);
    }
}
