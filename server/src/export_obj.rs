//! Meshes written as OBJ, so that any tool can judge them.

use std::io::{self, Write};

use glam::DVec3;
use lodestream_geometry::mesh::QuantisedMesh;

/// Writes a mesh: one `v` per vertex, one `vt` and one `vn` per wedge that differs.
///
/// Normals are those that the viewer draws: the sum of the face normals, weighted by area, over the
/// corners of each normal group.
///
/// # Errors
/// Whatever writing says.
pub fn write_obj(out: &mut dyn Write, mesh: &QuantisedMesh, material_names: &[String]) -> io::Result<()> {
    writeln!(out, "# {} vertices, {} faces", mesh.positions.len(), mesh.faces.len())?;
    for &q in &mesh.positions {
        let [x, y, z] = mesh.grid.position(q);
        writeln!(out, "v {x} {y} {z}")?;
    }
    let has_uv = mesh.uv_grid.bits > 0;
    if has_uv {
        for wedge in &mesh.wedges {
            let [u, v] = mesh.uv_grid.uv(wedge.attributes.uv);
            writeln!(out, "vt {u} {v}")?;
        }
    }
    let (normals, normal_of) = group_normals(mesh);
    for n in &normals {
        writeln!(out, "vn {:.6} {:.6} {:.6}", n.x, n.y, n.z)?;
    }
    let mut material = None;
    for face in &mesh.faces {
        if material != Some(face.material) {
            material = Some(face.material);
            match material_names.get(usize::from(face.material)) {
                Some(name) if !name.is_empty() => writeln!(out, "usemtl {name}")?,
                _ => writeln!(out, "usemtl material-{}", face.material)?,
            }
        }
        write!(out, "f")?;
        for wedge in face.wedges {
            // OBJ counts from 1.
            let vertex = u64::from(mesh.wedges[wedge as usize].vertex) + 1;
            let normal = normal_of[wedge as usize] + 1;
            if has_uv {
                write!(out, " {vertex}/{}/{normal}", u64::from(wedge) + 1)?;
            } else {
                write!(out, " {vertex}//{normal}")?;
            }
        }
        writeln!(out)?;
    }
    Ok(())
}

/// One normal per (vertex, group), and each wedge's index into them.
fn group_normals(mesh: &QuantisedMesh) -> (Vec<DVec3>, Vec<u64>) {
    // Wedges sorted by (vertex, group) stand together: equal neighbours share a normal.
    let key = |w: u32| (mesh.wedges[w as usize].vertex, mesh.wedges[w as usize].attributes.group);
    let mut order: Vec<u32> = (0..mesh.wedges.len() as u32).collect();
    order.sort_by_key(|&w| (key(w), w));
    let mut normal_of = vec![0u64; mesh.wedges.len()];
    let mut count = 0u64;
    for (i, &wedge) in order.iter().enumerate() {
        if i > 0 && key(order[i - 1]) != key(wedge) {
            count += 1;
        }
        normal_of[wedge as usize] = count;
    }
    let mut normals = vec![DVec3::ZERO; if mesh.wedges.is_empty() { 0 } else { count as usize + 1 }];
    for face in &mesh.faces {
        let corner = |i: usize| {
            let q = mesh.positions[mesh.wedges[face.wedges[i] as usize].vertex as usize];
            DVec3::new(f64::from(q[0]), f64::from(q[1]), f64::from(q[2]))
        };
        let (a, b, c) = (corner(0), corner(1), corner(2));
        let normal = (b - a).cross(c - a);
        for wedge in face.wedges {
            normals[normal_of[wedge as usize] as usize] += normal;
        }
    }
    for normal in &mut normals {
        *normal = normal.normalize_or(DVec3::Z);
    }
    (normals, normal_of)
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
        }
    }

    fn text(mesh: &QuantisedMesh) -> String {
        let mut out = Vec::new();
        write_obj(&mut out, mesh, &["red".into()]).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn what_is_written_is_read_back() {
        let dir = tempfile::TempDir::new().unwrap();
        let path = dir.path().join("a.obj");
        std::fs::write(&path, text(&fold(false))).unwrap();
        let read = crate::import::import(&path).unwrap();
        assert_eq!(
            read.mesh.positions,
            [[10.0, 0.0, 0.0], [11.0, 0.0, 0.0], [10.0, 1.0, 0.0], [10.0, 0.0, 1.0]]
        );
        let names: Vec<&str> = read.materials.iter().map(|m| m.name.as_str()).collect();
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
}
