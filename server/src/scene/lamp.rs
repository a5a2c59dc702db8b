//! `[[lamp]]` of a scene file: lights that stand in the scene, as KHR_lights_punctual has them.

use lodestream_protocol::lamps::{INTENSITIES, Lamp, MAX_COORDINATE, RANGES, Spot};
use serde::Deserialize;

use super::model::unit;
use super::terrain::SceneTerrain;

/// Angles of a spot that states none, in degrees.
const DEFAULT_INNER_DEGREES: f32 = 0.0;
const DEFAULT_OUTER_DEGREES: f32 = 45.0;

/// `[[lamp]]` as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawLamp {
    position: [f64; 3],
    /// Linear red, green and blue; multiplies the intensity.
    color: Option<[f32; 3]>,
    /// In candela.
    intensity: Option<f32>,
    /// Where it ends, in world units.
    range: Option<f32>,
    /// Whither it shines; without, all around.
    direction: Option<[f32; 3]>,
    inner_degrees: Option<f32>,
    outer_degrees: Option<f32>,
    /// The second coordinate of `position` is a height over the ground.
    #[serde(default)]
    on_terrain: bool,
}

impl RawLamp {
    /// The lamp, unless it gives no light.
    ///
    /// # Errors
    /// In one line: what is out of range, and what to do.
    pub(super) fn resolve(self, terrain: Option<&SceneTerrain>) -> Result<Option<Lamp>, String> {
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
        let range = self.range.unwrap_or_else(|| Lamp::usual_range(intensity));
        if !(nearest..=furthest).contains(&range) {
            return Err(format!(
                "range must be {nearest:e} to {furthest:e}; leave it out for 10 times the root of the intensity"
            ));
        }
        let spot = self.spot()?;
        // One that is switched off is no mistake.
        let shines = intensity.iter().any(|i| *i >= least);
        Ok(shines.then_some(Lamp { position, intensity, range, spot }))
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
