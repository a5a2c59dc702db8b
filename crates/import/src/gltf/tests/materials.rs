//! Materials: every field, defaults of missing fields, and invalid values.

use lodestream_scene::asset::{Alpha, MAX_EMISSION, Material, SecondUv, Wrap};
use serde_json::{Value, json};

use super::Model;
use crate::{Channel, Component, Imported, ImportedMaterial, MaterialMaps, SurfaceMap};

/// A quad with texture coordinates, and a texture for each image `0.png` to `5.png` beside it.
pub(super) fn textured(material: Value) -> Model {
    let mut model = Model::quad();
    let uvs = model.floats("VEC2", 2, &[0., 0., 1., 0., 1., 1., 0., 1.]);
    model.attribute("TEXCOORD_0", uvs);
    model.json["images"] = (0..6).map(|i| json!({"uri": format!("{i}.png")})).collect();
    model.json["textures"] = (0..6).map(|i| json!({"source": i})).collect();
    model.json["materials"] = json!([material]);
    model.primitive()["material"] = json!(0);
    model
}

pub(super) fn read(model: &Model) -> (ImportedMaterial, Vec<String>) {
    let Imported { materials, warnings, .. } = model.read().unwrap();
    (materials[0].clone(), warnings)
}

fn converted(material: Value) -> ImportedMaterial {
    let (material, warnings) = read(&textured(material));
    assert!(warnings.is_empty(), "{warnings:?}");
    material
}

fn name(image: Option<&crate::ImageSource>) -> Option<String> {
    image.map(|image| image.path.file_name().unwrap().to_string_lossy().into_owned())
}

fn channel(channel: Option<&Channel>) -> (String, Component, bool, u16) {
    let channel = channel.unwrap();
    (name(Some(&channel.image)).unwrap(), channel.component, channel.inverted, channel.strength)
}

#[test]
fn every_field_has_its_place() {
    let ImportedMaterial { material, maps, .. } = converted(json!({
        "name": "brick",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 1, 0.25, 0.75], "metallicFactor": 0.25, "roughnessFactor": 0.5,
            "baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1},
        },
        "normalTexture": {"index": 2, "scale": 0.5},
        "occlusionTexture": {"index": 3, "strength": 0.5},
        "emissiveTexture": {"index": 4}, "emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8}},
        "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
    }));
    assert_eq!(material.base_color, [0.5, 1.0, 0.25, 0.75]);
    assert_eq!((material.metallic, material.roughness), (0.25, 0.5));
    assert_eq!(name(maps.color.as_ref()).as_deref(), Some("0.png"));
    assert_eq!(channel(maps.surface.occlusion.as_ref()), ("3.png".into(), Component::Red, false, 32_768));
    let whole = u16::MAX;
    assert_eq!(channel(maps.surface.roughness.as_ref()), ("1.png".into(), Component::Green, false, whole));
    assert_eq!(channel(maps.surface.metallic.as_ref()), ("1.png".into(), Component::Blue, false, whole));
    assert_eq!(name(maps.normal.as_ref()).as_deref(), Some("2.png"));
    assert_eq!(material.normal_scale, 0.5);
    assert_eq!(name(maps.emission.as_ref()).as_deref(), Some("4.png"));
    assert_eq!(material.emission, [8.0, 4.0, 0.0]);
    assert_eq!(material.alpha, Alpha::Mask(0.25));
    assert_eq!((material.unlit, material.wrap), (false, [Wrap::Repeat; 2]));
}

#[test]
fn missing_fields_have_the_formats_defaults() {
    let plain = converted(json!({"alphaMode": "MASK", "normalTexture": {"index": 0}})).material;
    assert_eq!((plain.metallic, plain.roughness, plain.normal_scale), (1.0, 1.0, 1.0));
    assert_eq!((plain.alpha, plain.emission), (Alpha::Mask(0.5), [0.0; 3]));
    // Also in a file without materials.
    let none = &Model::quad().read().unwrap().materials[0].material;
    assert_eq!((none.metallic, none.roughness, none.alpha), (1.0, 1.0, Alpha::Opaque));
    let blended =
        converted(json!({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5]}}));
    assert_eq!((blended.material.alpha, blended.material.base_color[3]), (Alpha::Blend, 0.5));
    let emissive = json!({"emissiveTexture": {"index": 4}});
    assert_eq!(converted(emissive).maps.emission, None, "a factor of zero makes it black");
}

