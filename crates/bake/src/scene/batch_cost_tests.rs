//! What batches cost: never more bytes than assets with instances, and no more error than the settings allow.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec3, Vec3};
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
    let inputs = [("copies", copies), ("different", street(|i| i as f64 / 50.0, 100)), ("large", large)];
    for (name, glb) in inputs {
        let model = glb.write(&dir.path().join(format!("{name}.glb")));
        let bytes = |batching: &str| -> u64 {
            let settings =
                PreparationSettings { batching: batching.parse().ok(), ..PreparationSettings::default() };
            let cached = prepared(&model, &dir.path().join(batching), settings);
            // Copies share a pack.
            let packs: BTreeMap<_, _> =
                cached.iter().map(|cached| (cached.pack.path(), cached.pack.total_bytes())).collect();
            packs.values().sum()
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
