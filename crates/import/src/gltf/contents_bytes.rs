//! [`Contents`] as bytes, for programs that keep them with a hash of the file: the file then need not be parsed again.
//!
//! Little-endian numbers; a count of 8 bytes before each list and text, a byte before what may be absent.

use std::sync::Arc;

use lodestream_scene::animation::AnimatedModel;
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::{PunctualLight, Spot};

use super::byte_values::{Rest, put_count, put_f32s, put_f64s, put_list, put_option, put_text};
use super::part_names::PartNames;
use super::sizes::MeshSize;
use super::{Contents, FileAnimation, PlacedMesh};
use crate::model::Part;

/// Version of what is found in a file, copies included, and of these bytes. Increment it when the same file gives others.
pub const CONTENTS_VERSION: u32 = 5;

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl Contents {
    /// The contents as bytes; `None` for those that no file has: placed parts that are not single meshes.
    #[must_use]
    pub fn to_bytes(&self) -> Option<Vec<u8>> {
        let Self { names, sizes, part_names, materials, placed, punctual_lights, animation, warnings } = self;
        let mut out = Vec::new();
        put_list(&mut out, names, |out, name| put_text(out, name));
        put_list(&mut out, sizes, |out, size| put_option(out, size.as_ref(), put_size));
        part_names.put(&mut out);
        put_count(&mut out, *materials);
        put_count(&mut out, placed.len());
        for placed in placed {
            put_placed(&mut out, placed)?;
        }
        put_list(&mut out, punctual_lights, put_light);
        let animated =
            animation.as_ref().map(|animation| Some((animation.model.to_bytes().ok()?, animation)));
        put_option(&mut out, animated.flatten(), |out, (model, animation)| {
            put_count(out, model.len());
            out.extend(model);
            put_list(out, &animation.placed, |out, placed| put_count(out, *placed));
        });
        put_list(&mut out, warnings, |out, warning| put_text(out, warning));
        Some(out)
    }

    /// The contents of [`Self::to_bytes`]; `None` for other bytes. Takes memory in proportion to the bytes.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let rest = &mut Rest::new(bytes);
        let contents = Self {
            names: rest.list(Rest::text)?,
            sizes: rest.list(|rest| rest.option(size))?,
            part_names: Arc::new(PartNames::take(rest)?),
            materials: rest.count()?,
            placed: rest.list(placed)?,
            punctual_lights: rest.list(light)?,
            animation: rest.option(animation)?,
            warnings: rest.list(Rest::text)?,
        };
        rest.is_empty().then_some(contents)
    }
}

fn put_size(out: &mut Vec<u8>, size: &MeshSize) {
    let MeshSize { faces, low, high, uvs } = size;
    put_count(out, *faces);
    put_f64s(out, low);
    put_f64s(out, high);
    put_option(out, uvs.as_ref(), |out, uvs| put_f64s(out, uvs.as_flattened()));
}

fn size(rest: &mut Rest<'_>) -> Option<MeshSize> {
    let uvs = |rest: &mut Rest<'_>| Some([rest.f64s()?, rest.f64s()?]);
    Some(MeshSize { faces: rest.count()?, low: rest.f64s()?, high: rest.f64s()?, uvs: rest.option(uvs)? })
}

fn put_placed(out: &mut Vec<u8>, placed: &PlacedMesh) -> Option<()> {
    let PlacedMesh { part, placement, mesh, to_scene, node } = placed;
    let Part::Mesh { mesh: original, linear } = part else { return None };
    put_count(out, *original);
    // Most have none.
    put_option(out, (*linear != IDENTITY).then_some(linear), |out, linear| {
        put_f64s(out, linear.as_flattened())
    });
    let Placement { translation, rotation, scale } = placement;
    put_f64s(out, translation);
    put_f32s(out, rotation);
    put_f32s(out, &[*scale]);
    put_count(out, *mesh);
    put_f64s(out, to_scene.as_flattened());
    put_option(out, node.as_ref(), |out, node| out.extend(node.to_le_bytes()));
    Some(())
}

fn placed(rest: &mut Rest<'_>) -> Option<PlacedMesh> {
    let mesh = rest.count()?;
    let linear = rest.option(|rest| Some([rest.f64s()?, rest.f64s()?, rest.f64s()?]))?;
    let (translation, rotation, [scale]) = (rest.f64s()?, rest.f32s()?, rest.f32s()?);
    Some(PlacedMesh {
        part: Part::Mesh { mesh, linear: linear.unwrap_or(IDENTITY) },
        placement: Placement { translation, rotation, scale },
        mesh: rest.count()?,
        to_scene: [rest.f64s()?, rest.f64s()?, rest.f64s()?, rest.f64s()?],
        node: rest.option(|rest| rest.array().map(u32::from_le_bytes))?,
    })
}