#[test]
fn unlit_materials_have_their_colour_alone() {
    let mut model = textured(json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}},
        "normalTexture": {"index": 2}, "emissiveTexture": {"index": 3}, "emissiveFactor": [1, 1, 1],
        "extensions": {"KHR_materials_unlit": {}},
    }));
    model.json["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    model.json["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    let (ImportedMaterial { material, maps, .. }, warnings) = read(&model);
    assert!(material.unlit && warnings.is_empty(), "{warnings:?}");
    assert!(maps.color.is_some() && maps.surface.is_empty());
    assert_eq!((&maps.normal, &maps.emission), (&None, &None));
    assert_eq!(material.emission, [0.0; 3]);
}

#[test]
fn maps_of_a_third_kind_of_coordinates_are_left_out_by_name() {
    let turned = json!({"KHR_texture_transform": {"offset": [0.25, 0], "texCoord": 1}});
    let moved = json!({"KHR_texture_transform": {"offset": [0.5, 0]}});
    let mut model = textured(json!({
        "name": "wall",
        "normalTexture": {"index": 2, "extensions": turned},
        "occlusionTexture": {"index": 3},
        "emissiveTexture": {"index": 4, "extensions": moved}, "emissiveFactor": [1, 1, 1],
    }));
    let uvs = model.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"].clone();
    model.primitive()["attributes"]["TEXCOORD_1"] = uvs;
    let imported = model.read().unwrap();
    let ImportedMaterial { material, maps, .. } = &imported.materials[0];
    // Without a base colour texture, the first map determines the first set.
    assert!(maps.normal.is_some() && maps.surface.occlusion.is_some());
    assert_eq!(material.second_uv, SecondUv { surface: true, ..SecondUv::default() });
    assert_eq!((imported.mesh.uvs[0], imported.mesh.second_uvs[0]), ([0.25, 1.0], [0.0, 1.0]));
    assert!(maps.emission.is_none() && material.emission == [0.0; 3]);
    let [warning] = &imported.warnings[..] else { panic!("{:?}", imported.warnings) };
    for part in ["\"wall\"", "its emissive texture", "than its normal texture and its occlusion texture"] {
        assert!(warning.contains(part), "{warning:?} lacks {part:?}");
    }
}

/// A material with all five maps, of which those of `own` have the given texture coordinates.
fn five_maps(own: &[usize], coordinates: &Value) -> Model {
    let map = |number: usize| {
        let mut map = json!({"index": number});
        if own.contains(&number) {
            map.as_object_mut().unwrap().extend(coordinates.as_object().unwrap().clone());
        }
        map
    };
    let mut model = textured(json!({
        "name": "wall",
        "pbrMetallicRoughness": {"baseColorTexture": map(0), "metallicRoughnessTexture": map(1)},
        "normalTexture": map(2), "occlusionTexture": map(3),
        "emissiveTexture": map(4), "emissiveFactor": [1, 1, 1],
    }));
    let uvs = model.floats("VEC2", 2, &[0.5, 0., 1., 0., 1., 1., 0., 1.]);
    model.attribute("TEXCOORD_1", uvs);
    model
}

/// Which maps a material has: base colour, metal and roughness, normals, occlusion, emission.
fn there(maps: &MaterialMaps) -> [bool; 5] {
    let SurfaceMap { occlusion, roughness, metallic, .. } = &maps.surface;
    assert_eq!(roughness.is_some(), metallic.is_some());
    assert!(occlusion.is_none() || maps.occlusion.is_none());
    [
        maps.color.is_some(),
        roughness.is_some(),
        maps.normal.is_some(),
        occlusion.is_some() || maps.occlusion.is_some(),
        maps.emission.is_some(),
    ]
}

