//! OBJ files: what they are read to, and the errors of invalid ones.

use std::path::{Path, PathBuf};

use lodestream_geometry::mesh::NONE;
use tempfile::TempDir;

use super::{Imported, dependencies, import};

fn write(dir: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = dir.path().join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(&path, bytes).unwrap();
    path
}

fn read(obj: &str) -> Imported {
    let dir = TempDir::new().unwrap();
    import(&write(&dir, "a.obj", obj)).unwrap()
}

/// Asserts that the file is refused with one line that has every fragment.
fn refused(bytes: impl AsRef<[u8]>, fragments: &[&str]) {
    let dir = TempDir::new().unwrap();
    let path = write(&dir, "bad.obj", bytes);
    let message = import(&path).unwrap_err().to_string();
    assert!(!message.contains('\n'), "{message}");
    assert!(message.contains("bad.obj"), "{message}");
    for fragment in fragments {
        assert!(message.contains(fragment), "{message:?} lacks {fragment:?}");
    }
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

#[test]
fn polygons_become_triangles_and_equal_positions_one() {
    let mesh = read("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 0 -0\nv 2 0 0\nf 1 2 3 4\nf 5 6 3\n").mesh;
    assert_eq!(mesh.faces.len(), 3);
    assert_eq!(mesh.positions.len(), 5);
    assert_eq!(mesh.materials, [0, 0, 0]);
    assert!(mesh.faces.iter().flatten().all(|c| c.uv == NONE && c.normal == NONE));
}

#[test]
fn corners_without_uv_get_none_and_not_their_neighbours() {
    let mesh = read(&format!("{TRIANGLE}v 1 1 0\nvt 0.5 0.25\nf 1/1 2/1 3/1\nf 2 4 3\nf 1/1 2 4/1\n")).mesh;
    let has: Vec<bool> = mesh.faces.iter().map(|f| f.iter().all(|c| c.uv != NONE)).collect();
    assert_eq!(has, [true, false, false]);
    assert_eq!(mesh.uvs, [[0.5, 0.25]]);
}

#[test]
fn vertex_colours_are_read_where_there_are_any() {
    let text = "v 0 0 0 # white 1 1\nv 1 0 0 1 0 0.5\nv 0 1 0 0.2 0.4 2 0.5\nf 1 2 3\n";
    let imported = read(text);
    let mesh = imported.mesh;
    let of = |i: usize| mesh.colors.get(mesh.faces[0][i].color as usize).copied();
    assert_eq!([of(0), of(1), of(2)], [None, Some([255, 0, 128, 255]), Some([51, 102, 255, 128])]);
    assert!(
        imported.warnings[0].contains("1 vertices have colours outside 0 to 1"),
        "{:?}",
        imported.warnings
    );
    assert!(read(&format!("{TRIANGLE}f 1 2 3\n")).mesh.colors.is_empty());
}

#[test]
fn one_place_with_two_colours_is_one_position() {
    let mesh = read(
        "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nv 0 0 0 0 1 0\nv -1 0 0 0 1 0\nf 1 2 3\nf 4 3 5\n",
    )
    .mesh;
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.colors, [[255, 0, 0, 255], [0, 255, 0, 255]]);
    assert_eq!(mesh.faces[0][0].position, mesh.faces[1][0].position);
    assert_eq!([mesh.faces[0][0].color, mesh.faces[1][0].color], [0, 1]);
}

#[test]
fn objects_groups_and_materials_merge() {
    let dir = TempDir::new().unwrap();
    write(
        &dir,
        "sub/m.mtl",
        "newmtl red\nKd 1 0 0\nmap_Kd tex/red.png\nnewmtl unused\nnewmtl blue\nKd 0 0 1\n",
    );
    let path = write(
        &dir,
        "a.obj",
        format!(
            "mtllib sub/m.mtl\no one\n{TRIANGLE}usemtl blue\nf 1 2 3\no two\nv 0 0 1\nusemtl red\nf 1 2 4\ng x\nusemtl blue\nf -4 -2 -1\n"
        ),
    );
    let Imported { mesh, materials, warnings } = import(&path).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let names: Vec<&str> = materials.iter().map(|m| m.material.name.as_str()).collect();
    assert_eq!(names, ["blue", "red"]);
    assert_eq!(materials[1].maps.color, Some(dir.path().join("sub/tex/red.png").into()));
    let used: Vec<&str> = mesh.materials.iter().map(|&m| names[usize::from(m)]).collect();
    assert_eq!(used.len(), 3);
    for (face, name) in mesh.faces.iter().zip(used) {
        let z: f64 = face.iter().map(|c| mesh.positions[c.position as usize][2]).sum();
        let x: f64 = face.iter().map(|c| mesh.positions[c.position as usize][0]).sum();
        assert_eq!(name == "red", z > 0.0 && x > 0.0);
    }
    let files = dependencies(&path, &std::fs::read(&path).unwrap());
    // The picture is missing, and would be found beside the model too.
    assert_eq!(files, ["sub/m.mtl", "sub/tex/red.png", "red.png"].map(|name| dir.path().join(name)));
}

