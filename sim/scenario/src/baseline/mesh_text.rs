//! Meshes as text: OBJ, and JSON in the older system's format; their gzip length.
//!
//! Numbers have as many decimals as the grid of positions justifies, without trailing zeros. OBJ has normals only where
//! the mesh has creases: elsewhere a viewer computes them, as ours does. Materials and colours are omitted.

use std::io::{self, Write};

use flate2::Compression;
use flate2::write::GzEncoder;
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::normals::wedge_normals;

/// Decimals of a component of a normal: steps of 1e-4 are finer than shading shows.
const NORMAL_DECIMALS: usize = 4;

/// Decimals that keep a multiple of `step` within half a step.
fn decimals(step: f64) -> usize {
    if step > 0.0 && step.is_finite() {
        // The logarithm is far from the ends of f64's range, and so is its ceiling.
        (-step.log10()).ceil().clamp(0.0, 17.0) as usize
    } else {
        0
    }
}

/// Writes a number with at most `places` decimals, as short as possible.
fn number(out: &mut Vec<u8>, value: f64, places: usize) -> io::Result<()> {
    let start = out.len();
    write!(out, "{value:.places$}")?;
    if places > 0 {
        while out.last() == Some(&b'0') {
            out.pop();
        }
        if out.last() == Some(&b'.') {
            out.pop();
        }
    }
    if &out[start..] == b"-0" {
        out.remove(start);
    }
    Ok(())
}

/// The decimals of an axis of texture coordinates.
fn uv_decimals(mesh: &QuantisedMesh) -> [usize; 2] {
    mesh.uv_grid.step.map(decimals)
}

/// Whether the mesh has normals that differ from its faces' smooth ones.
fn has_creases(mesh: &QuantisedMesh) -> bool {
    mesh.wedges.iter().any(|wedge| wedge.attributes.group != 0 || wedge.attributes.normal.is_some())
}

/// The mesh as OBJ.
///
/// # Errors
/// None: writing to memory does not fail.
pub fn obj(mesh: &QuantisedMesh) -> io::Result<Vec<u8>> {
    let mut out = Vec::new();
    let places = decimals(mesh.grid.step);
    for &q in &mesh.positions {
        out.push(b'v');
        for x in mesh.grid.position(q) {
            out.push(b' ');
            number(&mut out, x, places)?;
        }
        out.push(b'\n');
    }
    let uv_of = if mesh.uv_grid.bits > 0 { Some(uvs(&mut out, mesh)?) } else { None };
    let normal_of = if has_creases(mesh) { Some(normals(&mut out, mesh)?) } else { None };
    for face in &mesh.faces {
        out.push(b'f');
        for wedge in face.wedges.map(|w| w as usize) {
            // OBJ counts from 1.
            write!(out, " {}", mesh.wedges[wedge].vertex + 1)?;
            match (&uv_of, &normal_of) {
                (Some(uv), Some(normal)) => write!(out, "/{}/{}", uv[wedge], normal[wedge])?,
                (Some(uv), None) => write!(out, "/{}", uv[wedge])?,
                (None, Some(normal)) => write!(out, "//{}", normal[wedge])?,
                (None, None) => {}
            }
        }
        out.push(b'\n');
    }
    Ok(out)
}

/// Writes equal lines once; returns for each wedge the number of its line, from 1.
fn lines<K: Ord>(
    out: &mut Vec<u8>,
    keys: impl Iterator<Item = K>,
    mut line: impl FnMut(&mut Vec<u8>, &K) -> io::Result<()>,
) -> io::Result<Vec<usize>> {
    let mut known = std::collections::BTreeMap::new();
    let mut number_of = Vec::new();
    for key in keys {
        let next = known.len() + 1;
        let number = match known.get(&key) {
            Some(&number) => number,
            None => {
                line(out, &key)?;
                known.insert(key, next);
                next
            }
        };
        number_of.push(number);
    }
    Ok(number_of)
}

fn uvs(out: &mut Vec<u8>, mesh: &QuantisedMesh) -> io::Result<Vec<usize>> {
    let places = uv_decimals(mesh);
    lines(out, mesh.wedges.iter().map(|wedge| wedge.attributes.uv), |out, &uv| {
        out.extend_from_slice(b"vt");
        for (x, places) in mesh.uv_grid.uv(uv).into_iter().zip(places) {
            out.push(b' ');
            number(out, x, places)?;
        }
        out.push(b'\n');
        Ok(())
    })
}

fn normals(out: &mut Vec<u8>, mesh: &QuantisedMesh) -> io::Result<Vec<usize>> {
    let scale = 10_f64.powi(NORMAL_DECIMALS as i32);
    // Components are at most 1.
    let rounded = wedge_normals(mesh).into_iter().map(|n| n.map(|x| (x * scale).round() as i32));
    lines(out, rounded, |out, normal| {
        out.extend_from_slice(b"vn");
        for &x in normal {
            out.push(b' ');
            number(out, f64::from(x) / scale, NORMAL_DECIMALS)?;
        }
        out.push(b'\n');
        Ok(())
    })
}

