//! Extensions of materials: what is shown of them, and the warning of the rest.

use lodestream_scene::asset::{Alpha, ClearCoat, Specular};
use serde_json::{Value, json};

use super::Model;
use super::materials::textured;

#[test]
fn extensions_of_materials_that_are_left_out_are_named_once_with_the_number_of_materials() {
    let mut model = Model::quad();
    let layers =
        json!({"KHR_materials_sheen": {"sheenRoughnessFactor": 1}, "KHR_materials_ior": {"ior": 1.3}});
    let glass = json!({"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.5},
        "KHR_materials_volume": {}, "KHR_materials_unlit": {}, "FB_of_its_own": {}});
    model.json["materials"] = json!([{"extensions": layers}, {"extensions": layers}, {"extensions": glass}]);
    // Listed or not.
    model.json["extensionsUsed"] = json!(["KHR_materials_ior", "KHR_materials_transmission"]);
    let [warning] = &model.read().unwrap().warnings[..] else { panic!() };
    let expected = "ignored: extension KHR_materials_sheen (2), extension KHR_materials_volume";
    assert!(warning.ends_with(expected), "{warning}");
}

#[test]
fn index_of_refraction_and_specular_factors_become_reflectances() {
    let read = |extensions: Value| super::materials::read(&textured(json!({"extensions": extensions})));
    let near = |got: Specular, f0: [f32; 3], f90: f32| {
        assert!([0, 1, 2].iter().all(|&c| (got.f0[c] - f0[c]).abs() < 1e-6), "{got:?} {f0:?}");
        assert!((got.f90 - f90).abs() < 1e-6, "{got:?} {f90}");
    };
    let of = |extensions: Value| {
        let (imported, warnings) = read(extensions);
        assert_eq!(warnings, [""; 0]);
        imported.material.specular
    };
    near(of(json!({})), [0.04; 3], 1.0);
    near(of(json!({"KHR_materials_ior": {"ior": 2}})), [1.0 / 9.0; 3], 1.0);
    near(of(json!({"KHR_materials_ior": {"ior": 1}})), [0.0; 3], 1.0);
    near(of(json!({"KHR_materials_ior": {"ior": 0}})), [1.0; 3], 1.0);
    let tinted = json!({"specularFactor": 0.5, "specularColorFactor": [1, 0.5, 30]});
    near(of(json!({"KHR_materials_specular": tinted})), [0.02, 0.01, 0.5], 0.5);
    let both = json!({"KHR_materials_specular": tinted, "KHR_materials_ior": {"ior": 3}});
    near(of(both), [0.125, 0.0625, 0.5], 0.5);
    // What has no meaning is as if it were not there.
    let odd =
        json!({"KHR_materials_ior": {"ior": 0.5}, "KHR_materials_specular": {"specularFactor": "much"}});
    near(of(odd), [0.04; 3], 1.0);
    near(
        of(json!({"KHR_materials_specular": {"specularFactor": 7}, "KHR_materials_unlit": {}})),
        [0.04; 3],
        1.0,
    );
    let mapped =
        json!({"specularFactor": 0.5, "specularTexture": {"index": 0}, "specularColorTexture": {"index": 0}});
    let (imported, warnings) = read(json!({"KHR_materials_specular": mapped}));
    near(imported.material.specular, [0.02; 3], 0.5);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    let expected = "ignored: extension KHR_materials_specular.specularColorTexture, extension \
                    KHR_materials_specular.specularTexture";
    assert!(warning.ends_with(expected), "{warning}");
}

#[test]
fn clear_coats_keep_their_factors_and_leave_their_textures_out() {
    let read = |coat: Value| {
        let extensions = json!({"KHR_materials_clearcoat": coat});
        let (imported, warnings) = super::materials::read(&textured(json!({"extensions": extensions})));
        (imported.material.clear_coat, warnings)
    };
    let coat = |factor, roughness| (ClearCoat { factor, roughness }, Vec::new());
    assert_eq!(read(json!({"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25})), coat(0.5, 0.25));
    assert_eq!(read(json!({"clearcoatFactor": 1})), coat(1.0, 0.0));
    assert_eq!(read(json!({"clearcoatRoughnessFactor": 0.5})), coat(0.0, 0.5));
    assert_eq!(read(json!({"clearcoatFactor": 5, "clearcoatRoughnessFactor": []})), coat(1.0, 0.0));
    let texture = json!({"index": 0});
    let (mapped, warnings) = read(json!({"clearcoatFactor": 1, "clearcoatTexture": texture,
        "clearcoatRoughnessTexture": texture, "clearcoatNormalTexture": texture}));
    assert_eq!(mapped.factor, 1.0);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    for left_out in ["clearcoatNormalTexture", "clearcoatRoughnessTexture", "clearcoatTexture"] {
        assert!(warning.contains(&format!("KHR_materials_clearcoat.{left_out}")), "{warning}");
    }
}

#[test]
fn transmission_is_left_out_by_holes_and_where_a_texture_has_it() {
    let read = |more: Value| {
        let mut material = json!({"extensions": {"KHR_materials_transmission": more}});
        material["alphaMode"] = json!("MASK");
        super::materials::read(&textured(material))
    };
    let (imported, warnings) = read(json!({"transmissionFactor": 1}));
    assert_eq!((imported.material.alpha, imported.material.transmission), (Alpha::Mask(0.5), 0.0));
    assert!(warnings[0].contains("its transmission is left out"), "{warnings:?}");
    let (_, warnings) = read(json!({"transmissionFactor": 1, "transmissionTexture": {"index": 0}}));
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(warning.ends_with("extension KHR_materials_transmission.transmissionTexture"), "{warning}");
}
