//! The animated models of a scene: which of its instances their clips move.

use std::collections::BTreeMap;

use bytes::Bytes;
use lodestream_scene::animation::{AnimationError, MAX_ANIMATED_MODELS};

use super::parts::sources;
use crate::scene::Scene;

/// Animated models that cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum AnimationBlobsError {
    /// More than the protocol numbers.
    #[error("the scene has more than {MAX_ANIMATED_MODELS} animated models; merge some, or split the scene")]
    TooMany,
    /// A model placed so often that its blob becomes too long, for example.
    #[error("the animation of {name:?} cannot be sent: {why}")]
    Refused {
        /// The scene.
        name: String,
        /// Why.
        why: AnimationError,
    },
}

/// Encodes the animated models that are placed, of instances that are sent in the order `order`. Models are in the order of
/// the scene, and their places too.
pub(super) fn blobs(scene: &Scene, order: &[usize]) -> Result<Vec<Bytes>, AnimationBlobsError> {
    if scene.models.iter().all(|model| model.animation.is_none()) {
        return Ok(Vec::new());
    }
    let mut numbers: Vec<u32> = vec![0; order.len()];
    for (number, &at) in (0..).zip(order) {
        if let Some(slot) = numbers.get_mut(at) {
            *slot = number;
        }
    }
    // Where the instances of a place of a model begin: each place has all its parts, one after the other.
    let mut places: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (at, &(model, part)) in sources(scene).iter().enumerate() {
        if part == 0 {
            places.entry(model).or_default().push(at);
        }
    }
    let mut blobs = Vec::new();
    for (number, starts) in places {
        let Some(animation) = scene.models.get(number as usize).and_then(|model| model.animation.as_ref())
        else {
            continue;
        };
        let mut model = animation.model.clone();
        let instance = |start: usize, part: u32| numbers.get(start + part as usize).copied();
        let place = |start: usize| animation.parts.iter().map(|&part| instance(start, part)).collect();
        model.places = starts.into_iter().filter_map(place).collect();
        if blobs.len() >= MAX_ANIMATED_MODELS as usize {
            return Err(AnimationBlobsError::TooMany);
        }
        let bytes = model.to_bytes();
        let bytes = bytes.map_err(|why| AnimationBlobsError::Refused { name: scene.name.clone(), why })?;
        blobs.push(bytes.into());
    }
    Ok(blobs)
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use data_encoding::BASE64;
    use glam::DVec3;
    use lodestream_geometry::index::Sphere;
    use lodestream_scene::animation::AnimatedModel;
    use lodestream_scene::description::{AssetEntry, Instance};
    use serde_json::{Value, json};

    use crate::compose::compose;
    use crate::scene::{Scene, of_files};

    /// A row of so many equal triangles, of which the last rises by 6 in two seconds.
    fn write(folder: &Path, name: &str, count: usize, moves: bool) -> PathBuf {
        let numbers = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0];
        let last = 3.0 * (count - 1) as f32;
        let values = [last, 0.0, 0.0, last, 6.0, 0.0];
        let bytes: Vec<u8> = numbers.iter().chain(&values).flat_map(|number| number.to_le_bytes()).collect();
        let uri = format!("data:;base64,{}", BASE64.encode(&bytes));
        let view =
            |from: usize, count: usize| json!({"buffer": 0, "byteOffset": 4 * from, "byteLength": 4 * count});
        let accessor = |view: usize, shape: &str, count: usize| {
            json!({"bufferView": view, "componentType": 5126, "type": shape, "count": count,
                "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0]})
        };
        let nodes: Vec<Value> =
            (0..count).map(|at| json!({"mesh": 0, "translation": [3.0 * at as f64, 0.0, 0.0]})).collect();
        let channel = json!({"sampler": 0, "target": {"node": count - 1, "path": "translation"}});
        let animation =
            json!({"name": "rise", "channels": [channel], "samplers": [{"input": 1, "output": 2}]});
        let file = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": (0..count).collect::<Vec<_>>()}],
            "nodes": nodes, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [accessor(0, "VEC3", 3), accessor(1, "SCALAR", 2), accessor(2, "VEC3", 2)],
            "bufferViews": [view(0, 9), view(9, 2), view(11, 6)],
            "buffers": [{"byteLength": bytes.len(), "uri": uri}],
            "animations": if moves { vec![animation] } else { Vec::new() },
        });
        let path = folder.join(name);
        std::fs::write(&path, file.to_string()).unwrap();
        path
    }

    /// The animated models of a scene, and its instances as they are sent.
    fn composed(scene: &Scene) -> (Vec<AnimatedModel>, Vec<Instance>) {
        let entry = |name: &str| AssetEntry {
            name: name.into(),
            sphere: Sphere { center: [0.5, 0.5, 0.0], radius: 1.0 },
            ..AssetEntry::default()
        };
        let entries: Vec<_> = scene.assets.iter().map(|asset| entry(&asset.name)).collect();
        let composed = compose(scene, &entries, &[]).unwrap();
        let models = composed.animations.iter().map(|bytes| AnimatedModel::from_bytes(bytes).unwrap());
        (models.collect(), composed.pages.into_iter().flat_map(|page| page.instances).collect())
    }

    /// Translations of the instances that a model moves, before and at the end of its clip.
    fn moved(model: &AnimatedModel, instances: &[Instance]) -> Vec<[DVec3; 2]> {
        let transforms = model.transforms_at(model.clips.first(), 2.0);
        let of = |(number, transform): (&u32, &lodestream_scene::parts::PartTransform)| {
            let placed = instances[*number as usize].placement;
            [placed, transform.within(&placed)].map(|placed| DVec3::from(placed.translation))
        };
        model.places.iter().flat_map(|place| place.iter().zip(&transforms).map(of)).collect()
    }

    #[test]
    fn models_move_the_instances_of_their_places_in_the_order_of_the_pages() {
        let folder = tempfile::tempdir().unwrap();
        let row = write(folder.path(), "row.gltf", 3, true);
        write(folder.path(), "still.gltf", 2, false);
        let (models, instances) = composed(&of_files(std::slice::from_ref(&row)).unwrap());
        let [model] = &models[..] else { panic!("{models:?}") };
        let [[before, after]] = moved(model, &instances)[..] else { panic!("one instance moves") };
        assert_eq!((before, after), (DVec3::new(6.0, 0.0, 0.0), DVec3::new(6.0, 6.0, 0.0)));
        let text = "
            [[asset]]\nname = \"still\"\nfile = \"still.gltf\"
            [[asset]]\nname = \"row\"\nfile = \"row.gltf\"
            [[instance]]\nasset = \"still\"
            [[instance]]\nasset = \"row\"\ntranslation = [0, 0, -50]\nrotation = { roll = 90 }\nscale = 2
            [[instance]]\nasset = \"row\"\ntranslation = [100, 0, 0]
        ";
        let scene = crate::scene::parse(&folder.path().join("scene.toml"), text).unwrap();
        let (models, instances) = composed(&scene);
        let [model] = &models[..] else { panic!("{models:?}") };
        let near = |[before, after]: [DVec3; 2], at: [f64; 3], by: [f64; 3]| {
            before.distance(at.into()) < 1e-5 && (after - before).distance(by.into()) < 1e-5
        };
        let all = moved(model, &instances);
        assert_eq!(all.len(), 2);
        assert!(near(all[0], [0.0, 12.0, -50.0], [-12.0, 0.0, 0.0]), "turned and twice as large: {all:?}");
        assert!(near(all[1], [106.0, 0.0, 0.0], [0.0, 6.0, 0.0]), "{all:?}");
    }

    #[test]
    fn what_moves_is_in_no_batch_and_what_is_merged_does_not_move() {
        let folder = tempfile::tempdir().unwrap();
        let many = |name: &str, moves| {
            let path = write(folder.path(), name, 40, moves);
            let scene = of_files(&[path]).unwrap();
            let (models, instances) = composed(&scene);
            (models, instances.len(), scene.assets.len())
        };
        let (models, instances, assets) = many("moving.gltf", true);
        assert_eq!((models.len(), models[0].places[0].len()), (1, 1));
        let (none, batched, fewer) = many("batched.gltf", false);
        assert!(none.is_empty());
        assert_eq!(([instances, batched], [assets, fewer]), ([2, 1], [2, 1]), "39 in a batch, and one");
        write(folder.path(), "row.gltf", 3, true);
        let text = "[[asset]]\nname = \"row\"\nfile = \"row.gltf\"\nmerge = true";
        let merged = crate::scene::parse(&folder.path().join("merged.toml"), text).unwrap();
        assert!(composed(&merged).0.is_empty());
    }
}
