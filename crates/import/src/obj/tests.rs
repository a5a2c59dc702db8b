//! UDIM texture sets.

use std::fmt::Write as _;
use std::path::PathBuf;

use lodestream_scene::asset::Wrap;
use tempfile::TempDir;

use super::*;
use crate::model::{ImageSource, Imported};
use crate::srgb::srgb_to_linear;

const SET: &str = "newmtl skin\nmap_Kd -bm 1 maps/skin.<UDIM>.png\nmap_Pm metal.<UDIM>.png\nnorm bumps.png\n\
                   newmtl plain\nmap_Kd plain.png\n";

/// The text of an OBJ file of unit squares, each with a material and the corner of its square of coordinates.
fn squares(squares: &[(&str, f64, f64)]) -> String {
    let mut text = "mtllib m.mtl\n".to_owned();
    for (i, (material, u, v)) in squares.iter().enumerate() {
        let _ = writeln!(text, "usemtl {material}");
        for (x, y) in [(0., 0.), (1., 0.), (1., 1.), (0., 1.)] {
            let _ = writeln!(text, "v {x} {y} {i}\nvt {} {}", u + x, v + y);
        }
        text.push_str("f -4/-4 -3/-3 -2/-2 -1/-1\n");
    }
    text
}

struct Model {
    dir: TempDir,
}

