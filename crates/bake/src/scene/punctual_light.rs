//! `[[punctual_light]]` of a scene file: lights that stand in the scene, as KHR_lights_punctual has them.

use lodestream_scene::punctual_lights::{INTENSITIES, MAX_COORDINATE, PunctualLight, RANGES, Spot};
use serde::Deserialize;

use super::model::unit;
use super::terrain::SceneTerrain;

/// Angles of a spot that states none, in degrees.
const DEFAULT_INNER_DEGREES: f32 = 0.0;
const DEFAULT_OUTER_DEGREES: f32 = 45.0;

/// `[[punctual_light]]` as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPunctualLight {
    position: [f64; 3],
    /// Linear red, green and blue; multiplies the intensity.
    color: Option<[f32; 3]>,
    /// In candela.
    intensity: Option<f32>,
    /// Where it ends, in world units.
    range: Option<f32>,
    /// Direction of a spot; without it the light is a point light.
    direction: Option<[f32; 3]>,
    inner_degrees: Option<f32>,
    outer_degrees: Option<f32>,
    /// The second coordinate of `position` is a height over the ground.
    #[serde(default)]
    on_terrain: bool,
}

impl RawPunctualLight {
    /// The punctual light, unless it gives no light.
    ///
    /// # Errors
    /// In one line: what is out of range, and what to do.
    pub(super) fn resolve(self, terrain: Option<&SceneTerrain>) -> Result<Option<PunctualLight>, String> {
        let mut position = self.position;
        if self.on_terrain {
            let [x, _, z] = position;
            let terrain =
                terrain.ok_or("on_terrain needs a [terrain]; add one, or leave on_terrain out".to_owned())?;
            let ground = terrain.height(x, z);
            position[1] += ground
                .ok_or_else(|| format!("there is no terrain at {x}, {z}; more patches reach further"))?;
        }
        if !position.iter().all(|x| x.abs() <= MAX_COORDINATE) {
            return Err(format!("position must be three numbers of at most {MAX_COORDINATE:e}"));
        }
        let (color, intensity) = (self.color.unwrap_or([1.0; 3]), self.intensity.unwrap_or(1.0));
        let intensity = color.map(|c| c * intensity);
        let [least, most] = INTENSITIES;
        if !intensity.iter().all(|i| (0.0..=most).contains(i)) {
            return Err(format!("color times intensity must be 0 to {most:e} candela"));
        }
        let [nearest, furthest] = RANGES;
        let range = self.range.unwrap_or_else(|| PunctualLight::usual_range(intensity));
        if !(nearest..=furthest).contains(&range) {
            return Err(format!(
                "range must be {nearest:e} to {furthest:e}; leave it out for 10 times the root of the intensity"
            ));
        }
        let spot = self.spot()?;
        // One that is switched off is no mistake.
        let shines = intensity.iter().any(|i| *i >= least);
        Ok(shines.then_some(PunctualLight { position, intensity, range, spot }))
    }

    fn spot(&self) -> Result<Option<Spot>, String> {
        let Some(direction) = self.direction else {
            return match (self.inner_degrees, self.outer_degrees) {
                (None, None) => Ok(None),
                _ => {
                    Err("a cone needs a direction; add one, or leave inner_degrees and outer_degrees out"
                        .into())
                }
            };
        };
        let direction = unit(direction).ok_or("direction must be finite and not zero")?;
        let inner = self.inner_degrees.unwrap_or(DEFAULT_INNER_DEGREES);
        let outer = self.outer_degrees.unwrap_or(DEFAULT_OUTER_DEGREES);
        if !(inner >= 0.0 && inner <= outer && (0.1..=90.0).contains(&outer)) {
            return Err(format!(
                "a cone from {inner} to {outer} degrees; outer_degrees must be 0.1 to 90, inner_degrees 0 to that"
            ));
        }
        let [inner, outer] = [inner, outer].map(|angle| angle.to_radians().min(std::f32::consts::FRAC_PI_2));
        Ok(Some(Spot { direction, inner, outer }))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::parse;

    const PUNCTUAL_LIGHTS: &str = r#"
[[punctual_light]]
position = [1, 2, 3]
color = [1, 0.5, 0.25]
intensity = 64
[[punctual_light]]
position = [0, 4, 0]
intensity = 9.0
range = 7.5
direction = [0, -2, 0]
inner_degrees = 10
outer_degrees = 30
[[punctual_light]]
position = [0, 0, 0]
intensity = 0
"#;

    const ASSET: &str = "[[asset]]\nname = 'a'\nfile = 'a.obj'\n";

    #[test]
    fn punctual_lights_are_read_and_those_that_are_off_left_out() {
        let scene = parse(Path::new("s.toml"), &(PUNCTUAL_LIGHTS.to_owned() + ASSET)).unwrap();
        let [bulb, spot] = &scene.punctual_lights[..] else { panic!("{:?}", scene.punctual_lights) };
        assert_eq!((bulb.position, bulb.intensity), ([1.0, 2.0, 3.0], [64.0, 32.0, 16.0]));
        assert_eq!((bulb.range, bulb.spot), (80.0, None));
        let cone = spot.spot.unwrap();
        assert_eq!((spot.range, cone.direction), (7.5, [0.0, -1.0, 0.0]));
        assert!(
            (cone.inner.to_degrees() - 10.0).abs() < 1e-4 && (cone.outer.to_degrees() - 30.0).abs() < 1e-4
        );
    }

    #[test]
    fn errors_of_punctual_lights_name_the_line_and_what_to_do() {
        for (from, to, fragments) in [
            (
                "position = [1, 2, 3]",
                "position = [1, nan, 3]",
                &[":2:", "punctual light: position must be"][..],
            ),
            ("position = [1, 2, 3]", "position = [1, 2e12, 3]", &[":2:", "at most 1e12"]),
            ("position = [1, 2, 3]", "", &[":2:", "missing field `position`"]),
            ("intensity = 64", "intensity = -1", &[":2:", "0 to 1e12 candela"]),
            ("color = [1, 0.5, 0.25]", "colour = [1, 0.5, 0.25]", &[":4:", "colour"]),
            ("range = 7.5", "range = 0", &[":6:", "range must be 1e-6", "leave it out"]),
            ("direction = [0, -2, 0]", "direction = [0, 0, 0]", &[":6:", "direction must be"]),
            ("direction = [0, -2, 0]", "", &[":6:", "a cone needs a direction"]),
            ("inner_degrees = 10", "inner_degrees = 31", &["a cone from 31 to 30 degrees"]),
            ("outer_degrees = 30", "outer_degrees = 91", &["0.1 to 90"]),
            (
                "position = [0, 0, 0]",
                "position = [0, 0, 0]\non_terrain = true",
                &["on_terrain needs a [terrain]"],
            ),
            (
                "[[punctual_light]]",
                "[[light]]",
                &[":2:", "[light] is the only directional light", "[[punctual_light]]"],
            ),
        ] {
            let message = parse(Path::new("s.toml"), &(PUNCTUAL_LIGHTS.replacen(from, to, 1) + ASSET))
                .unwrap_err()
                .to_string();
            for fragment in fragments {
                assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
            }
        }
    }
}