/// The mesh as one JSON object of flat arrays: `vertices`, `normals`, `uvs` (where the mesh has them) and
/// `faces`, which index all of them from 0.
///
/// # Errors
/// None: writing to memory does not fail.
pub fn json(mesh: &QuantisedMesh) -> io::Result<Vec<u8>> {
    let mut out = Vec::new();
    let places = decimals(mesh.grid.step);
    let positions = mesh.wedges.iter().map(|w| mesh.grid.position(mesh.positions[w.vertex as usize]));
    array(&mut out, "{\"vertices\":[", positions.flatten().map(|x| (x, places)))?;
    let normals = wedge_normals(mesh).into_iter().flatten();
    array(&mut out, "],\"normals\":[", normals.map(|x| (x, NORMAL_DECIMALS)))?;
    if mesh.uv_grid.bits > 0 {
        let places = uv_decimals(mesh);
        let uvs = mesh.wedges.iter().map(|w| mesh.uv_grid.uv(w.attributes.uv));
        array(&mut out, "],\"uvs\":[", uvs.flat_map(|[u, v]| [(u, places[0]), (v, places[1])]))?;
    }
    let corners = mesh.faces.iter().flat_map(|face| face.wedges);
    array(&mut out, "],\"faces\":[", corners.map(|w| (f64::from(w), 0)))?;
    out.extend_from_slice(b"]}");
    Ok(out)
}

fn array(out: &mut Vec<u8>, begin: &str, values: impl Iterator<Item = (f64, usize)>) -> io::Result<()> {
    out.extend_from_slice(begin.as_bytes());
    for (i, (value, places)) in values.enumerate() {
        if i > 0 {
            out.push(b',');
        }
        number(out, value, places)?;
    }
    Ok(())
}

/// Length of a text after `gzip -9`, in bytes.
///
/// # Errors
/// None: writing to memory does not fail.
pub fn gzip_bytes(text: &[u8]) -> io::Result<u64> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(text)?;
    Ok(encoder.finish()?.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_geometry::mesh::{Attributes, Face, Grid, UvGrid, Wedge};

    /// A square of two triangles, optionally with texture coordinates and a crease along its diagonal.
    fn square(uv: bool, crease: bool) -> QuantisedMesh {
        let wedge = |vertex: u32, group| Wedge {
            vertex,
            attributes: Attributes { uv: [vertex as i32, 0], group, ..Attributes::default() },
        };
        let other = u32::from(crease);
        QuantisedMesh {
            grid: Grid { origin: [-1.0, 0.0, 0.0], step: 0.25, bits: 3 },
            uv_grid: UvGrid { origin: [0.0; 2], step: [0.25; 2], bits: if uv { 2 } else { 0 } },
            second_uv_grid: UvGrid::NONE,
            positions: vec![[0, 0, 0], [4, 0, 0], [4, 5, 0], [0, 5, 1]],
            wedges: vec![
                wedge(0, 0),
                wedge(1, 0),
                wedge(2, 0),
                wedge(0, other),
                wedge(2, other),
                wedge(3, 0),
            ],
            faces: vec![Face { wedges: [0, 1, 2], material: 0 }, Face { wedges: [3, 4, 5], material: 0 }],
            parts: Vec::new(),
            skins: Vec::new(),
            poses: Vec::new(),
        }
    }

    fn text(bytes: Vec<u8>) -> String {
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn obj_has_what_the_mesh_has_and_no_more() {
        let plain = text(obj(&square(false, false)).unwrap());
        // A step of 0.25 is worth one decimal.
        assert_eq!(plain, "v -1 0 0\nv 0 0 0\nv 0 1.2 0\nv -1 1.2 0.2\nf 1 2 3\nf 1 3 4\n");
        let textured = text(obj(&square(true, false)).unwrap());
        assert!(
            textured.contains("vt 0.2 0\n") && textured.ends_with("f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"),
            "{textured}"
        );
        let creased = text(obj(&square(false, true)).unwrap());
        assert!(creased.contains("vn 0 0 1\n") && creased.contains("f 1//1 2//1 3//1\n"), "{creased}");
    }

    #[test]
    fn obj_round_trips() {
        let file = tempfile::Builder::new().suffix(".obj").tempfile().unwrap();
        std::fs::write(file.path(), obj(&square(true, true)).unwrap()).unwrap();
        let read = lodestream_import::import(file.path()).unwrap().mesh;
        assert_eq!((read.positions.len(), read.faces.len()), (4, 2));
        assert_eq!(read.uvs[read.faces[0][1].uv as usize], [0.2, 0.0]);
    }

    #[test]
    fn json_parses_and_its_arrays_agree_in_length() {
        for uv in [false, true] {
            let json: serde_json::Value = serde_json::from_slice(&json(&square(uv, true)).unwrap()).unwrap();
            let length = |name: &str| json[name].as_array().map(Vec::len);
            assert_eq!(
                (length("vertices"), length("normals"), length("faces")),
                (Some(18), Some(18), Some(6))
            );
            assert_eq!(length("uvs"), uv.then_some(12));
            assert_eq!(json["vertices"][7], 1.2);
        }
    }

    #[test]
    fn gzip_length_is_that_of_a_gzip_stream() {
        let text = "v 0 0 0\n".repeat(1000);
        let bytes = gzip_bytes(text.as_bytes()).unwrap();
        assert!((20..200).contains(&bytes), "{bytes}");
    }
}
