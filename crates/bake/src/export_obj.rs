//! Export of meshes as OBJ, for use in other tools.

use std::collections::HashMap;
use std::io::{self, Write};

use lodestream_geometry::mesh::{NO_COLOR, QuantisedMesh};
use lodestream_geometry::normals::wedge_normals;
use lodestream_scene::asset::Material;

/// Writes a mesh: one `v` per vertex, one `vt` per wedge, one `vn` per normal that differs.
///
/// Normals are those that the viewer draws ([`wedge_normals`]); faces of flat materials have none (`s off`). Colours follow the position
/// (`v x y z r g b`, sRGB-encoded in 0..=1, then opacity if any is not 1) where the mesh has them; a
/// vertex whose wedges differ in colour is written once per colour, since OBJ has no index for colours.
///
/// # Errors
/// Errors of the writer.
pub fn write_obj(out: &mut dyn Write, mesh: &QuantisedMesh, materials: &[Material]) -> io::Result<()> {
    writeln!(out, "# {} vertices, {} faces", mesh.positions.len(), mesh.faces.len())?;
    let vertex_of = write_vertices(out, mesh)?;
    let has_uv = mesh.uv_grid.bits > 0;
    if has_uv {
        for wedge in &mesh.wedges {
            let [u, v] = mesh.uv_grid.uv(wedge.attributes.uv);
            writeln!(out, "vt {u} {v}")?;
        }
    }
    let normal_of = write_normals(out, mesh)?;
    let (mut material, mut flat) = (None, false);
    for face in &mesh.faces {
        if material != Some(face.material) {
            material = Some(face.material);
            let found = materials.get(usize::from(face.material));
            match found {
                Some(Material { name, .. }) if !name.is_empty() => writeln!(out, "usemtl {name}")?,
                _ => writeln!(out, "usemtl material-{}", face.material)?,
            }
            flat = found.is_some_and(|material| material.flat);
            if flat {
                writeln!(out, "s off")?;
            }
        }
        write!(out, "f")?;
        for wedge in face.wedges {
            let (vertex, normal) = (vertex_of[wedge as usize], normal_of[wedge as usize]);
            // OBJ counts from 1.
            let uv = u64::from(wedge) + 1;
            match (has_uv, flat) {
                (true, false) => write!(out, " {vertex}/{uv}/{normal}")?,
                (false, false) => write!(out, " {vertex}//{normal}")?,
                (true, true) => write!(out, " {vertex}/{uv}")?,
                (false, true) => write!(out, " {vertex}")?,
            }
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Writes the `v` lines. Returns each wedge's number among them, from 1.
fn write_vertices(out: &mut dyn Write, mesh: &QuantisedMesh) -> io::Result<Vec<u64>> {
    let colors = || mesh.wedges.iter().map(|wedge| wedge.attributes.color);
    let colored = colors().any(|color| color != NO_COLOR);
    let opaque = colors().all(|color| color[3] == u8::MAX);
    let mut line = |vertex: u32, color: [u8; 4]| {
        let [x, y, z] = mesh.grid.position(mesh.positions[vertex as usize]);
        write!(out, "v {x} {y} {z}")?;
        if colored {
            // Four digits distinguish steps of 1/255.
            for value in &color[..if opaque { 3 } else { 4 }] {
                write!(out, " {:.4}", f64::from(*value) / 255.0)?;
            }
        }
        writeln!(out)
    };
    // The lines of the vertices as such come first, so that they keep their numbers.
    let mut first = vec![None; mesh.positions.len()];
    for wedge in &mesh.wedges {
        first[wedge.vertex as usize].get_or_insert(wedge.attributes.color);
    }
    for (vertex, color) in (0..).zip(&first) {
        line(vertex, color.unwrap_or(NO_COLOR))?;
    }
    let mut more: HashMap<(u32, [u8; 4]), u64> = HashMap::new();
    let mut count = mesh.positions.len() as u64;
    let mut vertex_of = Vec::with_capacity(mesh.wedges.len());
    for wedge in &mesh.wedges {
        let (vertex, color) = (wedge.vertex, wedge.attributes.color);
        if first[vertex as usize] == Some(color) {
            vertex_of.push(u64::from(vertex) + 1);
        } else if let Some(&number) = more.get(&(vertex, color)) {
            vertex_of.push(number);
        } else {
            line(vertex, color)?;
            count += 1;
            more.insert((vertex, color), count);
            vertex_of.push(count);
        }
    }
    Ok(vertex_of)
}

/// Writes the `vn` lines, equal normals once. Returns each wedge's number among them, from 1.
fn write_normals(out: &mut dyn Write, mesh: &QuantisedMesh) -> io::Result<Vec<u64>> {
    let mut numbers: HashMap<[u64; 3], u64> = HashMap::new();
    let mut normal_of = Vec::with_capacity(mesh.wedges.len());
    for normal in wedge_normals(mesh) {
        // OBJ requires a normal, even if all faces are degenerate.
        let [x, y, z] = if normal == [0.0; 3] { [0.0, 0.0, 1.0] } else { normal };
        let next = numbers.len() as u64 + 1;
        let number = *numbers.entry([x, y, z].map(f64::to_bits)).or_insert(next);
        if number == next {
            writeln!(out, "vn {x:.6} {y:.6} {z:.6}")?;
        }
        normal_of.push(number);
    }
    Ok(normal_of)
}

#[cfg(test)]
mod tests {
    use lodestream_geometry::mesh::{Attributes, Face, Grid, UvGrid, Wedge};

    use super::*;

    /// Two triangles that meet at a right angle; `smooth` puts the shared edge into one normal group.
    fn fold(smooth: bool) -> QuantisedMesh {
        let other = u32::from(!smooth);
        let wedge = |vertex, group| Wedge {
            vertex,
            attributes: Attributes { uv: [vertex as i32, 0], group, ..Attributes::default() },
        };
        QuantisedMesh {
            grid: Grid { origin: [10.0, 0.0, 0.0], step: 0.5, bits: 4 },
            uv_grid: UvGrid { origin: [0.0; 2], step: [0.25; 2], bits: 4 },
            second_uv_grid: UvGrid::NONE,
            positions: vec![[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]],
            wedges: vec![
                wedge(0, 0),
                wedge(1, 0),
                wedge(2, 0),
                wedge(0, other),
                wedge(1, other),
                wedge(3, 0),
            ],
            faces: vec![Face { wedges: [0, 1, 2], material: 0 }, Face { wedges: [4, 3, 5], material: 1 }],
            parts: Vec::new(),
            skins: Vec::new(),
            poses: Vec::new(),
        }
    }

    fn text(mesh: &QuantisedMesh) -> String {
        let mut out = Vec::new();
        let red = Material { name: "red".into(), ..Material::default() };
        write_obj(&mut out, mesh, &[red]).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn flat_faces_are_written_and_read_back_flat() {
        let mut out = Vec::new();
        let of = |name: &str, flat| Material { name: name.into(), flat, ..Material::default() };
        write_obj(&mut out, &fold(true), &[of("red", true), of("blue", false)]).unwrap();
        let dir = tempfile::TempDir::new().unwrap();
        let path = dir.path().join("a.obj");
        std::fs::write(&path, out).unwrap();
        let read = lodestream_import::import(&path).unwrap();
        assert_eq!([0, 1].map(|i: usize| read.materials[i].material.flat), [true, false]);
    }

    #[test]
    fn written_meshes_are_read_back_equal() {
        let dir = tempfile::TempDir::new().unwrap();
        let path = dir.path().join("a.obj");
        std::fs::write(&path, text(&fold(false))).unwrap();
        let read = lodestream_import::import(&path).unwrap();
        assert_eq!(
            read.mesh.positions,
            [[10.0, 0.0, 0.0], [11.0, 0.0, 0.0], [10.0, 1.0, 0.0], [10.0, 0.0, 1.0]]
        );
        let names: Vec<&str> = read.materials.iter().map(|m| m.material.name.as_str()).collect();
        assert_eq!(names, ["red", "material-1"]);
        let corner = read.mesh.faces[1][0];
        assert_eq!(read.mesh.positions[corner.position as usize], [11.0, 0.0, 0.0]);
        assert_eq!(read.mesh.uvs[corner.uv as usize], [0.25, 0.0]);
        assert_eq!(read.mesh.normals[corner.normal as usize], [0.0, 1.0, 0.0]);
    }

    #[test]
    fn one_group_has_one_normal() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!(
            text(&fold(true)).contains(&format!("vn 0.000000 {half:.6} {half:.6}")),
            "{}",
            text(&fold(true))
        );
        assert!(!text(&fold(false)).contains(&format!("{half:.6}")));
    }

    #[test]
    fn colours_and_explicit_normals_are_written_and_read_back() {
        let mut mesh = fold(true);
        let tilted = lodestream_geometry::octahedral::encode([1.0, 0.0, 1.0]);
        mesh.wedges[0].attributes.normal = Some(tilted);
        mesh.wedges[1].attributes.color = [255, 0, 7, 255];
        mesh.wedges[3].attributes.color = [9, 200, 30, 128];
        let dir = tempfile::TempDir::new().unwrap();
        let path = dir.path().join("a.obj");
        std::fs::write(&path, text(&mesh)).unwrap();
        let read = lodestream_import::import(&path).unwrap().mesh;
        // Vertex 0 has two colours: two lines, welded again.
        assert_eq!(read.positions.len(), 4);
        let color = |face: usize, corner: usize| read.colors[read.faces[face][corner].color as usize];
        assert_eq!(color(0, 0), NO_COLOR);
        assert_eq!(color(0, 1), [255, 0, 7, 255]);
        assert_eq!(color(1, 1), [9, 200, 30, 128]);
        let n = read.normals[read.faces[0][0].normal as usize];
        assert!((n[0] - n[2]).abs() < 1e-2 && n[1].abs() < 1e-2, "{n:?}");
        assert!(!text(&fold(true)).contains("v 10 0 0 "), "no colours where there are none");
    }
}
