//! Binary and text, as programs write them.

use tempfile::TempDir;

use crate::{ImportError, Imported, dependencies, import, is_stl};

/// The 12 facets of a box of side 2 about the origin.
fn facets() -> Vec<[[f32; 3]; 3]> {
    let corner = |n: u8| [n & 1, n >> 1 & 1, n >> 2].map(|bit| 2.0 * f32::from(bit) - 1.0);
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    triangles.map(|triangle| triangle.map(corner)).collect()
}

fn binary(title: &str, count: u32, facets: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut out = title.as_bytes().to_vec();
    out.resize(80, b' ');
    out.extend(count.to_le_bytes());
    for facet in facets {
        // A normal that is wrong, and a colour.
        let values = [[0.0, 0.0, 9.0]].iter().chain(facet).flatten().flat_map(|x: &f32| x.to_le_bytes());
        out.extend(values.collect::<Vec<u8>>());
        out.extend([0x7f, 0x80]);
    }
    out
}

fn text(facets: &[[[f32; 3]; 3]]) -> String {
    let mut out = "solid a box\n".to_owned();
    for facet in facets {
        out += "  facet normal 0 0 0\n    outer loop\n";
        for [x, y, z] in facet {
            out += &format!("      vertex {x:e} {y} {z}\n");
        }
        out += "    endloop\n  endfacet\n";
    }
    out + "endsolid a box\n"
}

fn read(bytes: impl AsRef<[u8]>) -> Result<Imported, ImportError> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.STL");
    assert!(is_stl(&path));
    assert!(dependencies(&path, bytes.as_ref()).is_empty());
    std::fs::write(&path, bytes).unwrap();
    import(&path)
}

/// Volume that the faces enclose, positive if they turn outwards.
fn volume(imported: &Imported) -> f64 {
    let mesh = &imported.mesh;
    let faces =
        mesh.faces.iter().map(|face| face.map(|c| glam::DVec3::from(mesh.positions[c.position as usize])));
    faces.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

fn is_the_box(imported: &Imported) {
    let mesh = &imported.mesh;
    assert_eq!((mesh.faces.len(), mesh.positions.len(), mesh.normals.len()), (12, 8, 0));
    assert_eq!((volume(imported), imported.materials.len()), (8.0, 1));
}

#[test]
fn binary_files_are_read_even_if_they_begin_as_text_does() {
    for title in ["", "solid", "solid made by a program\n facet normal 0 0 0"] {
        let imported = read(binary(title, 12, &facets())).unwrap();
        is_the_box(&imported);
        assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    }
    for count in [0, u32::MAX] {
        let imported = read(binary("", count, &facets())).unwrap();
        is_the_box(&imported);
        assert!(imported.warnings[0].contains("but has 12"), "{:?}", imported.warnings);
    }
    let imported = read([&binary("", 12, &facets())[..], b"\r\n"].concat()).unwrap();
    is_the_box(&imported);
    assert!(imported.warnings[0].contains("bytes after its 12 facets"), "{:?}", imported.warnings);
}

#[test]
fn text_is_read_whatever_its_case_and_line_ends_and_solids_are_merged() {
    let plain = text(&facets());
    for written in [
        plain.clone(),
        plain.to_uppercase(),
        plain.replace('\n', "\r\n"),
        format!("\u{feff}\n{plain}"),
        plain.replace("endsolid a box\n", ""),
        [text(&facets()[..5]), text(&facets()[5..])].concat(),
        plain.replace("    endloop\n", "    endloop\n\n  color 1 0 0\n"),
    ] {
        let imported = read(&written).unwrap();
        is_the_box(&imported);
        assert!(imported.warnings.is_empty(), "{:?}", imported.warnings);
    }
}

#[test]
fn a_few_bad_facets_are_left_out_and_many_are_an_error() {
    let mut bad = facets();
    bad[3][1][2] = f32::NAN;
    for bytes in [binary("", 12, &bad), text(&bad).into_bytes()] {
        let imported = read(bytes).unwrap();
        assert_eq!(imported.mesh.faces.len(), 11);
        let [warning] = &imported.warnings[..] else { panic!("{:?}", imported.warnings) };
        assert!(warning.contains("1 such facets were left out"), "{warning}");
    }
    bad[4][0][0] = f32::INFINITY;
    bad[5][2][1] = f32::NEG_INFINITY;
    let why = read(binary("", 12, &bad)).unwrap_err().to_string();
    assert!(why.contains("a.STL: facet 3 has a corner"), "{why}");
    let why = read(text(&bad)).unwrap_err().to_string();
    assert!(why.contains("ends in line 29"), "{why}");
}

#[test]
fn files_cut_short_anywhere_are_refused_or_lose_whole_facets_without_a_panic() {
    let whole = binary("", 12, &facets());
    for length in 0..whole.len() {
        let why = read(&whole[..length]).unwrap_err().to_string();
        assert!(["empty", "too few", "truncated"].iter().any(|word| why.contains(word)), "{length}: {why}");
    }
    let whole = text(&facets());
    for length in 0..whole.len() {
        match read(&whole[..length]) {
            Ok(imported) => assert!(imported.mesh.faces.len() <= 12),
            Err(why) => assert_eq!(why.to_string().lines().count(), 1, "{why}"),
        }
    }
    assert!(read("solid nothing\nendsolid nothing\n").unwrap_err().to_string().contains("has no faces"));
    assert!(read("solid long\n".to_owned() + &" ".repeat(1 << 17)).is_err());
}
