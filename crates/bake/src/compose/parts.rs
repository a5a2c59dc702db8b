//! What the parts of a scene's instances are called.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

use lodestream_scene::description::Instance;
use lodestream_scene::parts::PartInfo;
use lodestream_store::{PartBlobs, PartBlobsError};

use crate::scene::Scene;

/// Encodes what the parts of `instances` are called, which are sent in the order `order`. Records are in the order of the
/// files, where neighbours have similar names; instances of one model share them.
pub(super) fn blobs(
    scene: &Scene,
    instances: &[Instance],
    order: &[usize],
) -> Result<PartBlobs, PartBlobsError> {
    let sources = sources(scene);
    let models = instances.iter().enumerate().map(|(at, _)| sources.get(at).map(|(model, _)| *model));
    // First record of each model that is placed.
    let mut first: BTreeMap<u32, u32> = models.flatten().map(|model| (model, 0)).collect();
    let mut count = 0_u32;
    for (model, first) in &mut first {
        *first = count;
        let names = scene.models.get(*model as usize).map_or(0, |model| model.part_names.len());
        count = count.checked_add(names).ok_or(PartBlobsError::TooMany)?;
    }
    let mut unknown: BTreeMap<u32, u32> = BTreeMap::new();
    let mut records: Vec<Range<u32>> = Vec::with_capacity(instances.len());
    for (at, instance) in instances.iter().enumerate() {
        let of_model = sources.get(at).and_then(|(model, part)| {
            let range = scene.models.get(*model as usize)?.part_names.of_instance(*part as usize)?;
            let first = *first.get(model)?;
            Some(first + range.start..first + range.end)
        });
        records.push(match of_model {
            Some(range) => range,
            // Called as its asset.
            None => {
                let next = count.checked_add(unknown.len() as u32).ok_or(PartBlobsError::TooMany)?;
                let record = *unknown.entry(instance.asset).or_insert(next);
                record..record.checked_add(1).ok_or(PartBlobsError::TooMany)?
            }
        });
    }
    let ordered: Vec<Range<u32>> = order.iter().map(|&at| records[at].clone()).collect();
    let of_several = scene.models.len() > 1;
    let named = first.keys().filter_map(|model| scene.models.get(*model as usize));
    let named = named.flat_map(|model| model.part_names.infos(of_several));
    let mut by_record: Vec<(u32, u32)> = unknown.into_iter().map(|(asset, record)| (record, asset)).collect();
    by_record.sort_unstable();
    let of_assets = by_record.into_iter().map(|(_, asset)| PartInfo {
        name: scene.assets.get(asset as usize).map(|asset| asset.name.clone()).unwrap_or_default(),
        ..PartInfo::default()
    });
    PartBlobs::new(&ordered, named.chain(of_assets))
}

