//! Vertex clustering: a coarse mesh in one pass over the faces (Rossignac and Borrel, "Multi-resolution 3D approximations
//! for rendering complex scenes", 1993). Vertices of a part in one cell of a cubic grid become one, at their mean; faces
//! that thereby lose an edge vanish.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use lodestream_geometry::mesh::skin::Skin;
use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};

/// Most cells along an axis: three numbers of a cell fit into 63 bits.
const MAX_CELLS: f64 = (1_u64 << 20) as f64;
/// Cells that a square unit of surface crosses, in cells' squares, at a mean inclination: 1.5; and two faces for each.
const FACES_PER_CELL_SQUARE: f64 = 3.0;
/// Times that the spacing is corrected.
const CORRECTIONS: usize = 4;

/// A mesh of at most about `most` faces, without texture coordinates and normals; colours are means. Faces with bad
/// indices or coordinates are left out: the preparation of the whole mesh reports them.
pub(crate) fn clustered(mesh: &SourceMesh, most: usize) -> SourceMesh {
    let Some(grid) = Grid::of(mesh, most) else { return SourceMesh::default() };
    let mut spacing = grid.spacing;
    let mut coarse = at_spacing(mesh, Grid { spacing, ..grid });
    for _ in 0..CORRECTIONS {
        if coarse.faces.len() <= most {
            break;
        }
        // The number of faces falls with the square of the spacing.
        spacing *= 1.1 * (coarse.faces.len() as f64 / most.max(1) as f64).sqrt();
        coarse = at_spacing(mesh, Grid { spacing, ..grid });
    }
    coarse
}

#[derive(Clone, Copy)]
struct Grid {
    low: DVec3,
    spacing: f64,
}

impl Grid {
    /// A grid of about `most` faces by the area of the mesh; `None` without a usable face.
    fn of(mesh: &SourceMesh, most: usize) -> Option<Self> {
        let (mut low, mut high, mut area) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0);
        for corners in mesh.faces.iter().filter_map(|face| corners(mesh, face)) {
            let [a, b, c] = corners;
            area += (b - a).cross(c - a).length() / 2.0;
            for corner in corners {
                low = low.min(corner);
                high = high.max(corner);
            }
        }
        let side = (high - low).max_element();
        if !(side.is_finite() && side > 0.0) {
            return None;
        }
        let spacing = (FACES_PER_CELL_SQUARE * area / most.max(1) as f64).sqrt();
        let spacing = if spacing.is_finite() { spacing } else { side };
        Some(Self { low, spacing: spacing.max(side / MAX_CELLS) })
    }

    fn cell(&self, point: DVec3) -> u64 {
        let cell =
            ((point - self.low) / self.spacing).clamp(DVec3::ZERO, DVec3::splat(MAX_CELLS)).as_u64vec3();
        cell.x | cell.y << 21 | cell.z << 42
    }
}

/// Positions of a face; `None` if it has an index out of range or a coordinate that is not finite.
fn corners(mesh: &SourceMesh, face: &[Corner; 3]) -> Option<[DVec3; 3]> {
    let mut points = [DVec3::ZERO; 3];
    for (point, corner) in points.iter_mut().zip(face) {
        *point = DVec3::from(*mesh.positions.get(corner.position as usize)?);
        if !point.is_finite() {
            return None;
        }
    }
    Some(points)
}

/// The vertices of a cell that belong to one part.
#[derive(Clone, Copy, Default)]
struct Cluster {
    sum: DVec3,
    color: [u64; 4],
    corners: u32,
    /// That of its first corner.
    skin: Skin,
}