#[test]
fn models_cannot_name_files_outside_their_folder() {
    let dir = TempDir::new().unwrap();
    let secret = write(&dir, "secret.png", "a picture of somebody's");
    let absolute = secret.display().to_string();
    for (mtl, name) in [
        ("m.mtl", "../secret.png"),
        ("m.mtl", absolute.as_str()),
        ("m.mtl", "..\\secret.png"),
        ("sub/m.mtl", "../../secret.png"),
        ("m.mtl", "x/../../secret.png"),
    ] {
        let keywords = ["map_Kd", "map_Ke", "map_Pr", "map_Pm", "map_d", "norm", "disp"];
        let lines: String = keywords.map(|keyword| format!("{keyword} {name}\n")).concat();
        write(&dir, &format!("model/{mtl}"), format!("newmtl red\nKd 1 0 0\nPm 1\n{lines}"));
        let path = write(&dir, "model/a.obj", format!("mtllib {mtl}\n{TRIANGLE}usemtl red\nf 1 2 3\n"));
        let Imported { materials, warnings, .. } = import(&path).unwrap();
        assert_eq!(materials[0].maps.images().count(), 0, "{name}");
        let material = &materials[0].material;
        assert_eq!((material.metallic, material.emission), (0.0, [0.0; 3]), "{name}");
        assert_eq!(material.base_color[1], 0.0, "the rest of the material counts");
        assert!(warnings.iter().any(|w| w.contains("not in the model's folder")), "{name}: {warnings:?}");
        let files = dependencies(&path, &std::fs::read(&path).unwrap());
        assert_eq!(files, [dir.path().join("model").join(mtl)], "{name}");
    }
    // A path may go up as long as it stays within the folder.
    write(&dir, "model/sub/m.mtl", "newmtl red\nmap_Kd ../tex/red.png\n");
    let path = write(&dir, "model/a.obj", format!("mtllib sub/m.mtl\n{TRIANGLE}usemtl red\nf 1 2 3\n"));
    let Imported { materials, warnings, .. } = import(&path).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!(materials[0].maps.color, Some(dir.path().join("model/sub/../tex/red.png").into()));
    // Material files outside are not read either.
    write(&dir, "other.mtl", "newmtl red\nKd 1 0 0\n");
    let path = write(&dir, "model/a.obj", format!("mtllib ../other.mtl\n{TRIANGLE}usemtl red\nf 1 2 3\n"));
    let Imported { warnings, .. } = import(&path).unwrap();
    assert!(warnings.iter().any(|w| w.contains("not in the model's folder")), "{warnings:?}");
    assert!(dependencies(&path, &std::fs::read(&path).unwrap()).is_empty());
}

#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_a_file_is_refused() {
    let dir = TempDir::new().unwrap();
    for name in ["m.mtl", "red.png"] {
        let made = std::process::Command::new("mkfifo").arg(dir.path().join(name)).status();
        assert!(made.unwrap().success());
    }
    let path = write(&dir, "a.obj", format!("mtllib m.mtl\n{TRIANGLE}usemtl red\nf 1 2 3\n"));
    let Imported { warnings, .. } = import(&path).unwrap();
    assert!(warnings.iter().any(|w| w.contains("not a regular file")), "{warnings:?}");
    let picture = crate::texture::TextureSource::opaque(dir.path().join("red.png").into());
    assert!(crate::texture::load(&picture, Default::default(), &lodestream_geometry::pool::Serial).is_err());
}

#[test]
fn a_missing_mtl_is_a_warning_and_the_material_grey() {
    let imported = read(&format!("mtllib no such.mtl\n{TRIANGLE}usemtl x\nf 1 2 3\n"));
    assert_eq!(imported.materials.len(), 1);
    assert_eq!(imported.materials[0].material.base_color[..3], [crate::srgb::srgb_to_linear(0.8); 3]);
    assert!(imported.warnings.iter().any(|w| w.contains("such.mtl") && w.contains("cannot be read")));
    assert!(imported.warnings.iter().any(|w| w.contains("\"x\"")), "{:?}", imported.warnings);
}