impl Model {
    /// A model with these images, of one texel each.
    fn new(mtl: &str, images: &[&str]) -> Self {
        let this = Self { dir: TempDir::new().unwrap() };
        std::fs::write(this.path("m.mtl"), mtl).unwrap();
        for image in images {
            std::fs::create_dir_all(this.path(image).parent().unwrap()).unwrap();
            image::RgbImage::new(1, 1).save(this.path(image)).unwrap();
        }
        this
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn read(&self, text: &str) -> Result<Imported, ImportError> {
        std::fs::write(self.path("a.obj"), text).unwrap();
        crate::import(&self.path("a.obj"))
    }
}

const ALL: [&str; 6] = [
    "maps/skin.1001.png",
    "maps/skin.1012.png",
    "metal.1001.png",
    "metal.1012.png",
    "bumps.png",
    "plain.png",
];

#[test]
fn each_tile_that_faces_use_becomes_a_material_with_coordinates_from_0_to_1() {
    let model = Model::new(SET, &ALL);
    let text = squares(&[
        ("plain", 3.0, 0.0),
        ("skin", 1.0, 1.0),
        ("skin", 0.0, 0.0),
        // Across four tiles; most of it is in the first.
        ("skin", 0.25, 0.25),
        ("skin", 1.0, 1.0),
    ]);
    let imported = model.read(&text).unwrap();
    assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    let names: Vec<&str> = imported.materials.iter().map(|of| of.material.name.as_str()).collect();
    assert_eq!(names, ["plain", "skin.1012", "skin.1001"]);
    assert_eq!(imported.mesh.materials, [0, 0, 1, 1, 2, 2, 2, 2, 1, 1]);
    let [plain, far, near] = &imported.materials[..] else { panic!("{names:?}") };
    let image = |name: &str| Some(ImageSource::from(model.path(name)));
    assert_eq!((&plain.maps.color, plain.material.wrap), (&image("plain.png"), [Wrap::Repeat; 2]));
    assert_eq!((&far.maps.color, far.material.wrap), (&image("maps/skin.1012.png"), [Wrap::Clamp; 2]));
    assert_eq!(near.maps.color, image("maps/skin.1001.png"));
    assert_eq!(near.maps.surface.metallic.as_ref().map(|c| c.image.clone()), image("metal.1001.png"));
    assert_eq!((&far.maps.normal, &near.maps.normal), (&image("bumps.png"), &image("bumps.png")));
    assert_eq!((far.material.metallic, near.material.metallic), (1.0, 1.0));
    let uvs = |face: usize| imported.mesh.faces[face].map(|corner| imported.mesh.uvs[corner.uv as usize]);
    assert!(uvs(0).contains(&[3.0, 0.0]), "coordinates of other materials stay");
    for face in [2, 3, 4, 5, 8, 9] {
        assert!(uvs(face).iter().flatten().all(|x| *x == 0.0 || *x == 1.0), "{face}: {:?}", uvs(face));
    }
    assert!(uvs(6).contains(&[0.25, 0.25]) && uvs(6).contains(&[1.25, 1.25]), "{:?}", uvs(6));
}

#[test]
fn a_face_belongs_to_the_tile_of_its_centroid() {
    let model = Model::new(SET, &ALL);
    for (corner, tile) in [(0.4, 1001), (0.6, 1012)] {
        let imported = model.read(&squares(&[("skin", corner, corner)])).unwrap();
        assert_eq!(imported.materials[0].material.name, format!("skin.{tile}"));
    }
    // Without coordinates a face shows the first tile.
    let imported = model.read("mtllib m.mtl\nusemtl skin\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert_eq!(imported.materials[0].material.name, "skin.1001");
}

#[test]
fn missing_tiles_are_counted_and_drawn_without_their_images() {
    let model = Model::new(SET, &["maps/skin.1001.png", "metal.1001.png", "metal.1002.png", "bumps.png"]);
    let text = squares(&[("skin", 0.0, 0.0), ("skin", 1.0, 0.0), ("skin", 2.0, 0.0), ("skin", 2.0, 0.0)]);
    let imported = model.read(&text).unwrap();
    let [warning] = &imported.warnings[..] else { panic!("{:?}", imported.warnings) };
    for part in ["a.obj", "3 of 6 images of UDIM tiles are missing", "skin.1002.png"] {
        assert!(warning.contains(part), "{warning:?} lacks {part:?}");
    }
    let grey = srgb_to_linear(0.8);
    let shown = |i: usize| {
        let ImportedMaterial { material, maps, .. } = &imported.materials[i];
        (maps.color.is_some(), maps.normal.is_some(), material.base_color[0], material.metallic)
    };
    assert_eq!(
        [shown(0), shown(1), shown(2)],
        [(true, true, 1.0, 1.0), (false, true, grey, 1.0), (false, true, grey, 0.0)]
    );
}

#[test]
fn faces_outside_of_all_tiles_are_counted() {
    let model = Model::new(SET, &ALL);
    let outside = [("skin", -1.0, 0.0), ("skin", 10.0, 0.0), ("skin", 0.0, -1.0), ("skin", 9.0, 899.0)];
    let imported = model.read(&squares(&outside)).unwrap();
    let [warning] = &imported.warnings[..] else { panic!("{:?}", imported.warnings) };
    assert!(warning.contains("4 faces are outside of the UDIM tiles"), "{warning}");
    let [only] = &imported.materials[..] else { panic!("{} materials", imported.materials.len()) };
    assert_eq!((only.material.name.as_str(), &only.maps.color), ("skin", &None));
    assert_eq!(only.material.wrap, [Wrap::Repeat; 2]);
    assert!(only.maps.normal.is_some());
    // The last tile that has a number.
    let last = model.read(&squares(&[("skin", 8.0, 899.0)])).unwrap();
    assert_eq!(last.materials[0].material.name, "skin.9999");
}

#[test]
fn the_images_of_the_tiles_that_faces_use_are_dependencies() {
    let model = Model::new(SET, &[]);
    let text = squares(&[("skin", 1.0, 1.0), ("skin", 0.0, 0.0), ("skin", -1.0, 0.0), ("plain", 5.0, 0.0)]);
    let files = dependencies(&model.path("a.obj"), text.as_bytes());
    let names = ["m.mtl", "plain.png", "bumps.png", "maps/skin.1001.png", "maps/skin.1012.png"];
    let names = names.into_iter().chain(["metal.1001.png", "metal.1012.png"]);
    assert_eq!(files, names.map(|name| model.path(name)).collect::<Vec<_>>());
    // Faces that cannot be read have no tiles.
    let files = dependencies(&model.path("a.obj"), b"mtllib m.mtl\nf 1 2 3\n");
    assert_eq!(files.len(), 3);
}

#[test]
fn more_tiles_than_materials_are_possible_are_refused() {
    let model = Model::new(SET, &[]);
    let many: Vec<_> = (0..=MAX_MATERIALS).map(|i| ("skin", (i % 10) as f64, (i / 10) as f64)).collect();
    let message = model.read(&squares(&many)).unwrap_err().to_string();
    assert!(message.contains("uses 4097 materials; at most 4096"), "{message}");
}

#[test]
fn a_set_outside_of_the_models_folder_is_left_out() {
    let model = Model::new("newmtl skin\nmap_Kd ../skin.<UDIM>.png\n", &[]);
    let imported = model.read(&squares(&[("skin", 1.0, 0.0)])).unwrap();
    assert_eq!(imported.materials[0].maps.color, None);
    assert!(imported.warnings[0].contains("not in the model's folder"), "{:?}", imported.warnings);
}
