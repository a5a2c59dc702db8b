use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};
use tempfile::TempDir;

use super::header::NumberType;
use crate::{ImportError, Imported, import};

/// How a model of some vertices and polygons is written.
#[derive(Clone, Copy)]
struct As {
    /// "ascii" or a binary format.
    format: &'static str,
    /// Types of coordinates, of the lengths of lists, and of indices.
    place: &'static str,
    length: &'static str,
    index: &'static str,
    /// Type of colours.
    color: &'static str,
}

const PLAIN: As = As { format: "ascii", place: "float", length: "uchar", index: "int", color: "uchar" };
const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

/// Position, normal, colour in units of 1/8, texture coordinates.
type Vertex = ([i8; 3], [i8; 3], [u8; 3], [f32; 2]);

/// A box of quads and a concave roof, with a normal, colour and texture coordinates per vertex.
fn model() -> (Vec<Vertex>, Vec<Vec<usize>>) {
    let mut vertices = Vec::new();
    for n in 0..8_i8 {
        let place = [n & 1, n >> 1 & 1, n >> 2].map(|x| 10 * x);
        let color = [n as u8, 8 - n as u8, 3];
        vertices.push((place, [0, 0, if n < 4 { -1 } else { 1 }], color, [f32::from(n) / 8.0, 0.25]));
    }
    for (x, z) in [(0, 20), (5, 26), (10, 20), (5, 22)] {
        vertices.push(([x, 5, z], [0, -1, 0], [1, 2, 3], [f32::from(x) / 16.0, 0.5]));
    }
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut faces: Vec<Vec<usize>> = quads.map(Vec::from).into();
    faces.push(vec![8, 11, 10, 9]);
    faces.push(vec![0, 1, 8]);
    (vertices, faces)
}

fn number(out: &mut Vec<u8>, format: &str, kind: &str, value: f64) {
    let mut bytes = match kind {
        "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
        "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
        "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    match format {
        "ascii" => out.extend(format!("{value} ").bytes()),
        "binary_big_endian" => {
            bytes.reverse();
            out.extend(bytes);
        }
        _ => out.extend(bytes),
    }
}

/// The model as PLY, with ignored elements and properties in between and at the end.
fn ply(of: As) -> Vec<u8> {
    let (vertices, faces) = model();
    let As { format, place, length, index, color } = of;
    let mut out = format!(
        "ply\nformat {format} 1.0\ncomment made for a test\nobj_info of no use\nelement vertex {}\nproperty {place} x\n\
         property {place} y\nproperty uchar flags\nproperty {place} z\nproperty list uchar short tags\nproperty float nx\n\
         property float ny\nproperty float nz\nproperty {color} red\nproperty {color} green\nproperty {color} blue\n\
         property float s\nproperty float t\nelement face {}\nproperty float area\nproperty list {length} {index} \
         vertex_indices\nelement edge 2\nproperty int vertex1\nproperty int vertex2\nend_header\n",
        vertices.len(),
        faces.len()
    )
    .into_bytes();
    let end = |out: &mut Vec<u8>| {
        if format == "ascii" {
            out.push(b'\n')
        }
    };
    let whole = NumberType::named(color).unwrap().unit_value();
    for (at, normal, rgb, uv) in vertices {
        let mut put = |kind, value| number(&mut out, format, kind, value);
        put(place, at[0].into());
        put(place, at[1].into());
        put("uchar", 7.0);
        put(place, at[2].into());
        put("uchar", 2.0);
        put("short", -5.0);
        put("short", 5.0);
        normal.iter().for_each(|x| put("float", (*x).into()));
        rgb.iter().for_each(|x| {
            let share = f64::from(*x) * 17.0 / 255.0 * whole;
            put(color, if NumberType::named(color).unwrap().is_integer() { share.round() } else { share });
        });
        uv.iter().for_each(|x| put("float", (*x).into()));
        end(&mut out);
    }
    for face in faces {
        number(&mut out, format, "float", 1.5);
        number(&mut out, format, length, face.len() as f64);
        face.iter().for_each(|&corner| number(&mut out, format, index, corner as f64));
        end(&mut out);
    }
    for n in 0..2 {
        number(&mut out, format, "int", n.into());
        number(&mut out, format, "int", 3.0);
        end(&mut out);
    }
    out
}

fn obj() -> String {
    let (vertices, faces) = model();
    let mut out = String::new();
    for ([x, y, z], _, rgb, _) in &vertices {
        let [r, g, b] = rgb.map(|x| f64::from(x) * 17.0 / 255.0);
        out += &format!("v {x} {y} {z} {r} {g} {b}\n");
    }
    for (_, [x, y, z], _, [u, v]) in &vertices {
        out += &format!("vn {x} {y} {z}\nvt {u} {v}\n");
    }
    for face in &faces {
        out += "f";
        face.iter().for_each(|corner| out += &format!(" {0}/{0}/{0}", corner + 1));
        out += "\n";
    }
    out
}

fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Imported, ImportError> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    import(&path)
}

/// The error for a file, without the file's name.
fn refused(bytes: impl AsRef<[u8]>) -> String {
    let why = read("a.ply", bytes).unwrap_err().to_string();
    assert_eq!(why.lines().count(), 1, "{why}");
    why.split_once("a.ply").unwrap().1.to_owned()
}

/// Triangles in order, each corner by its values, since indices may differ between readers.
fn values(mesh: &SourceMesh) -> Vec<String> {
    let corner = |c: &Corner| {
        let of = |index: u32| (index != NONE).then_some(index as usize);
        format!(
            "{:?} {:?} {:?} {:?}",
            mesh.positions[c.position as usize],
            of(c.uv).map(|i| mesh.uvs[i]),
            of(c.normal).map(|i| mesh.normals[i]),
            of(c.color).map(|i| mesh.colors[i])
        )
    };
    mesh.faces.iter().map(|face| face.each_ref().map(corner).join(", ")).collect()
}

#[test]
fn every_format_and_type_gives_the_mesh_of_the_obj() {
    let expected = read("a.obj", obj()).unwrap();
    let places = ["char", "uint8", "short", "uint16", "int", "uint32", "float", "float64"];
    let integers = ["int8", "uchar", "int16", "ushort", "int32", "uint"];
    for format in FORMATS {
        let with = |as_: As, what: &str| {
            let found = read("a.PLY", ply(As { format, ..as_ })).unwrap();
            assert_eq!(values(&found.mesh), values(&expected.mesh), "{format} {what}");
            assert_eq!(found.mesh.positions.len(), expected.mesh.positions.len(), "{format} {what}");
            assert_eq!(found.materials, expected.materials);
            assert_eq!(found.warnings.len(), 1, "{:?}", found.warnings);
            assert!(["flags", "tags", "area", "edge"].iter().all(|name| found.warnings[0].contains(name)));
        };
        places.iter().for_each(|place| with(As { place, ..PLAIN }, place));
        integers.iter().for_each(|length| with(As { length, ..PLAIN }, length));
        integers.iter().for_each(|index| with(As { index, ..PLAIN }, index));
        ["uchar", "ushort", "uint", "float", "double"].iter().for_each(|c| with(As { color: c, ..PLAIN }, c));
    }
}

#[test]
fn a_file_cut_short_anywhere_is_refused_with_a_place() {
    for format in FORMATS {
        let whole = ply(As { format, ..PLAIN });
        // The last line end may be missing.
        let least = whole.trim_ascii_end().len();
        for length in 0..if format == "ascii" { least } else { whole.len() } {
            let why = read("a.ply", &whole[..length]).unwrap_err().to_string();
            let told = [
                "line",
                "truncated",
                "end_header",
                "is empty",
                "not a PLY file",
                "numbers",
                "not a number",
                "not a count",
            ];
            assert!(told.iter().any(|word| why.contains(word)), "{format}, {length} bytes: {why}");
        }
    }
}