/// Each map with each kind of texture coordinates: another set, a transform, and a transform that names another set.
#[test]
fn each_map_may_have_coordinates_of_its_own() {
    let kinds = [
        json!({"texCoord": 1}),
        json!({"extensions": {"KHR_texture_transform": {"offset": [0.25, 0.5], "rotation": 0.5, "scale": [2, 3]}}}),
        json!({"extensions": {"KHR_texture_transform": {"texCoord": 1}}}),
    ];
    for kind in &kinds {
        let alone = five_maps(&[0, 1, 2, 3, 4], kind).read().unwrap().mesh.uvs;
        for number in 0..5 {
            let imported = five_maps(&[number], kind).read().unwrap();
            let ImportedMaterial { material, maps, .. } = &imported.materials[0];
            assert_eq!(there(maps), [true; 5], "{kind}");
            assert!(!imported.warnings.iter().any(|w| w.contains("left out")), "{:?}", imported.warnings);
            // The base colour comes first: if it is the odd one, all others use the second set.
            let second = [0, 1, 2, 3, 4].map(|i| (i == number) != (number == 0));
            let SecondUv { color, surface, normal, emission } = material.second_uv;
            let apart = maps.occlusion.is_some();
            assert_eq!([color, surface, normal, surface != apart, emission], second, "{kind}");
            let other = if number == 0 { &imported.mesh.uvs } else { &imported.mesh.second_uvs };
            assert_eq!(other, &alone, "{kind}");
        }
        // If all maps have the same coordinates, nothing is left out and the mesh has these coordinates.
        let alike = five_maps(&[0, 1, 2, 3, 4], kind).read().unwrap();
        assert_eq!(there(&alike.materials[0].maps), [true; 5], "{kind}");
        assert!(!alike.warnings.iter().any(|warning| warning.contains("left out")), "{:?}", alike.warnings);
        assert_ne!(alike.mesh.uvs[0], [0.0, 1.0], "{kind}");
        assert!(alike.mesh.second_uvs.is_empty(), "{kind}");
    }
}

