//! What batches cost: never more bytes than assets with instances, and no more error than the settings allow.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec3, Vec3};
use lodestream_geometry::pack::{BlobKind, Entry};
use tempfile::TempDir;

use super::batch_tests::{Glb, sheet, street};
use super::of_files_with;
use crate::preparation_settings::{Precision, PreparationSettings};
use crate::prepare::{Cached, Options, prepare_all};

fn prepared(model: &Path, cache: &Path, preparation_settings: PreparationSettings) -> Vec<Cached> {
    let options = Options { preparation_settings, quiet: true, ..Options::default() };
    let scene = of_files_with(&[model.to_owned()], &preparation_settings).unwrap();
    prepare_all(&scene.assets, cache, &options, |_, _| {}).unwrap()
}

#[test]
fn packs_of_batches_are_no_larger_than_those_of_assets_with_instances() {
    let dir = TempDir::new().unwrap();
    let mut copies = Glb::default();
    for i in 0..200 {
        // Each of five shapes stands in forty places.
        let place = DVec3::new(f64::from(i / 5) * 2.0, f64::from(i % 5) * 2.0, 0.0);
        let mesh =
            copies.mesh(&sheet(6, f64::from(i % 5)).into_iter().map(|p| p + place).collect::<Vec<_>>());
        copies.node(mesh, [0.0; 3]);
    }
    let mut large = Glb::default();
    for i in 0..34 {
        let mesh = large.mesh(&sheet(16, f64::from(i)));
        large.node(mesh, [f64::from(i) * 2.0, 0.0, 0.0]);
    }
    let mut textured = street(|i| i as f64 / 50.0, 100);
    let mut textured_copies = Glb::default();
    let materials: Vec<usize> = (0..4).map(|seed| textured.textured(seed)).collect();
    let of_copies: Vec<usize> = (0..4).map(|seed| textured_copies.textured(seed)).collect();
    for mesh in 0..100 {
        // Up to two repeats, from another corner of the texture each.
        let uv = |p: &DVec3| [p.x as f32 * 2.0 + mesh as f32 / 100.0, p.y as f32];
        textured.dress(mesh, materials[mesh % 4], sheet(4, 0.0).iter().map(uv));
    }
    for i in 0..120 {
        // Each of four shapes stands in thirty places.
        let corners = sheet(6, (i % 4) as f64);
        let place = DVec3::new((i / 4) as f64 * 2.0, (i % 4) as f64 * 2.0, 0.0);
        let mesh = textured_copies.mesh(&corners.iter().map(|&p| p + place).collect::<Vec<_>>());
        textured_copies.dress(mesh, of_copies[i % 4], corners.iter().map(|p| [p.x as f32, p.y as f32]));
        textured_copies.node(mesh, [0.0; 3]);
    }
    let inputs = [
        ("copies", copies),
        ("different", street(|i| i as f64 / 50.0, 100)),
        ("large", large),
        ("textured", textured),
        ("textured copies", textured_copies),
    ];
    for (name, glb) in inputs {
        let model = glb.write(&dir.path().join(format!("{name}.glb")));
        let bytes = |batching: &str| -> u64 {
            let settings =
                PreparationSettings { batching: batching.parse().ok(), ..PreparationSettings::default() };
            let cached = prepared(&model, &dir.path().join(batching), settings);
            // Copies share a pack, and textures are sent once.
            let packs: BTreeMap<_, _> =
                cached.iter().map(|cached| (cached.pack.path(), &cached.pack)).collect();
            let mut textures: BTreeMap<_, u64> = BTreeMap::new();
            let mut geometry = 0;
            for pack in packs.values() {
                let bytes_of = |wanted: u16| -> u64 {
                    let of = |entry: &&Entry| matches!(entry.kind, BlobKind::Texture { texture, .. } if texture == wanted);
                    pack.entries().iter().filter(of).map(|entry| u64::from(entry.length)).sum()
                };
                let own: Vec<_> = pack.textures().into_iter().map(|(n, hash)| (hash, bytes_of(n))).collect();
                geometry += pack.total_bytes() - own.iter().map(|(_, bytes)| bytes).sum::<u64>();
                textures.extend(own);
            }
            assert_eq!(textures.len(), if name.starts_with("textured") { 4 } else { 0 });
            geometry + textures.values().sum::<u64>()
        };
        let (auto, off) = (bytes("auto"), bytes("off"));
        assert!(auto <= off, "{name}: {auto} bytes in batches, {off} in assets");
    }
}

#[test]
fn vertices_of_a_batch_are_within_an_absolute_tolerance() {
    let dir = TempDir::new().unwrap();
    let model = street(|i| i as f64 / 50.0, 40).write(&dir.path().join("street.glb"));
    let source: Vec<DVec3> = (0..40_u32)
        .flat_map(|i| {
            let place = DVec3::X * 3.0 * f64::from(i);
            // As the file has them, in f32.
            sheet(4, f64::from(i) / 50.0).into_iter().map(move |p| p.as_vec3().as_dvec3() + place)
        })
        .collect();
    for tolerance in [0.02, 0.001] {
        let precision = Precision::Tolerance(tolerance.to_string().parse().unwrap());
        let settings = PreparationSettings { precision: Some(precision), ..PreparationSettings::default() };
        let cached = prepared(&model, &dir.path().join("cache"), settings);
        assert_eq!(cached.len(), 1);
        let pack = cached[0].pack.load().unwrap();
        let mesh = pack.refined(&pack.everything()).unwrap();
        let origin = DVec3::from(mesh.grid().origin);
        let found: Vec<DVec3> =
            mesh.surface().0.iter().map(|&at| origin + Vec3::from(at).as_dvec3()).collect();
        let nearest = |from: &[DVec3], to: DVec3| {
            from.iter().map(|p| (*p - to).abs().max_element()).fold(f64::MAX, f64::min)
        };
        let largest = source.iter().map(|&at| nearest(&found, at)).fold(0.0, f64::max);
        // f32 positions relative to the origin of 120 units have 4e-6 of rounding.
        assert!(largest <= tolerance + 1e-5, "{largest} above {tolerance}");
        assert!(largest > tolerance / 100.0, "the grid is as coarse as it may be: {largest}");
    }
}