fn head(rest: &str) -> String {
    format!("ply\nformat ascii 1.0\n{rest}")
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z\n";
const FACE: &str = "element face 1\nproperty list uchar int vertex_index\n";

#[test]
fn false_headers_are_refused_before_memory_is_reserved() {
    let many = head(&format!("element vertex 4000000000\n{XYZ}{FACE}end_header\n0 0 0\n"));
    let why = refused(many);
    assert!(why.starts_with(":3: ") && why.contains("at least 24000000000 bytes, but 6 follow"), "{why}");
    let binary = format!("ply\nformat binary_little_endian 1.0\nelement vertex 3\n{XYZ}{FACE}end_header\n");
    let mut list = binary.clone().into_bytes();
    list.extend([0; 36]);
    list.extend([255, 0, 0, 0, 0]);
    let why = refused(&list);
    assert!(
        why.contains("face 0, before byte") && why.contains("a list of 255 numbers, but 4 bytes"),
        "{why}"
    );
    assert!(refused(binary.replace(" 3\n", " 99999999999\n")).contains("are supported"));
    assert!(refused(head(&format!("element vertex 1\n{XYZ}"))).contains("no line end_header"));
    assert!(refused(head(&"comment x\n".repeat(40_000))).contains("no line end_header within 262144 bytes"));
}

#[test]
fn errors_name_the_line() {
    let vertices = format!("element vertex 3\n{XYZ}");
    let good = head(&format!("{vertices}{FACE}end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"));
    assert_eq!(read("a.ply", &good).unwrap().mesh.faces.len(), 1);
    for (from, to, why) in [
        ("ply\n", "plx\n", ":1: is not a PLY file"),
        ("ascii", "octal", ":2: there is no format \"octal\""),
        ("format ascii 1.0\n", "", "names no format"),
        ("1.0", "2.0", "is not one of format (version 1.0)"),
        ("element vertex 3\n", "", ":3: a property of no element"),
        ("float x", "real x", ":4: there is no type \"real\""),
        ("float x", "float w", ":3: vertices have no property \"x\""),
        ("uchar int", "float int", ":8: the list \"vertex_index\" has a length that is not an integer"),
        ("uchar int", "uchar float", ":7: face has no list vertex_indices of integers"),
        ("vertex_index", "corners", ":7: face has no list vertex_indices of integers"),
        ("1 0 0", "1 0", ":11: vertex 1: the line has fewer numbers"),
        ("1 0 0", "1 o 0", ":11: vertex 1: \"o\" is not a number"),
        ("1 0 0", "1 nan 0", ":11: vertex 1: a position, normal or coordinate is not finite"),
        ("1 0 0", "1 1e39 0", ":11: vertex 1: a position"),
        ("3 0 1 2", "3 0 1 3", ":13: face 0: there is no vertex 3: there are 3"),
        ("3 0 1 2", "3 0 1 -2", "there is no vertex -2"),
        ("3 0 1 2", "3 0 1 0.5", "there is no vertex 0.5"),
        ("3 0 1 2", "-3 0 1 2", "a list of -3 numbers"),
        ("3 0 1 2", "2 0 1", ": has no faces (3 vertices, 1 faces with fewer than 3 corners)"),
        ("3 0 1 2\n", "\n\n", ":15: face 0: the file ends before it: it is truncated"),
    ] {
        let bad = good.replacen(from, to, 1);
        assert_ne!(bad, good, "{from}");
        let told = refused(&bad);
        assert!(told.contains(why), "{why:?} is not in {told:?}");
    }
    let early = head(&format!("{FACE}{vertices}end_header\n3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n"));
    assert!(refused(early).contains("write vertices first"));
    assert!(refused("").contains("is empty"));
}

#[test]
fn strips_are_triangles_that_all_turn_the_same_way() {
    let strip = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let places = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n5 0 0\n6 0 0\n5 1 0\n";
    let text = head(&format!("element vertex 7\n{XYZ}{strip}{places}8 0 1 2 3 -1 4 5 6\n"));
    let mesh = read("a.ply", text).unwrap().mesh;
    assert_eq!(mesh.faces.len(), 3);
    for face in &mesh.faces {
        let [a, b, c] = face.map(|corner| mesh.positions[corner.position as usize]);
        assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0, "{face:?}");
    }
}

#[test]
fn vertices_at_one_place_are_one_and_unused_ones_none() {
    let places = "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n0 0 0 9 9\n1 0 0 9 8\n0 -1 0 8 8\n50 50 50 0 0\n";
    let properties = format!("{XYZ}property float texture_u\nproperty float texture_v\n");
    let faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
    let text = head(&format!("element vertex 7\n{properties}{faces}{places}3 0 1 2\n3 4 3 5\n"));
    let mesh = read("a.ply", text).unwrap().mesh;
    assert_eq!((mesh.positions.len(), mesh.uvs.len(), mesh.faces.len()), (4, 6, 2));
}

#[test]
fn colours_beyond_their_range_are_clamped_and_left_out_under_a_texture() {
    let colors = "property float red\nproperty float green\nproperty float blue\nproperty uchar alpha\n";
    let text = head(&format!(
        "comment TextureFile my map.png\nelement vertex 3\n{XYZ}{colors}{FACE}end_header\n0 0 0 2 0.5 0 51\n1 0 0 nan 0 0 \
         255\n0 1 0 1 1 1 255\n3 0 1 2\n"
    ));
    let found = read("a.ply", text.replace("TextureFile", "made of")).unwrap();
    assert_eq!(found.mesh.colors, [[255, 128, 0, 51], [0, 0, 0, 255], [255; 4]]);
    let told = found.warnings.join("\n");
    assert!(told.contains("2 vertices have colours"), "{told}");
    let found = read("a.ply", text).unwrap();
    assert!(found.materials[0].maps.color.as_ref().unwrap().path.ends_with("my map.png"));
    assert!(found.mesh.faces[0].iter().all(|corner| corner.color == NONE), "the texture shows them");
}