#[test]
fn odd_but_legal_files_are_read() {
    // Byte-order mark, carriage returns, continued lines, weights, colours, comments at the end of
    // lines, one-dimensional textures, vertices after the faces that use them.
    let mesh = read(
        "\u{feff}# x\r\nf 1/1 2/1 \\\r\n  3/1 # the face\r\no late\r\nv 0 0 0 2\r\nv 2 0 0 2 # w\r\nv 0 1 0 1 0 0\r\nvt 0.5\r\n",
    )
    .mesh;
    assert_eq!(mesh.faces.len(), 1);
    assert_eq!(mesh.positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(mesh.uvs, [[0.5, 0.0]]);
    assert_eq!(read("v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r").mesh.faces.len(), 1);
}

#[test]
fn polylines_are_not_faces() {
    let imported = read(&format!("{TRIANGLE}v 5 5 5\nl 1 2 4\nf 1 2 3\np 4\nf 1 2\n"));
    assert_eq!(imported.mesh.faces.len(), 1);
    assert!(imported.warnings[0].contains("3 points, lines or faces"), "{:?}", imported.warnings);
}

#[test]
fn millimetres_survive_an_offset_of_ten_million() {
    let mesh = read("v 10000000.001 0 0\nv 10000000.002 0 0\nv 10000000.001 1 0\nf 1 2 3\n").mesh;
    assert_eq!(mesh.positions.len(), 3);
    assert_eq!(mesh.positions[0][0], 10_000_000.001);
}

#[test]
fn normals_are_made_unit_and_zero_ones_dropped() {
    let mesh = read(&format!("{TRIANGLE}vn 0 0 4\nvn 0 0 0\nf 1//1 2//1 3//2\n")).mesh;
    assert_eq!(mesh.normals, [[0.0, 0.0, 1.0]]);
    assert_eq!(mesh.faces[0].map(|c| c.normal), [0, 0, NONE]);
}

#[test]
fn a_missing_file_says_so() {
    let message = import(Path::new("/no/such/file.obj")).unwrap_err().to_string();
    assert!(message.contains("/no/such/file.obj: cannot be read"), "{message}");
}

#[test]
fn a_folder_says_so() {
    let dir = TempDir::new().unwrap();
    let message = import(dir.path()).unwrap_err().to_string();
    assert!(message.contains("not a regular file"), "{message}");
}

#[test]
fn empty_files_say_so() {
    refused("", &["is empty"]);
    refused("# nothing\n\n", &["has no faces", "only comments"]);
}

#[test]
fn points_and_lines_alone_say_so() {
    refused(format!("{TRIANGLE}p 1 2\nl 1 2 3\nf 1 2\n"), &["has no faces", "only 3 points or lines"]);
    refused(TRIANGLE, &["has no faces", "3 vertices"]);
}

#[test]
fn nan_and_huge_values_name_their_line() {
    refused(format!("{TRIANGLE}v 0 nan 0\nf 1 2 4\n"), &[":4: vertex", "nan", "finite"]);
    refused(format!("{TRIANGLE}v 1e39 0 0\nf 1 2 4\n"), &[":4: vertex", "1e39"]);
    refused(format!("{TRIANGLE}v 1 inf 0\nf 1 2 4\n"), &[":4: vertex", "inf"]);
    refused(format!("{TRIANGLE}v 1 1 1 0\nf 1 2 4\n"), &[":4: vertex divided by its weight"]);
    refused(format!("v 0 0 0\nv nan 0 0\n{TRIANGLE}v 0 0 inf\nf 3 4 6\n"), &[":7: face", "vertex 6"]);
    refused("v 1 2\nf 1 1 1\n", &[":1: vertex has 2 values"]);
    refused("v 1 2 x\nf 1 1 1\n", &[":1: vertex has \"x\""]);
}

#[test]
fn indices_out_of_range_name_their_line() {
    refused(format!("{TRIANGLE}f 1 2 4\n"), &[":4: face refers to vertex 4, but the file has 3"]);
    refused(format!("{TRIANGLE}f 1 2 0\n"), &[":4: face refers to vertex 0", "counts from 1"]);
    refused(format!("{TRIANGLE}f 1 2 -4\n"), &[":4: face refers to vertex -4", "only 3"]);
    // Must not wrap around.
    refused(
        format!("{TRIANGLE}f 1 2 -9223372036854775808\n"),
        &[":4: face refers to vertex -9223372036854775808"],
    );
    refused(format!("{TRIANGLE}vt 0 0\nf 1/1 2/x 3/1\n"), &[":5: face has \"x\"", "texture coordinate"]);
    refused(format!("{TRIANGLE}f 1 2 99999999999999999999\n"), &[":4: face has \"99999999999999999999\""]);
    refused(format!("{TRIANGLE}f 1 2 a\n"), &[":4: face has \"a\""]);
    refused(format!("{TRIANGLE}f 1/1/1/1 2 3\n"), &[":4: face"]);
}

#[test]
fn texture_coordinates_and_normals_that_do_not_exist_are_left_out_with_a_count() {
    let uvs = "vt 0 0\nvt 1 0\nvt nan 1\n";
    for bad in ["3/7", "3/-9", "3/0", "3/-9223372036854775808", "3/3"] {
        let Imported { mesh, warnings, .. } =
            read(&format!("{TRIANGLE}{uvs}f 1/1 2/2 {bad}\nf 1/1 2/1 3/2\n"));
        let has: Vec<bool> = mesh.faces.iter().map(|face| face.iter().all(|c| c.uv != NONE)).collect();
        assert_eq!(has, [false, true], "{bad}");
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(warning.contains("1 faces name texture coordinates that do not exist"), "{warning}");
    }
    let Imported { mesh, warnings, .. } = read(&format!(
        "{TRIANGLE}vn 1 0 0\nvn 0 0 inf\nf 1//1 2//1 3//7\nf 1//1 2//1 3//2\nf 1//1 2//1 3//1\n"
    ));
    // The file's normal, or that of the face.
    let normals: Vec<_> = mesh.faces.iter().map(|face| mesh.normals[face[0].normal as usize]).collect();
    assert_eq!(normals, [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]);
    assert!(warnings.len() == 1 && warnings[0].contains("2 faces name normals"), "{warnings:?}");
}

#[test]
fn a_few_bad_faces_are_left_out_and_the_first_named_by_its_line() {
    let good = "f 1 2 3\n".repeat(18);
    for (bad, why) in [
        ("f 1 2 9\nf x y z\n", ":4: face refers to vertex 9, but the file has 4"),
        ("f 1 2/a 3\nf 1 2 4\n", ":4: face has \"a\""),
        // A vertex further down.
        ("f 1 2 4\nf 1/1/1/1 2 3\n", ":5: face corner"),
    ] {
        let Imported { mesh, warnings, .. } = read(&format!("{TRIANGLE}{bad}{good}v nan 0 0\n"));
        assert_eq!(mesh.faces.len(), 18, "{bad}");
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(warning.contains(why) && warning.ends_with("2 such faces were left out"), "{warning}");
    }
    // One of a few.
    assert_eq!(read(&format!("{TRIANGLE}f 1 2 3\nf 1 2 9\n")).mesh.faces.len(), 1);
    // More than a tenth, and all.
    refused(
        format!("{TRIANGLE}{good}f 1 2 9\nf 1 2 9\nf 1 2 9\nf x y z\n"),
        &[":22: face refers to vertex 9"],
    );
    refused(format!("{TRIANGLE}f 1 2 9\n"), &[":4: face refers to vertex 9"]);
}

#[test]
fn numbers_of_vertices_that_no_face_uses_do_not_matter() {
    let Imported { mesh, warnings, .. } =
        read(&format!("v nan nan nan\nv 1 inf 0\nv x\nv 1 2\n{TRIANGLE}vt nan 0\nvn 1 2\nf -3 -2 -1\n"));
    assert_eq!((mesh.faces.len(), mesh.positions.len(), warnings.len()), (1, 3, 0), "{warnings:?}");
    assert_eq!(mesh.positions[1], [1.0, 0.0, 0.0]);
}

#[test]
fn utf_16_is_read_as_utf_8() {
    let text = format!("mtllib m.mtl\n{TRIANGLE}usemtl Grün\nf 1 2 3\n");
    let mtl = "newmtl Grün\nKd 0 1 0\nmap_Kd Grün.png\n";
    let in_utf_16 = |text: &str, of: fn(u16) -> [u8; 2]| -> Vec<u8> {
        ['\u{feff}'].into_iter().chain(text.chars()).collect::<String>().encode_utf16().flat_map(of).collect()
    };
    for of in [u16::to_le_bytes, u16::to_be_bytes] {
        let dir = TempDir::new().unwrap();
        write(&dir, "m.mtl", in_utf_16(mtl, of));
        let path = write(&dir, "a.obj", in_utf_16(&text, of));
        let Imported { mesh, materials, warnings } = import(&path).unwrap();
        assert_eq!((mesh.faces.len(), warnings.len()), (1, 0), "{warnings:?}");
        assert_eq!(materials[0].maps.color, Some(dir.path().join("Grün.png").into()));
        let files = dependencies(&path, &std::fs::read(&path).unwrap());
        assert_eq!(files, ["m.mtl", "Grün.png"].map(|name| dir.path().join(name)));
    }
}

#[test]
fn files_that_are_not_where_they_are_said_to_be_are_found_beside_the_model_by_name() {
    let dir = TempDir::new().unwrap();
    write(
        &dir,
        "Paint.MTL",
        "newmtl a\nmap_Kd C:\\art\\Wood.png\nmap_Ke /home/x/stone.jpg\nKe 1 1 1\nmap_d no.png\n",
    );
    for name in ["wood.PNG", "Stone.JPG", "STONE.jpg"] {
        write(&dir, name, name);
    }
    let path = write(&dir, "a.obj", format!("mtllib D:\\x\\paint.mtl\n{TRIANGLE}usemtl a\nf 1 2 3\n"));
    let Imported { materials, warnings, .. } = import(&path).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    let maps = &materials[0].maps;
    assert_eq!(maps.color, Some(dir.path().join("wood.PNG").into()));
    assert_eq!(maps.emission, Some(dir.path().join("STONE.jpg").into()), "the first of two");
    let files = dependencies(&path, &std::fs::read(&path).unwrap());
    assert_eq!(files, ["Paint.MTL", "wood.PNG", "no.png", "STONE.jpg"].map(|name| dir.path().join(name)));
}

#[test]
fn several_material_files_of_one_line_are_all_read() {
    let dir = TempDir::new().unwrap();
    write(&dir, "a.mtl", "newmtl a\nKd 1 0 0\n");
    write(&dir, "b.mtl", "newmtl b\nKd 1 0 0\n");
    for line in ["a.mtl b.mtl", "a.mtl lost/b.mtl", "lost/A.MTL lost\\b.mtl"] {
        let faces = "usemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\n";
        let path = write(&dir, "a.obj", format!("mtllib {line}\n{TRIANGLE}{faces}"));
        let Imported { materials, warnings, .. } = import(&path).unwrap();
        assert_eq!((materials.len(), warnings.len()), (2, 0), "{line}: {warnings:?}");
    }
}

/// Elements after white space that only Unicode defines must be read, not only counted.
#[test]
fn elements_after_unicode_spaces_are_read() {
    let dir = TempDir::new().unwrap();
    for space in ["\u{b}", "\u{a0}", "\u{2003}", "\u{3000} "] {
        let text = format!("{TRIANGLE}{space}vn 0 0 1\n{space}vt 0 1\nf 1/1/1 2/1/1 3/1/1\n");
        let mesh = import(&write(&dir, "spaced.obj", text)).unwrap().mesh;
        assert_eq!((mesh.faces.len(), mesh.uvs.len(), mesh.normals.len()), (1, 1, 1), "{space:?}");
    }
}

#[test]
fn random_bytes_are_refused_without_panic() {
    let mut state = 0x2545_F491_4F6C_DD1Du64;
    let mut bytes = Vec::new();
    for _ in 0..1 << 13 {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        bytes.extend(state.to_le_bytes());
    }
    refused(&bytes, &["zero byte", "not text"]);
    bytes.retain(|&b| b != 0);
    refused(&bytes, &["is it an OBJ file?"]);
    // Random sequences of the format's keywords: an error or a mesh, never a panic.
    let words = [
        "v", "vt", "vn", "f", "usemtl", "\n", "\n", "\\\n", "1", "-1", "2/1", "1//1", "0.5", "nan", "#", "/",
    ];
    for seed in 0..500u64 {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut text = TRIANGLE.to_owned();
        for _ in 0..200 {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            text.push_str(words[(state >> 33) as usize % words.len()]);
            text.push(' ');
        }
        let dir = TempDir::new().unwrap();
        let _ = import(&write(&dir, "noise.obj", text));
    }
}
