//! Punctual lights (KHR_lights_punctual), placed by nodes.
//!
//! A light has its node's position and shines along the node's −z. The node's scale changes only the position.

use glam::{DMat3, DMat4, DVec3};
use lodestream_scene::punctual_lights::{INTENSITIES, MAX_COORDINATE, PunctualLight, RANGES, Spot};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::container::Document;
use super::root::Node;
use crate::error::ImportError;

const EXTENSION: &str = "KHR_lights_punctual";

/// A light of the file, placed by a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlacedLight {
    pub(super) node: usize,
    pub(super) light: usize,
    pub(super) to_scene: DMat4,
}

/// A light of the file's JSON.
#[derive(Deserialize)]
struct Light {
    #[serde(rename = "type")]
    kind: String,
    #[serde(default = "white")]
    color: [f32; 3],
    #[serde(default = "one")]
    intensity: f32,
    range: Option<f32>,
    #[serde(default)]
    spot: Cone,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Cone {
    inner_cone_angle: f32,
    outer_cone_angle: f32,
}

impl Default for Cone {
    fn default() -> Self {
        Self { inner_cone_angle: 0.0, outer_cone_angle: std::f32::consts::FRAC_PI_4 }
    }
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

fn one() -> f32 {
    1.0
}

/// Index of the light that a node refers to, if any.
///
/// # Errors
/// The end of a message: the reference is not a number.
pub(super) fn of_node(node: &Node) -> Result<Option<usize>, &'static str> {
    let Some(extension) = node.extension(EXTENSION) else {
        return Ok(None);
    };
    let number = extension.get("light").and_then(Value::as_u64).and_then(|light| usize::try_from(light).ok());
    number.map(Some).ok_or("has a light whose index is not a number")
}

/// The file's list of lights, as JSON.
fn listed(others: Option<&Map<String, Value>>) -> &[Value] {
    let lights = others.and_then(|all| all.get(EXTENSION)?.get("lights")?.as_array());
    lights.map_or(&[], Vec::as_slice)
}

fn all(document: &Document) -> &[Value] {
    listed(document.root.extensions.as_ref().map(|all| &all.others))
}

/// Number of directional lights in the file.
pub(super) fn directional(document: &Document) -> usize {
    all(document)
        .iter()
        .filter(|light| light.get("type").and_then(Value::as_str) == Some("directional"))
        .count()
}

/// Converts the placed lights to punctual lights, in the file's axes and units. Omits directional lights, lights without
/// intensity, and spots whose direction a zero scale removes. Clamps numbers to their ranges.
///
/// # Errors
/// References to missing or invalid lights, and positions beyond [`MAX_COORDINATE`].
pub(super) fn punctual_lights(
    document: &Document,
    placed: &[PlacedLight],
) -> Result<Vec<PunctualLight>, ImportError> {
    let all = all(document);
    let mut read: Vec<Option<Light>> = all.iter().map(|_| None).collect();
    let mut punctual_lights = Vec::new();
    for &PlacedLight { node, light, to_scene } in placed {
        let place = format!("extensions.{EXTENSION}.lights[{light}]");
        let (Some(source), Some(read)) = (all.get(light), read.get_mut(light)) else {
            return Err(document.error(format!("nodes[{node}] has a light, but {place} does not exist")));
        };
        let parsed = match read.take() {
            Some(parsed) => parsed,
            None => Light::deserialize(source).map_err(|why| {
                document.error(format!("{place} is not a valid light: {why}; export the file again"))
            })?,
        };
        let placed = punctual_light(&parsed, &to_scene).map_err(|what| match what {
            Unusable::Kind => {
                document.error(format!("{place}.type is {:?}; use point, spot or directional", parsed.kind))
            }
            Unusable::Position => {
                document.error(format!("nodes[{node}] has a light further out than {MAX_COORDINATE:e}"))
            }
        })?;
        punctual_lights.extend(placed);
        *read = Some(parsed);
    }
    Ok(punctual_lights)
}

/// Why a light cannot be used.
enum Unusable {
    /// Unknown type.
    Kind,
    /// Position out of range.
    Position,
}

fn punctual_light(light: &Light, to_scene: &DMat4) -> Result<Option<PunctualLight>, Unusable> {
    let direction = match light.kind.as_str() {
        "point" => None,
        "spot" => {
            let Some(direction) = (DMat3::from_mat4(*to_scene) * DVec3::NEG_Z).try_normalize() else {
                return Ok(None);
            };
            Some(direction.as_vec3().to_array())
        }
        "directional" => return Ok(None),
        _ => return Err(Unusable::Kind),
    };
    let position = to_scene.w_axis.truncate().to_array();
    if !position.iter().all(|x| x.abs() <= MAX_COORDINATE) {
        return Err(Unusable::Position);
    }
    // Clamped before multiplying: 0 × ∞ is NaN.
    let within = |x: f32| x.clamp(0.0, INTENSITIES[1]);
    let intensity = light.color.map(|c| within(within(c) * within(light.intensity)));
    if !intensity.iter().any(|i| *i >= INTENSITIES[0]) {
        return Ok(None);
    }
    let range = match light.range {
        Some(range) if range > 0.0 => range.clamp(RANGES[0], RANGES[1]),
        _ => PunctualLight::usual_range(intensity),
    };
    let outer = light.spot.outer_cone_angle.clamp(1e-3, std::f32::consts::FRAC_PI_2);
    let inner = light.spot.inner_cone_angle.clamp(0.0, outer);
    let spot = direction.map(|direction| Spot { direction, inner, outer });
    Ok(Some(PunctualLight { position, intensity, range, spot }))
}
