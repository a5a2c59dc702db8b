//! Every field and map, missing files, and files of another type than their name says.

use std::path::PathBuf;

use image::{GrayImage, Luma, Rgb, RgbImage};
use lodestream_geometry::pool::Serial;
use lodestream_import::{Channel, Component, HeightMap, ImageSource, MaterialMaps, SurfaceMap};
use lodestream_scene::asset::Wrap;
use tempfile::TempDir;

use super::*;

#[test]
fn a_textured_material_names_its_blobs() {
    let dir = TempDir::new().unwrap();
    let (color, height) = (dir.path().join("c.png"), dir.path().join("h.png"));
    RgbImage::from_pixel(32, 16, Rgb([9, 200, 30])).save(&color).unwrap();
    GrayImage::from_fn(64, 64, |x, y| Luma([(x * y) as u8])).save(&height).unwrap();
    let brick = ImportedMaterial {
        material: Material { name: "brick".repeat(99), base_color: [1.0; 4], ..Material::default() },
        maps: MaterialMaps {
            color: Some(color.into()),
            height: Some(HeightMap { image: height.into(), scale: 0.5 }),
            ..MaterialMaps::default()
        },
        ..ImportedMaterial::default()
    };
    let again = ImportedMaterial { maps: brick.maps.clone(), ..ImportedMaterial::named("same") };
    let described = describe("wall", &[brick, again], &PreparationSettings::default(), &Serial).unwrap();
    assert!(described.warnings.is_empty(), "{:?}", described.warnings);
    let AssetDescription { materials, textures, .. } = &described.description;
    assert_eq!(materials[0].name.len(), MAX_NAME_BYTES);
    assert_eq!(materials[0].relief_depth, DEFAULT_RELIEF_DEPTH / 2.0);
    assert_eq!(materials[1].base_color_texture, Some(0));
    assert_eq!(textures.len(), 2);
    assert_eq!(
        textures[0].levels.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>(),
        [(8, 4), (16, 8), (32, 16)]
    );
    assert_eq!(textures.iter().map(|texture| texture.mean).collect::<Vec<_>>(), [Some([9, 200, 30]), None]);
    for (info, blobs) in textures.iter().zip(&described.textures) {
        let lengths: Vec<usize> = info.levels.iter().map(|l| l.bytes as usize).collect();
        assert_eq!(lengths, blobs.iter().map(|images| images[0].len()).collect::<Vec<_>>());
    }
    let deep = PreparationSettings { relief_depth: ReliefDepth::try_from(0.3).ok(), ..Default::default() };
    let fixed = describe("wall", &[ImportedMaterial::default()], &deep, &Serial).unwrap();
    assert_eq!(fixed.description.materials[0].relief_depth, 0.0);
}

#[test]
fn a_missing_texture_is_a_warning_and_a_colour() {
    let material = ImportedMaterial {
        material: Material { base_color: [1.0; 4], ..Material::default() },
        maps: MaterialMaps { color: Some(PathBuf::from("/no/brick.png").into()), ..MaterialMaps::default() },
        ..ImportedMaterial::default()
    };
    let described = describe("wall", &[material], &PreparationSettings::default(), &Serial).unwrap();
    assert_eq!(described.warnings.len(), 1);
    assert!(described.warnings[0].contains("/no/brick.png: cannot be read"), "{:?}", described.warnings);
    let shown = &described.description.materials[0];
    assert_eq!(shown.base_color_texture, None);
    assert_eq!(shown.base_color[0], srgb_to_linear(0.8));
}

fn image(dir: &TempDir, name: &str, color: [u8; 3]) -> ImageSource {
    let path = dir.path().join(name);
    RgbImage::from_pixel(8, 8, Rgb(color)).save(&path).unwrap();
    path.into()
}

#[test]
fn every_field_and_map_is_described() {
    let dir = TempDir::new().unwrap();
    let rough = image(&dir, "r.png", [9, 102, 51]);
    let material = ImportedMaterial {
        material: Material {
            base_color: [0.8, 0.8, 0.8, 0.5],
            roughness: 0.25,
            metallic: 0.75,
            emission: [1.0, 2.0, 3.0],
            alpha: Alpha::Mask(0.25),
            unlit: true,
            wrap: [Wrap::Clamp, Wrap::Mirror],
            normal_scale: 2.0,
            ..Material::default()
        },
        maps: MaterialMaps {
            color: Some(image(&dir, "c.png", [1, 2, 3])),
            surface: SurfaceMap {
                occlusion: None,
                roughness: Some(Channel::plain(rough.clone(), Component::Green)),
                metallic: Some(Channel::plain(rough, Component::Blue)),
            },
            normal: Some(image(&dir, "n.png", [128, 128, 255])),
            emission: Some(image(&dir, "e.png", [200, 100, 0])),
            ..MaterialMaps::default()
        },
        ..ImportedMaterial::default()
    };
    let described =
        describe("a", &[material.clone(), material], &PreparationSettings::default(), &Serial).unwrap();
    assert!(described.warnings.is_empty(), "{:?}", described.warnings);
    let AssetDescription { materials, textures, .. } = described.description;
    assert_eq!(materials[0], materials[1]);
    let shown = &materials[0];
    assert_eq!((shown.base_color[3], shown.roughness, shown.metallic), (0.5, 0.25, 0.75));
    assert_eq!((shown.emission, shown.alpha, shown.unlit), ([1.0, 2.0, 3.0], Alpha::Mask(0.25), true));
    assert_eq!((shown.wrap, shown.normal_scale), ([Wrap::Clamp, Wrap::Mirror], 2.0));
    let kind = |index: Option<u16>| textures[usize::from(index.unwrap())].kind;
    let maps =
        [shown.base_color_texture, shown.surface_texture, shown.normal_texture, shown.emission_texture];
    let kinds = [TextureKind::Color, TextureKind::Surface, TextureKind::Normal, TextureKind::Color];
    assert_eq!(maps.map(kind), kinds);
    assert_eq!(textures.len(), 4, "each once");
    let means: Vec<_> = textures.iter().map(|texture| texture.mean).collect();
    assert_eq!(means, [Some([1, 2, 3]), Some([255, 102, 51]), None, Some([200, 100, 0])]);
}