fn at_spacing(mesh: &SourceMesh, grid: Grid) -> SourceMesh {
    let mut clusters: Vec<Cluster> = Vec::new();
    let mut numbers: HashMap<(u32, u64), u32> = HashMap::new();
    // Cluster of each position, with the part that it was looked up for.
    let mut known: Vec<Option<(u32, u32)>> = vec![None; mesh.positions.len()];
    let mut seen: HashSet<[u32; 3]> = HashSet::new();
    let mut coarse = SourceMesh::default();
    let color_of = |cluster| if mesh.colors.is_empty() { NONE } else { cluster };
    for (number, face) in mesh.faces.iter().enumerate() {
        let Some(points) = corners(mesh, face) else { continue };
        let part = mesh.parts.get(number).copied().unwrap_or_default();
        let mut triple = [0; 3];
        for ((cluster, point), corner) in triple.iter_mut().zip(points).zip(face) {
            let known = &mut known[corner.position as usize];
            let at = match *known {
                Some((of, at)) if of == part => at,
                _ => *numbers.entry((part, grid.cell(point))).or_insert_with(|| {
                    let skin = mesh.skins.get(corner.position as usize).copied().unwrap_or_default();
                    clusters.push(Cluster { skin, ..Cluster::default() });
                    (clusters.len() - 1) as u32
                }),
            };
            *known = Some((part, at));
            let all = &mut clusters[at as usize];
            all.sum += point;
            all.corners += 1;
            let color = mesh.colors.get(corner.color as usize).copied().unwrap_or([u8::MAX; 4]);
            all.color = std::array::from_fn(|i| all.color[i] + u64::from(color[i]));
            *cluster = at;
        }
        let [a, b, c] = triple;
        if a == b || b == c || a == c || !seen.insert(from_least(triple)) {
            continue;
        }
        coarse.faces.push(triple.map(|at| Corner { color: color_of(at), ..Corner::at(at) }));
        coarse.materials.push(mesh.materials.get(number).copied().unwrap_or_default());
        if !mesh.parts.is_empty() {
            coarse.parts.push(part);
        }
    }
    coarse.positions =
        clusters.iter().map(|all| (all.sum / f64::from(all.corners.max(1))).to_array()).collect();
    if !mesh.skins.is_empty() {
        coarse.skins = clusters.iter().map(|all| all.skin).collect();
        coarse.poses.clone_from(&mesh.poses);
    }
    if !mesh.colors.is_empty() {
        let mean = |all: &Cluster| all.color.map(|sum| (sum / u64::from(all.corners.max(1))) as u8);
        coarse.colors = clusters.iter().map(mean).collect();
    }
    coarse
}

/// The same cycle, beginning with its least number.
fn from_least([a, b, c]: [u32; 3]) -> [u32; 3] {
    match a.min(b).min(c) {
        least if least == a => [a, b, c],
        least if least == b => [b, c, a],
        _ => [c, a, b],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of `2 × cells²` faces, wavy upwards, of two materials.
    fn sheet(cells: u32) -> SourceMesh {
        let mut mesh = SourceMesh::default();
        let at = |i: u32| f64::from(i) / f64::from(cells);
        for (i, j) in (0..=cells).flat_map(|i| (0..=cells).map(move |j| (i, j))) {
            mesh.positions.push([at(i), 0.05 * (9.0 * at(i)).sin(), at(j)]);
        }
        let corner = |i: u32, j: u32| Corner::at(i * (cells + 1) + j);
        for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
            let [a, b, c, d] = [corner(i, j), corner(i, j + 1), corner(i + 1, j + 1), corner(i + 1, j)];
            mesh.faces.extend([[a, b, c], [a, c, d]]);
            mesh.materials.extend([u16::from(i < cells / 2); 2]);
        }
        mesh
    }

    #[test]
    fn a_clustered_mesh_has_about_as_many_faces_as_wanted_and_the_same_bounds() {
        let mesh = sheet(200);
        for most in [500, 3000, 20_000] {
            let coarse = clustered(&mesh, most);
            let faces = coarse.faces.len();
            assert!(faces <= most && faces > most / 8, "{faces} of {most}");
            assert_eq!(coarse.materials.len(), faces);
            assert!(coarse.materials.contains(&0) && coarse.materials.contains(&1));
            let cell = 2.0 / (most as f64).sqrt();
            for axis in [0, 2] {
                let of = |p: &[f64; 3]| p[axis];
                let low = coarse.positions.iter().map(of).fold(f64::INFINITY, f64::min);
                let high = coarse.positions.iter().map(of).fold(0.0, f64::max);
                assert!(low <= cell && high >= 1.0 - cell, "{most}: {low} to {high}");
            }
        }
    }

    #[test]
    fn parts_share_no_vertex_and_colours_are_means() {
        let mut mesh = sheet(40);
        mesh.parts = mesh.materials.iter().map(|&material| u32::from(material)).collect();
        mesh.colors = vec![[10, 20, 30, 255], [30, 40, 50, 255]];
        for (number, face) in mesh.faces.iter_mut().enumerate() {
            face.iter_mut().for_each(|corner| corner.color = (number % 2) as u32);
        }
        let coarse = clustered(&mesh, 200);
        let mut part_of = vec![None; coarse.positions.len()];
        for (face, part) in coarse.faces.iter().zip(&coarse.parts) {
            for corner in face {
                assert_eq!(*part_of[corner.position as usize].get_or_insert(*part), *part);
            }
        }
        assert!(coarse.colors.iter().all(|color| (11..30).contains(&color[0]) && color[3] == 255));
    }

    #[test]
    fn bad_faces_and_empty_meshes_do_not_harm() {
        assert!(clustered(&SourceMesh::default(), 100).faces.is_empty());
        let mut mesh = sheet(4);
        mesh.positions[0] = [f64::NAN; 3];
        mesh.positions[7] = [f64::MAX, 0.0, -f64::MAX];
        mesh.faces[5][1].position = u32::MAX;
        mesh.materials.clear();
        let coarse = clustered(&mesh, 100);
        assert!(coarse.positions.iter().flatten().all(|x| !x.is_nan()));
    }
}
