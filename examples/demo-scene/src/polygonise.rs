//! Turns a solid into a closed triangle mesh.
//!
//! Marching tetrahedra on the Kuhn subdivision of a cubic lattice (Doi & Koide, "An efficient method
//! of triangulating equi-valued surfaces by using tetrahedral cells", 1991): unlike marching cubes
//! it has no ambiguous case, so the result is a closed 2-manifold whatever the field does between
//! lattice points. A few rounds of tangential smoothing with projection back onto the field then
//! even out the triangles, which the bare method leaves as slivers.

use super::maths::unit_or;
use super::mesh::{Corner, ObjMesh};
use super::sdf::Figure;
use glam::{DVec3, IVec3};
use std::collections::HashMap;

/// Cells along a side of a block; blocks without surface are not evaluated.
const BLOCK: i32 = 8;
/// Rounds of smoothing.
const ROUNDS: usize = 4;
/// Least share of an edge between a crossing and the edge's ends, so that no face starts degenerate.
const EDGE_GUARD: f64 = 0.12;

/// The six tetrahedra of a cube: paths from corner 000 to corner 111 along the axes, as bits xyz.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 1, 5, 7], [0, 2, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 4, 6, 7]];

/// The lattice of a figure: origin, cell size, and size in blocks.
struct Lattice {
    origin: DVec3,
    cell: f64,
    blocks: IVec3,
}

impl Lattice {
    fn new(figure: &Figure, cell: f64) -> Self {
        let (low, high) = figure.bounds();
        let origin = low - DVec3::splat(cell * 1.5);
        let cells = ((high + DVec3::splat(cell * 1.5) - origin) / cell).ceil();
        let blocks = ((cells / f64::from(BLOCK)).ceil()).as_ivec3().max(IVec3::ONE);
        Self { origin, cell, blocks }
    }

    fn points(&self) -> IVec3 {
        self.blocks * BLOCK + IVec3::ONE
    }

    fn point_index(&self, p: IVec3) -> usize {
        let n = self.points();
        (p.z as usize * n.y as usize + p.y as usize) * n.x as usize + p.x as usize
    }

    fn block_index(&self, b: IVec3) -> usize {
        (b.z as usize * self.blocks.y as usize + b.y as usize) * self.blocks.x as usize + b.x as usize
    }

    fn position(&self, p: IVec3) -> DVec3 {
        self.origin + p.as_dvec3() * self.cell
    }

    fn block_at(&self, p: DVec3) -> usize {
        let b = ((p - self.origin) / (self.cell * f64::from(BLOCK))).floor().as_ivec3();
        self.block_index(b.clamp(IVec3::ZERO, self.blocks - IVec3::ONE))
    }

    fn each_block(&self) -> impl Iterator<Item = IVec3> + use<> {
        let n = self.blocks;
        (0..n.z).flat_map(move |z| (0..n.y).flat_map(move |y| (0..n.x).map(move |x| IVec3::new(x, y, z))))
    }
}

/// The surface of `figure` with lattice cells of `cell` metres: closed, edge-manifold, normals
/// pointing outwards. Cost and face count grow with area / cell² (about 4.6 faces per cell² of area).
pub(super) fn polygonise(figure: &Figure, cell: f64) -> ObjMesh {
    let lattice = Lattice::new(figure, cell);
    let radius = cell * f64::from(BLOCK) * 0.5 * 3.0_f64.sqrt();
    let near: Vec<Option<Vec<u32>>> = lattice
        .each_block()
        .map(|b| {
            let centre = lattice.position(b * BLOCK) + DVec3::splat(cell * f64::from(BLOCK) * 0.5);
            figure.near(centre, radius)
        })
        .collect();

    // Each lattice point is evaluated once, so neighbouring blocks agree on its side exactly.
    let n = lattice.points();
    let mut field = vec![f32::NAN; n.x as usize * n.y as usize * n.z as usize];
    let mut positions: Vec<DVec3> = Vec::new();
    let mut faces: Vec<[u32; 3]> = Vec::new();
    let mut crossings: HashMap<(usize, usize), u32> = HashMap::new();
    for block in lattice.each_block() {
        let Some(parts) = &near[lattice.block_index(block)] else { continue };
        let first = block * BLOCK;
        for z in 0..=BLOCK {
            for y in 0..=BLOCK {
                for x in 0..=BLOCK {
                    let p = first + IVec3::new(x, y, z);
                    let value = &mut field[lattice.point_index(p)];
                    if value.is_nan() {
                        *value = figure.distance(lattice.position(p), parts) as f32;
                    }
                }
            }
        }
        for z in 0..BLOCK {
            for y in 0..BLOCK {
                for x in 0..BLOCK {
                    let p = first + IVec3::new(x, y, z);
                    march_cell(&lattice, &field, p, &mut crossings, &mut positions, &mut faces);
                }
            }
        }
    }
    drop((field, crossings));
    let faces = largest_component(positions.len(), faces);
    let all = figure.all();
    let distance = |p: DVec3| figure.distance(p, near[lattice.block_at(p)].as_deref().unwrap_or(&all));
    relax(&mut positions, &faces, cell, distance);
    into_mesh(&positions, &faces)
}