fn animation(rest: &mut Rest<'_>) -> Option<FileAnimation> {
    let model = AnimatedModel::from_bytes(rest.bytes()?).ok()?;
    let placed = rest.list(Rest::count)?;
    (placed.len() == model.parts.len() + model.skins.len()).then_some(FileAnimation { model, placed })
}

fn put_light(out: &mut Vec<u8>, light: &PunctualLight) {
    let PunctualLight { position, intensity, range, spot } = light;
    put_f64s(out, position);
    put_f32s(out, intensity);
    put_f32s(out, &[*range]);
    put_option(out, spot.as_ref(), |out, Spot { direction, inner, outer }| {
        put_f32s(out, direction);
        put_f32s(out, &[*inner, *outer]);
    });
}

fn light(rest: &mut Rest<'_>) -> Option<PunctualLight> {
    let (position, intensity, [range]) = (rest.f64s()?, rest.f32s()?, rest.f32s()?);
    let spot = rest.option(|rest| {
        let (direction, [inner, outer]) = (rest.f32s()?, rest.f32s()?);
        Some(Spot { direction, inner, outer })
    })?;
    Some(PunctualLight { position, intensity, range, spot })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gltf::{CopyTolerance, contents};

    /// A file with a name twice, a mirrored and an unevenly scaled node, extras, a light, and an animation.
    fn some() -> Contents {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gltf");
        let bytes: Vec<u8> = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5, 2.0]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let uri = format!("data:;base64,{}", data_encoding::BASE64.encode(&bytes));
        let light = serde_json::json!({"type": "spot", "intensity": 5.0, "spot": {"outerConeAngle": 0.5}});
        let extension = serde_json::json!({"KHR_lights_punctual": {"light": 0}});
        let file = serde_json::json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1, 2, 3]}],
            "extensionsUsed": ["KHR_lights_punctual"], "extensions": {"KHR_lights_punctual": {"lights": [light]}},
            "nodes": [
                {"mesh": 0, "name": "door", "extras": {"fire": 30}, "children": [4]},
                {"mesh": 1, "scale": [1.0, 2.0, 1.0]},
                {"mesh": 0, "scale": [-1.0, 1.0, 1.0], "translation": [0.1, 4e6, 0.0]},
                {"extensions": extension}, {"mesh": 0, "name": "handle"},
            ],
            "meshes": [
                {"primitives": [{"attributes": {"POSITION": 0}}], "name": "leaf"},
                {"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}], "name": "leaf"},
            ],
            "accessors": [{
                "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3,
                "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0],
            }, {"bufferView": 0, "byteOffset": 36, "componentType": 5126, "type": "SCALAR", "count": 3}],
            "bufferViews": [{"buffer": 0, "byteLength": 48}], "buffers": [{"byteLength": 48, "uri": uri}],
            "animations": [{
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
                "samplers": [{"input": 1, "output": 0}],
            }],
        });
        std::fs::write(&path, file.to_string()).unwrap();
        let found = contents(&path, Some(CopyTolerance::Length(1e-3))).unwrap();
        Contents { warnings: vec!["a warning".into()], ..found }
    }

    #[test]
    fn contents_are_the_same_after_a_round_trip() {
        let some = some();
        assert_eq!(
            (some.placed.len(), some.punctual_lights.len(), some.sizes.iter().flatten().count()),
            (4, 1, 1)
        );
        let bytes = some.to_bytes().unwrap();
        let found = Contents::from_bytes(&bytes).unwrap();
        assert_eq!(format!("{found:?}"), format!("{some:?}"));
        assert_eq!(found.part_names.of(Some(4), 0).path, "door");
        // The door and its handle.
        assert_eq!(found.animation.unwrap().placed.len(), 2);
    }

    #[test]
    fn other_bytes_are_refused_without_a_panic() {
        let bytes = some().to_bytes().unwrap();
        for length in 0..bytes.len() {
            assert!(Contents::from_bytes(&bytes[..length]).is_none(), "{length}");
        }
        assert!(Contents::from_bytes(&[&bytes[..], &[0]].concat()).is_none());
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0xff;
            let _ = Contents::from_bytes(&damaged);
        }
    }

    /// A change of what is found that forgets [`CONTENTS_VERSION`] fails here: update both together.
    #[test]
    fn what_is_found_in_a_file_is_fixed() {
        let bytes = some().to_bytes().unwrap();
        let sum = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |sum, &byte| {
            (sum ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
        });
        assert_eq!((CONTENTS_VERSION, bytes.len(), sum), (5, 1472, 10_464_392_509_566_752_489));
    }
}