/// Model and part of each instance, as [`Scene::instance_parts`]: of models side by side, one after the other.
pub(super) fn sources(scene: &Scene) -> Cow<'_, [(u32, u32)]> {
    if scene.instances.is_some() {
        return Cow::Borrowed(&scene.instance_parts);
    }
    let models = (0_u32..).zip(&scene.models);
    let parts =
        models.flat_map(|(number, model)| (0..model.parts.len() as u32).map(move |part| (number, part)));
    Cow::Owned(parts.collect())
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::path::Path;

    use lodestream_scene::description::AssetEntry;
    use lodestream_scene::parts::{PartTable, decode_directory, decode_record, records_of};
    use lodestream_scene::placement::Placement;
    use lodestream_scene::{BlobId, PartBlob};
    use serde_json::json;

    use crate::compose::compose;
    use crate::scene::{Scene, of_files};

    use super::*;

    /// What a part is called, as a client finds out.
    fn look_up(blobs: &PartBlobs, instances: u32, instance: u32, part: u32) -> Option<PartInfo> {
        let table = blobs.table().unwrap();
        let page = instance / lodestream_scene::parts::INSTANCES_PER_PAGE;
        let runs = decode_directory(
            blobs.get(PartBlob::DirectoryPage(page)).unwrap(),
            PartTable::on_directory_page(instances, page),
            table.records,
        );
        let record = records_of(&runs.unwrap(), instance % 1024)?.nth(part as usize)?;
        let bytes = blobs.get(PartBlob::Page(record / 256)).unwrap();
        decode_record(bytes, table.on_page(record / 256), record % 256).unwrap()
    }

    /// A file whose meshes are placed so often each, by nodes below "site" and "floor".
    fn write(path: &Path, uses: &[usize]) {
        let triangle = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let bytes: Vec<u8> = triangle.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let uri = format!("data:application/octet-stream;base64,{}", data_encoding::BASE64.encode(&bytes));
        let mut nodes = vec![json!({"name": "site", "children": [1]}), json!({"name": "floor"})];
        let mut children = Vec::new();
        for (mesh, &count) in uses.iter().enumerate() {
            for copy in 0..count {
                children.push(nodes.len());
                let at = [4.0 * mesh as f64, 3.0 * copy as f64, 0.0];
                nodes.push(json!({
                    "mesh": mesh, "name": format!("part {mesh}.{copy}"), "translation": at,
                    "extras": {"mesh": mesh, "copy": copy},
                }));
            }
        }
        nodes[1]["children"] = json!(children);
        let accessor = json!({
            "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3,
            "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0],
        });
        // Blended meshes are in no batch.
        let mesh = |&count: &usize| json!({"primitives": [{"attributes": {"POSITION": 0}, "material": usize::from(count > 1)}]});
        let meshes: Vec<_> = uses.iter().map(mesh).collect();
        let file = json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
            "meshes": meshes, "materials": [{}, {"alphaMode": "BLEND"}], "accessors": [accessor],
            "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
            "buffers": [{"byteLength": bytes.len(), "uri": uri}],
        });
        std::fs::write(path, file.to_string()).unwrap();
    }

    fn composed(scene: &Scene) -> (PartBlobs, Vec<Instance>, Vec<usize>) {
        let entries: Vec<AssetEntry> = scene
            .assets
            .iter()
            .map(|asset| AssetEntry { name: asset.name.clone(), ..AssetEntry::default() })
            .collect();
        let description = compose(scene, &entries, &[]).unwrap();
        let instances = description.pages.iter().flat_map(|page| page.instances.clone()).collect();
        (description.parts, instances, description.asset_order)
    }

    #[test]
    fn members_of_a_batch_and_instances_have_the_names_of_their_nodes() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("house.gltf");
        // 300 meshes that are placed once become a batch; one is placed three times.
        let uses: Vec<usize> = (0..301).map(|mesh| if mesh == 7 { 3 } else { 1 }).collect();
        write(&file, &uses);
        let scene = of_files(&[file]).unwrap();
        let (blobs, instances, asset_order) = composed(&scene);
        assert_eq!((instances.len(), blobs.table()), (4, Some(PartTable { records: 303 })));
        let (mut batches, mut copies) = (0, Vec::new());
        for (number, instance) in (0..).zip(&instances) {
            let called = |part| look_up(&blobs, 4, number, part);
            if scene.assets[asset_order[instance.asset as usize]].name == "house/parts" {
                batches += 1;
                for part in 0..300 {
                    let mesh = if part < 7 { part } else { part + 1 };
                    let info = called(part).unwrap();
                    let extras = format!("{{\"copy\":0,\"mesh\":{mesh}}}");
                    assert_eq!((info.name, &*info.path), (format!("part {mesh}.0"), "site/floor"));
                    assert_eq!((info.extras, info.in_file), (Some(extras), Placement::default()));
                }
                assert_eq!(called(300), None);
            } else {
                let copy = (instance.placement.translation[1] / 3.0) as u32;
                copies.push(copy);
                let info = called(0).unwrap();
                assert_eq!((info.name, info.in_file), (format!("part 7.{copy}"), instance.placement));
                assert_eq!(called(1), None);
            }
        }
        copies.sort_unstable();
        assert_eq!((batches, copies), (1, vec![0, 1, 2]));
        let bytes: usize = blobs.all().map(bytes::Bytes::len).sum();
        assert!(bytes <= 303 * 28, "{bytes} bytes for 303 parts");
    }

    #[test]
    fn in_a_scene_of_several_models_paths_begin_with_the_model_and_copies_share_records() {
        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join("house.gltf"), &[1, 1]);
        std::fs::write(folder.path().join("tree.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        let mut text = String::from(
            "[[asset]]\nname = \"town hall\"\nfile = \"house.gltf\"\n[[asset]]\nname = \"tree\"\nfile = \"tree.obj\"\n",
        );
        for (x, asset) in ["tree", "town hall", "tree", "town hall"].iter().enumerate() {
            let _ = write!(text, "[[instance]]\nasset = \"{asset}\"\ntranslation = [{}, 0, 0]\n", 100 * x);
        }
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text).unwrap();
        let (blobs, instances, _) = composed(&of_files(&[path]).unwrap());
        assert_eq!((instances.len(), blobs.table()), (6, Some(PartTable { records: 3 })));
        for (number, instance) in (0..).zip(&instances) {
            let info = look_up(&blobs, 6, number, 0).unwrap();
            let [x, ..] = instance.placement.translation;
            // The scene moves the hall, not its parts within it.
            let expected = match x as u32 {
                0 | 200 => ("tree".to_owned(), "", 0.0),
                x => (format!("part {}.0", x % 100 / 4), "town hall/site/floor", f64::from(x % 100)),
            };
            assert_eq!((info.name, &*info.path, info.in_file.translation[0]), expected, "at {x}");
        }
    }

    #[test]
    fn names_belong_to_the_fingerprint_and_instances_of_unknown_origin_are_called_as_their_asset() {
        let mut scene = Scene::of_models(&["a.obj".into()]).unwrap();
        scene.instances = Some(vec![Instance::at(0, [0.0; 3]); 2]);
        let (blobs, ..) = composed(&scene);
        assert_eq!(blobs.table(), Some(PartTable { records: 1 }));
        assert_eq!(look_up(&blobs, 2, 1, 0).unwrap().name, "a");
        assert!(blobs.get(PartBlob::Page(1)).is_none() && BlobId::part_page(1).asset().is_none());
        let fingerprint =
            |scene: &Scene| compose(scene, &[AssetEntry::default()], &[]).unwrap().fingerprint();
        let before = fingerprint(&scene);
        scene.assets[0].name = "b".into();
        assert_ne!(fingerprint(&scene), before);
    }
}