/// Adds the faces of one cell.
fn march_cell(
    lattice: &Lattice,
    field: &[f32],
    cell: IVec3,
    crossings: &mut HashMap<(usize, usize), u32>,
    positions: &mut Vec<DVec3>,
    faces: &mut Vec<[u32; 3]>,
) {
    let corner =
        |bits: usize| cell + IVec3::new((bits & 1) as i32, (bits >> 1 & 1) as i32, (bits >> 2 & 1) as i32);
    let points: [IVec3; 8] = std::array::from_fn(corner);
    let indices = points.map(|p| lattice.point_index(p));
    let values = indices.map(|i| f64::from(field[i]));
    let inside = values.map(|v| v < 0.0);
    if inside == [inside[0]; 8] {
        return;
    }
    for tetrahedron in TETRAHEDRA {
        let (mut ins, mut outs) = (Vec::with_capacity(4), Vec::with_capacity(4));
        for corner in tetrahedron {
            if inside[corner] { ins.push(corner) } else { outs.push(corner) }
        }
        if ins.is_empty() || outs.is_empty() {
            continue;
        }
        let mut cross = |a: usize, b: usize| -> u32 {
            let (a, b) = if indices[a] < indices[b] { (a, b) } else { (b, a) };
            *crossings.entry((indices[a], indices[b])).or_insert_with(|| {
                let t = (values[a] / (values[a] - values[b])).clamp(EDGE_GUARD, 1.0 - EDGE_GUARD);
                positions.push(lattice.position(points[a]).lerp(lattice.position(points[b]), t));
                (positions.len() - 1) as u32
            })
        };
        let polygon: Vec<u32> = match (ins.as_slice(), outs.as_slice()) {
            (&[a], &[b, c, d]) | (&[b, c, d], &[a]) => vec![cross(a, b), cross(a, c), cross(a, d)],
            (&[a, b], &[c, d]) => vec![cross(a, c), cross(b, c), cross(b, d), cross(a, d)],
            _ => continue,
        };
        // Faces point from the inner corners to the outer ones. The midpoints of edges decide the winding exactly,
        // since they are multiples of half a cell.
        let middle =
            |set: &[usize]| set.iter().map(|&c| points[c].as_dvec3()).sum::<DVec3>() / set.len() as f64;
        let outwards = middle(&outs) - middle(&ins);
        let mid = |a: usize, b: usize| (points[a] + points[b]).as_dvec3() * 0.5;
        let normal = match (ins.as_slice(), outs.as_slice()) {
            (&[a], &[b, c, d]) | (&[b, c, d], &[a]) => (mid(a, c) - mid(a, b)).cross(mid(a, d) - mid(a, b)),
            (&[a, b], &[c, d]) => (mid(b, d) - mid(a, c)).cross(mid(a, d) - mid(b, c)),
            _ => continue,
        };
        let mut polygon = polygon;
        if normal.dot(outwards) < 0.0 {
            polygon.reverse();
        }
        faces.push([polygon[0], polygon[1], polygon[2]]);
        if polygon.len() == 4 {
            faces.push([polygon[0], polygon[2], polygon[3]]);
        }
    }
}

/// The faces of the component with most faces: spikes narrower than a cell can give small separate components.
fn largest_component(vertices: usize, faces: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
    let mut parent: Vec<u32> = (0..vertices as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for face in &faces {
        let a = root(&mut parent, face[0]);
        for v in &face[1..] {
            let b = root(&mut parent, *v);
            parent[b as usize] = a;
        }
    }
    let roots: Vec<u32> = faces.iter().map(|face| root(&mut parent, face[0])).collect();
    let mut counts = vec![0u32; vertices];
    for r in &roots {
        counts[*r as usize] += 1;
    }
    // The first of several largest, so that the choice is deterministic.
    let best = (0..vertices).max_by_key(|v| (counts[*v], std::cmp::Reverse(*v)));
    faces.into_iter().zip(roots).filter(|(_, r)| Some(*r as usize) == best).map(|(face, _)| face).collect()
}

fn vertex_normals(positions: &[DVec3], faces: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for face in faces {
        let [a, b, c] = face.map(|v| positions[v as usize]);
        let normal = (b - a).cross(c - a);
        for v in face {
            normals[*v as usize] += normal;
        }
    }
    normals.into_iter().map(|n| unit_or(n, DVec3::Y)).collect()
}

/// Moves vertices within the surface towards the mean of their neighbours, then back onto the field.
fn relax(positions: &mut [DVec3], faces: &[[u32; 3]], cell: f64, distance: impl Fn(DVec3) -> f64) {
    for round in 0..ROUNDS + 3 {
        let normals = vertex_normals(positions, faces);
        let mut sums = vec![(DVec3::ZERO, 0.0); positions.len()];
        for face in faces {
            for k in 0..3 {
                // Every edge of a closed mesh occurs twice, once in each direction.
                let (from, to) = (face[k] as usize, face[(k + 1) % 3] as usize);
                sums[from].0 += positions[to];
                sums[from].1 += 1.0;
            }
        }
        for (v, position) in positions.iter_mut().enumerate() {
            let normal = normals[v];
            if round < ROUNDS && sums[v].1 > 0.0 {
                let step = (sums[v].0 / sums[v].1 - *position) * 0.55;
                *position += step - normal * normal.dot(step);
            }
            // Half steps: where the relief is steep, the field grows up to twice as fast as the distance, and whole
            // steps would overshoot.
            let back = distance(*position).clamp(-0.5 * cell, 0.5 * cell);
            *position -= normal * back * 0.5;
        }
    }
}

fn into_mesh(positions: &[DVec3], faces: &[[u32; 3]]) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    let normals = vertex_normals(positions, faces);
    // Numbers vertices by first use; those of dropped components have no number.
    let mut number = vec![u32::MAX; positions.len()];
    for face in faces {
        let corners = face.map(|v| {
            let slot = &mut number[v as usize];
            if *slot == u32::MAX {
                *slot = mesh.position(positions[v as usize]);
                mesh.normals.push(normals[v as usize]);
            }
            Corner { position: *slot, uv: None, normal: *slot }
        });
        mesh.face(corners);
    }
    mesh
}