#[test]
fn more_numbers_than_declared_and_comments_and_blank_lines_are_read_with_a_warning_each() {
    let lines = "0 0 0 0.5 1\n\n# a note\n1 0 0 0.5 1\ncomment 7 8 9\n0 1 0 0.5 1\n  \n3 0 1 2\n";
    let text = head(&format!("element vertex 3\n{XYZ}{FACE}end_header\n{lines}"));
    let found = read("a.ply", text).unwrap();
    assert_eq!(found.mesh.positions, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let [excess, comments] = &found.warnings[..] else { panic!("{:?}", found.warnings) };
    assert!(excess.contains("3 lines have more") && excess.contains("line 10"), "{excess}");
    assert!(comments.contains("2 comments") && comments.contains("line 12"), "{comments}");
}

/// Two triangles in one quad, with texture coordinates in the lists of the faces.
fn textured(names: &[&str], faces: &str, properties: &str) -> String {
    let names: String = names.iter().map(|name| format!("comment TextureFile {name}\n")).collect();
    let face = format!("element face 2\nproperty list uchar int vertex_indices\n{properties}end_header\n");
    head(&format!("{names}element vertex 4\n{XYZ}{face}0 0 0\n1 0 0\n1 1 0\n0 1 0\n{faces}"))
}

const TEXCOORD: &str = "property list uchar float texcoord\n";

#[test]
fn a_texture_is_laid_by_the_coordinates_of_faces() {
    let faces = "3 0 1 2 6 0 0 1 0 1 0.5\n3 0 2 3 6 0.25 0 1 1 0 1\n";
    let found = read("a.ply", textured(&["skin of it.png"], faces, TEXCOORD)).unwrap();
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
    let uvs: Vec<[f32; 2]> =
        found.mesh.faces.iter().flatten().map(|corner| found.mesh.uvs[corner.uv as usize]).collect();
    assert_eq!(uvs, [[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.25, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let [material] = &found.materials[..] else { panic!("{:?}", found.materials) };
    assert!(material.maps.color.as_ref().unwrap().path.ends_with("skin of it.png"));
    assert_eq!(material.material.base_color, [1.0; 4]);
    // A list that does not fit its face gives it no coordinates.
    let found =
        read("a.ply", textured(&["a.png"], "3 0 1 2 0\n3 0 2 3 6 0 0 nan 1 0 1\n", TEXCOORD)).unwrap();
    assert!(found.mesh.faces.iter().flatten().all(|corner| corner.uv == NONE));
    // Without a texture they are skipped.
    let found = read("a.ply", textured(&[], faces, TEXCOORD)).unwrap();
    assert!(found.mesh.uvs.is_empty() && found.warnings[0].contains("texcoord of face"));
}

#[test]
fn several_textures_are_chosen_by_the_numbers_of_faces() {
    let properties = format!("{TEXCOORD}property int texnumber\n");
    let of = |first: &str, second: &str| {
        let faces = format!("3 0 1 2 6 0 0 1 0 1 1 {first}\n3 0 2 3 6 0 0 1 1 0 1 {second}\n");
        let found = read("a.ply", textured(&["a.png", "b.png", "c.png"], &faces, &properties)).unwrap();
        let name = |material: u16| {
            let image = found.materials[usize::from(material)].maps.color.as_ref()?;
            Some(image.path.file_name()?.to_str()?.to_owned())
        };
        let names: Vec<_> = found.mesh.materials.iter().map(|&material| name(material)).collect();
        (names, found.materials.len())
    };
    let named = |name: &str| Some(name.to_owned());
    assert_eq!(of("2", "0"), (vec![named("c.png"), named("a.png")], 2));
    assert_eq!(of("1", "1"), (vec![named("b.png"), named("b.png")], 1));
    assert_eq!(of("3", "-1"), (vec![None, None], 1));
}

#[test]
fn a_texture_is_looked_for_beside_the_model_and_listed_as_read() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.ply");
    let text = textured(&["C:\\scans\\Skin.PNG", "../lost.png"], "3 0 1 2 0\n3 0 2 3 0\n", TEXCOORD);
    std::fs::write(&path, &text).unwrap();
    std::fs::write(folder.path().join("skin.png"), "").unwrap();
    let expected = ["skin.png", "lost.png"].map(|name| folder.path().join(name));
    assert_eq!(crate::dependencies(&path, text.as_bytes()), expected);
    assert_eq!(crate::ModelFile::streamed(&path).dependencies(), expected);
    let found = import(&path).unwrap();
    assert_eq!(found.materials[0].maps.color, Some(expected[0].clone().into()));
}