#[test]
fn a_lost_map_does_not_make_everything_metal_or_light() {
    let dir = TempDir::new().unwrap();
    let lost = || ImageSource::from(dir.path().join("none.png"));
    let material = ImportedMaterial {
        material: Material { metallic: 1.0, emission: [1.0; 3], ..Material::default() },
        maps: MaterialMaps {
            surface: SurfaceMap {
                roughness: Some(Channel::plain(image(&dir, "r.png", [0, 7, 0]), Component::Green)),
                metallic: Some(Channel::plain(lost(), Component::Blue)),
                occlusion: None,
            },
            emission: Some(lost()),
            normal: Some(lost()),
            ..MaterialMaps::default()
        },
        ..ImportedMaterial::default()
    };
    let described = describe("a", &[material], &PreparationSettings::default(), &Serial).unwrap();
    assert_eq!(described.warnings.len(), 1, "once a file: {:?}", described.warnings);
    let shown = &described.description.materials[0];
    assert_eq!((shown.metallic, shown.emission, shown.normal_texture), (0.0, [0.0; 3], None));
    assert!(shown.surface_texture.is_some(), "roughness is still there");
}

#[test]
fn a_normal_map_where_heights_belong_is_drawn_as_one() {
    let dir = TempDir::new().unwrap();
    let bump = image(&dir, "b.png", [128, 127, 255]);
    let height = Some(HeightMap { image: bump, scale: 0.5 });
    let material = ImportedMaterial {
        maps: MaterialMaps { height, ..MaterialMaps::default() },
        ..ImportedMaterial::default()
    };
    let described =
        describe("a", std::slice::from_ref(&material), &PreparationSettings::default(), &Serial).unwrap();
    assert!(described.warnings.is_empty(), "{:?}", described.warnings);
    let shown = &described.description.materials[0];
    assert_eq!((shown.height_texture, shown.normal_texture, shown.normal_scale), (None, Some(0), 0.5));
    assert_eq!(described.description.textures[0].kind, TextureKind::Normal);
    // A material with a normal map ignores it.
    let mut both = material;
    both.maps.normal = Some(image(&dir, "n.png", [128, 128, 255]));
    let described = describe("a", &[both], &PreparationSettings::default(), &Serial).unwrap();
    assert!(described.warnings[0].contains("looks like a normal map"), "{:?}", described.warnings);
    assert_eq!(described.description.textures.len(), 1);
}

#[test]
fn opacity_maps_say_whether_they_are_masks() {
    let dir = TempDir::new().unwrap();
    let alpha = |name: &str, value: &dyn Fn(u32) -> u8| {
        let path = dir.path().join(name);
        GrayImage::from_fn(16, 16, |x, _| Luma([value(x)])).save(&path).unwrap();
        let opacity = Some(Channel::plain(path.into(), Component::Mask));
        let material = ImportedMaterial {
            maps: MaterialMaps { opacity, ..MaterialMaps::default() },
            alpha_from_map: true,
            ..ImportedMaterial::default()
        };
        describe("a", &[material], &PreparationSettings::default(), &Serial).unwrap().description.materials[0]
            .alpha
    };
    assert_eq!(alpha("holes.png", &|x| if x < 8 { 0 } else { 255 }), Alpha::Mask(0.5));
    assert_eq!(alpha("graded.png", &|x| x as u8 * 16), Alpha::Blend);
    assert_eq!(alpha("white.png", &|_| 255), Alpha::Opaque);
}

#[test]
fn a_plain_material_takes_11_bytes() {
    let plain = ImportedMaterial::named("m");
    let bytes = describe("a", &[plain], &PreparationSettings::default(), &Serial)
        .unwrap()
        .description
        .encode()
        .unwrap();
    // Name, one material of 11 bytes and its name, no texture.
    assert_eq!(bytes.len(), 2 + 1 + 11 + 1 + 1, "{bytes:?}");
}