/// Offset, rotation and scale apply in the order that the extension's specification states.
#[test]
fn transformations_turn_scale_and_move_in_the_extensions_order() {
    let (angle, scale, offset) = (0.5_f64, [2.0, 3.0], [0.25, 0.5]);
    let kind = json!({"extensions": {"KHR_texture_transform": {"offset": offset, "rotation": angle, "scale": scale}}});
    let imported = five_maps(&[0, 1, 2, 3, 4], &kind).read().unwrap();
    for (uv, [u, v]) in imported.mesh.uvs.iter().zip([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) {
        // The specification: uv' = translation · rotation · scale · uv, with GLSL's columns (cos, −sin), (sin, cos).
        let (x, y) = (u * scale[0], v * scale[1]);
        let want = [angle.cos() * x + angle.sin() * y, -angle.sin() * x + angle.cos() * y];
        let want = [want[0] + offset[0], 1.0 - (want[1] + offset[1])];
        assert!((0..2).all(|i| (f64::from(uv[i]) - want[i]).abs() < 1e-6), "{uv:?} {want:?}");
    }
}

/// Otherwise its maps would silently be drawn in one colour.
#[test]
fn a_mesh_without_the_coordinates_of_its_maps_is_named_once() {
    let mut model = textured(
        json!({"name": "wall", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}),
    );
    let again = model.primitive().clone();
    model.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(again);
    let imported = model.read().unwrap();
    let about = imported.warnings.iter().filter(|w| w.contains("has no TEXCOORD_1")).collect::<Vec<_>>();
    let [warning] = about[..] else { panic!("{:?}", imported.warnings) };
    for part in ["a.glb", "meshes[0].primitives[0]", "\"wall\"", "export the mesh with texture coordinates"] {
        assert!(warning.contains(part), "{warning:?} lacks {part:?}");
    }
    // There is no warning if no map needs coordinates.
    let plain = textured(json!({"name": "wall", "emissiveFactor": [1, 1, 1]}));
    assert!(!plain.read().unwrap().warnings.iter().any(|w| w.contains("has no TEXCOORD")));
    let mut bare = Model::quad();
    bare.json["materials"] = json!([{"name": "wall"}]);
    bare.primitive()["material"] = json!(0);
    assert!(bare.read().unwrap().warnings.is_empty());
}

#[test]
fn samplers_say_how_maps_continue() {
    let mut model = textured(json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "normalTexture": {"index": 1},
    }));
    model.json["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648}, {}]);
    model.json["textures"][0]["sampler"] = json!(0);
    model.json["textures"][1]["sampler"] = json!(0);
    let (material, warnings) = read(&model);
    assert_eq!(material.material.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert!(warnings.is_empty(), "{warnings:?}");
    model.json["textures"][1]["sampler"] = json!(1);
    let (material, warnings) = read(&model);
    assert_eq!(material.material.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert!(material.maps.normal.is_some());
    assert!(warnings[0].contains("its normal texture wraps differently"), "{warnings:?}");
    model.json["textures"][0]["sampler"] = json!(7);
    assert_eq!(read(&model).0.material.wrap, [Wrap::Repeat; 2]);
}

#[test]
fn values_out_of_range_are_brought_into_it() {
    for (value, unit, positive) in
        [(json!(-3), 0.0, 0.0), (json!(7), 1.0, 7.0), (json!(1e39), 1.0, MAX_EMISSION)]
    {
        let (ImportedMaterial { material, maps, .. }, _) = read(&textured(json!({
            "pbrMetallicRoughness":
                {"baseColorFactor": [value, value, value, value], "metallicFactor": value, "roughnessFactor": value},
            "emissiveFactor": [1, value, value],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": value}},
            "occlusionTexture": {"index": 0, "strength": value},
            "alphaMode": "BLEND",
        })));
        assert_eq!(material.base_color, [unit; 4], "{value}");
        assert_eq!((material.metallic, material.roughness), (unit, unit), "{value}");
        assert_eq!(material.emission[0], positive, "{value}");
        assert_eq!(maps.surface.is_empty(), unit == 0.0, "occlusion of strength 0 is none");
    }
    let mask = |cutoff: Value| {
        let material = read(&textured(json!({"alphaMode": "MASK", "alphaCutoff": cutoff}))).0.material;
        (material.alpha, material.base_color[3])
    };
    assert_eq!(mask(json!(-1)), (Alpha::Mask(0.0), 1.0));
    assert_eq!(mask(json!(1.5)), (Alpha::Mask(1.0), 0.0), "nothing of it is there");
    let scaled = |scale: Value| read(&textured(json!({"normalTexture": {"index": 0, "scale": scale}})));
    assert_eq!(scaled(json!(1e39)).0.material.normal_scale, 64.0);
    let (negative, warnings) = scaled(json!(-1));
    assert_eq!(negative.maps.normal, None);
    assert!(warnings[0].contains("scale below zero"), "{warnings:?}");
    let (unknown, warnings) = read(&textured(json!({"alphaMode": "GLASS"})));
    assert_eq!(unknown.material.alpha, Alpha::Opaque);
    assert!(warnings[0].contains("alphaMode"), "{warnings:?}");
    let infinite = json!({"KHR_texture_transform": {"scale": [1e39, 1]}});
    let (_, warnings) = read(&textured(
        json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": infinite}}}),
    ));
    assert!(warnings[0].contains("not finite"), "{warnings:?}");
    let odd = json!({"KHR_texture_transform": {"scale": "large"}});
    let (material, warnings) = read(&textured(json!({"normalTexture": {"index": 0, "extensions": odd}})));
    assert!(material.maps.normal.is_some());
    assert!(warnings[0].contains("KHR_texture_transform is not used"), "{warnings:?}");
}

#[test]
fn a_lost_map_does_not_make_everything_metal_or_light() {
    let (ImportedMaterial { material, .. }, warnings) = read(&textured(json!({
        "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 9}},
        "emissiveTexture": {"index": 9}, "emissiveFactor": [1, 1, 1],
    })));
    assert_eq!((material.metallic, material.emission), (0.0, [0.0; 3]));
    assert!(warnings[0].contains("textures[9] does not exist"), "{warnings:?}");
    assert!(warnings[0].contains("without its metallic-roughness texture"), "{warnings:?}");
}

#[test]
fn no_file_is_refused_for_its_materials() {
    let required = [
        "KHR_materials_anisotropy",
        "KHR_materials_clearcoat",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_iridescence",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_volume",
        "KHR_lights_punctual",
    ];
    for name in required {
        let mut model = textured(json!({"extensions": {name: {}}}));
        model.json["extensionsUsed"] = json!([name]);
        model.json["extensionsRequired"] = json!([name]);
        let (_, warnings) = read(&model);
        let understood =
            ["unlit", "emissive_strength", "ior", "specular", "clearcoat", "transmission", "punctual"]
                .iter()
                .any(|end| name.ends_with(end));
        assert_eq!(warnings.iter().any(|w| w.contains(name)), !understood, "{name}: {warnings:?}");
    }
}

#[test]
fn transmission_makes_thin_glass_and_glossiness_inverse_roughness() {
    let glass = |more: Value| {
        let (ImportedMaterial { material, .. }, _) =
            read(&textured(json!({"extensions": {"KHR_materials_transmission": more}})));
        (material.alpha, material.transmission)
    };
    assert_eq!(glass(json!({"transmissionFactor": 0.5})), (Alpha::Blend, 0.5));
    assert_eq!(glass(json!({"transmissionFactor": 3})), (Alpha::Blend, 1.0));
    assert_eq!(glass(json!({})), (Alpha::Opaque, 0.0));
    let mapped = json!({"transmissionFactor": 1, "transmissionTexture": {"index": 0}});
    assert_eq!(glass(mapped), (Alpha::Opaque, 0.0), "where it is transparent is not known");
    let glossy =
        |more: Value| read(&textured(json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": more}}))).0;
    let painted = glossy(json!({"diffuseFactor": [0.5, 0, 0, 1], "glossinessFactor": 0.75,
        "diffuseTexture": {"index": 1}}));
    let paint = &painted.material;
    assert_eq!((paint.base_color, paint.metallic, paint.roughness), ([0.5, 0.0, 0.0, 1.0], 0.0, 0.25));
    assert_eq!(name(painted.maps.color.as_ref()).as_deref(), Some("1.png"));
    let mapped = glossy(json!({"glossinessFactor": 0.5, "specularGlossinessTexture": {"index": 2}}));
    assert_eq!(mapped.material.roughness, 1.0);
    assert_eq!(
        channel(mapped.maps.surface.roughness.as_ref()),
        ("2.png".into(), Component::Alpha, true, 32_768)
    );
    assert_eq!(
        mapped.maps.surface,
        SurfaceMap { roughness: mapped.maps.surface.roughness.clone(), ..SurfaceMap::default() }
    );
    let gold = glossy(json!({"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1, 0.75, 0.25]})).material;
    let near = |a: [f32; 4], b: [f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
    assert!(near(gold.base_color, [1.0, 0.75, 0.25, 1.0]) && gold.metallic > 0.9999, "{gold:?}");
    // What reflects as little as no metal does stays as it is, but for what it reflects.
    let plaster = json!({"diffuseFactor": [0.5, 0.25, 0, 0.5], "specularFactor": [0.04, 0.04, 0.04]});
    let plaster = glossy(plaster).material;
    assert!(near(plaster.base_color, [0.5, 0.25, 0.0, 1.0]) && plaster.metallic < 1e-4, "{plaster:?}");
    // In between, metal reflects as much as before: 0.04 (1 − m) + base × m, and the rest is diffuse.
    let bronze = json!({"diffuseFactor": [0.25, 0.25, 0.25, 1], "specularFactor": [0.5, 0.5, 0.5]});
    let Material { base_color: [base, ..], metallic, .. } = glossy(bronze).material;
    let (reflected, diffuse) = (0.04 * (1.0 - metallic) + base * metallic, base * (1.0 - metallic) * 0.96);
    assert!((0.5..1.0).contains(&metallic) && (reflected - 0.5).abs() < 0.01, "{metallic} {base}");
    assert!((diffuse - 0.125).abs() < 0.05, "{diffuse}");
    let both = read(&textured(json!({
        "pbrMetallicRoughness": {"metallicFactor": 0.5},
        "extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 0, 1, 1]}},
    })));
    assert_eq!((both.0.material.base_color, both.0.material.metallic), ([1.0; 4], 0.5));
}
