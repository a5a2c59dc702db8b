//! Lights of nodes: position, direction, and properties that do not change with the node's scale.

use glam::DVec3;
use lodestream_scene::punctual_lights::{PunctualLight, Spot};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{Model, write};
use crate::gltf::{Contents, contents};
use crate::{ImportError, import};

/// A quad, and nodes with lights.
fn lit(lights: Value, nodes: &[Value]) -> Model {
    let mut model = Model::quad();
    model.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    model.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    model.json["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
    for node in nodes {
        let number = model.push("nodes", node.clone());
        model.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(number));
    }
    model
}

fn light(number: usize) -> Value {
    json!({"KHR_lights_punctual": {"light": number}})
}

fn read(model: &Model) -> Result<Contents, ImportError> {
    let dir = TempDir::new().unwrap();
    contents(&write(&dir, "a.glb", model.glb()), None)
}

#[test]
fn lights_stand_and_shine_as_their_nodes_say_whatever_their_scale() {
    let lights = json!([
        {"type": "point", "color": [1, 0.5, 0], "intensity": 40, "range": 12.5, "name": "bulb"},
        {"type": "spot", "intensity": 9, "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}},
    ]);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let nodes = [
        json!({"translation": [1, 2, 3], "scale": [2, 2, 2], "children": [2, 3]}),
        json!({"translation": [1, 0, 0], "scale": [5, 5, 5], "extensions": light(0)}),
        // A quarter turn down about x takes −z to −y.
        json!({"translation": [0, 1, 0], "rotation": [-half, 0, 0, half], "extensions": light(1)}),
    ];
    let mut model = lit(lights, &nodes);
    model.json["scenes"][0]["nodes"] = json!([0, 1]);
    let found = read(&model).unwrap();
    assert_eq!(found.placed.len(), 1);
    let [bulb, spot] = &found.punctual_lights[..] else { panic!("{:?}", found.punctual_lights) };
    let expected =
        PunctualLight { position: [3.0, 2.0, 3.0], intensity: [40.0, 20.0, 0.0], range: 12.5, spot: None };
    assert_eq!(*bulb, expected);
    assert_eq!((spot.position, spot.intensity, spot.range), ([1.0, 4.0, 3.0], [9.0; 3], 30.0));
    let Spot { direction, inner, outer } = spot.spot.unwrap();
    assert!(DVec3::from(direction.map(f64::from)).distance(DVec3::NEG_Y) < 1e-6, "{direction:?}");
    assert_eq!((inner, outer), (0.25, 0.5));
    // The mesh is the same, and the file is not refused for the required extension.
    let dir = TempDir::new().unwrap();
    let imported = import(&write(&dir, "a.glb", model.glb())).unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
}

#[test]
fn missing_light_fields_have_the_extensions_defaults() {
    let nodes = [json!({"extensions": light(0)}), json!({"extensions": light(1)})];
    let found = read(&lit(json!([{"type": "point"}, {"type": "spot", "spot": {}}]), &nodes)).unwrap();
    let plain = PunctualLight { position: [0.0; 3], intensity: [1.0; 3], range: 10.0, spot: None };
    let cone = Spot { direction: [0.0, 0.0, -1.0], inner: 0.0, outer: std::f32::consts::FRAC_PI_4 };
    assert_eq!(found.punctual_lights, [plain, PunctualLight { spot: Some(cone), ..plain }]);
}

#[test]
fn lights_without_effect_are_dropped_and_values_out_of_range_clamped() {
    let with = |source: Value| {
        read(&lit(json!([source]), &[json!({"extensions": light(0)})])).unwrap().punctual_lights
    };
    for dark in [
        json!({"type": "directional", "intensity": 1000}),
        json!({"type": "point", "intensity": 0}),
        json!({"type": "point", "intensity": -5}),
        json!({"type": "point", "color": [0, 0, 0]}),
    ] {
        assert_eq!(with(dark.clone()), [], "{dark}");
    }
    let odd = json!({"type": "spot", "intensity": 1e30, "range": 0,
        "spot": {"innerConeAngle": 3, "outerConeAngle": 2}});
    let [odd] = &with(odd)[..] else { panic!() };
    odd.check().unwrap();
    // A node with a scale of zero along z leaves a spot without a direction.
    let flat = json!({"scale": [1, 1, 0], "extensions": light(0)});
    assert_eq!(read(&lit(json!([{"type": "spot"}]), &[flat])).unwrap().punctual_lights, []);
}

#[test]
fn bad_lights_are_refused_with_their_place() {
    let with = |lights: Value, node: Value| read(&lit(lights, &[node])).unwrap_err().to_string();
    for (lights, node, fragments) in [
        (json!([]), json!({"extensions": light(0)}), &["nodes[1]", "lights[0] does not exist"][..]),
        (
            json!([{"type": "area"}]),
            json!({"extensions": light(0)}),
            &["lights[0].type", "\"area\"", "use point"],
        ),
        (
            json!([{}]),
            json!({"extensions": light(0)}),
            &["lights[0] is not a valid light", "export the file again"],
        ),
        (
            json!([{"type": "point", "intensity": "x"}]),
            json!({"extensions": light(0)}),
            &["lights[0] is not a valid light"],
        ),
        (
            json!([{"type": "point"}]),
            json!({"extensions": {"KHR_lights_punctual": {"light": -1}}}),
            &["nodes[1] has a light whose index is not a number"],
        ),
        (
            json!([{"type": "point"}]),
            json!({"translation": [1e20, 0, 0], "extensions": light(0)}),
            &["nodes[1]", "further out"],
        ),
    ] {
        let message = with(lights, node);
        for fragment in fragments {
            assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
        }
    }
}
