//! Preserves the extent of large, thin components.
//!
//! A wall, step or beam thinner than the base mesh's error costs quadrics almost nothing, so simplification would
//! leave fragments of it, however large it is on the screen. So the corners of such components are locked at all
//! levels; of a box, the box remains.

use crate::mesh::QuantisedMesh;
use crate::mesh::components::components;
use crate::mesh::principal_axes::principal_axes;
use crate::mesh::vec3::{Vec3, dot, length, sub};
use crate::simplify::deviation::extend;
use crate::simplify::live::Live;

/// Diagonal of a large component, as a share of the mesh's.
const LARGE: f64 = 0.08;
/// A component is thin if its smallest side is below this multiple of the base mesh's error.
const THIN: f64 = 2.0;
/// Most components with locked corners, largest first; each costs some 60 bytes of base mesh.
const MAX_PARTS: usize = 64;

/// The vertices nearest to the corners of large, thin components, ascending. `error` is the base mesh's and
/// `diagonal` the mesh's, in grid cells.
pub(crate) fn corners_to_hold(live: &Live<'_>, error: f64, diagonal: f64) -> Vec<u32> {
    let component = components(live.positions.len(), &live.face_vertices);
    let mut vertices: Vec<u32> = (0..live.positions.len() as u32).collect();
    vertices.sort_by_key(|&v| component[v as usize]);
    let mut parts: Vec<Part<'_>> = vertices
        .chunk_by(|&a, &b| component[a as usize] == component[b as usize])
        // A mesh of one component keeps its extent to within the base mesh's error anyway.
        .filter(|part| part.len() > 3 && part.len() < vertices.len())
        .map(|part| Part::new(live, part))
        .filter(|part| part.diagonal() > LARGE * diagonal && part.thickness() <= THIN * error)
        .collect();
    parts.sort_by(|a, b| b.diagonal().total_cmp(&a.diagonal()));
    let mut held: Vec<u32> = parts.iter().take(MAX_PARTS).flat_map(Part::corners).collect();
    held.sort_unstable();
    held.dedup();
    held
}

/// Diagonal of the bounding box in grid cells.
pub(crate) fn diagonal(mesh: &QuantisedMesh) -> f64 {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for p in &mesh.positions {
        extend(&mut bounds, p.map(f64::from));
    }
    length(sub(bounds[1], bounds[0]))
}

/// A component with its box along its principal axes.
struct Part<'a> {
    live: &'a Live<'a>,
    vertices: &'a [u32],
    axes: [Vec3; 3],
    low: Vec3,
    high: Vec3,
}

impl<'a> Part<'a> {
    fn new(live: &'a Live<'a>, vertices: &'a [u32]) -> Self {
        let axes = principal_axes(vertices.iter().map(|&v| live.positions[v as usize]));
        let (low, high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let mut part = Self { live, vertices, axes, low, high };
        for &v in vertices {
            let at = part.along(v);
            part.low = [0, 1, 2].map(|k| part.low[k].min(at[k]));
            part.high = [0, 1, 2].map(|k| part.high[k].max(at[k]));
        }
        part
    }

    /// A vertex's coordinates along the axes.
    fn along(&self, vertex: u32) -> Vec3 {
        self.axes.map(|axis| dot(axis, self.live.positions[vertex as usize]))
    }

    fn sides(&self) -> Vec3 {
        [0, 1, 2].map(|k| self.high[k] - self.low[k])
    }

    fn diagonal(&self) -> f64 {
        length(self.sides())
    }

    fn thickness(&self) -> f64 {
        self.sides().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// For each corner of the box, the vertex farthest in that direction, with sides scaled to equal length.
    fn corners(&self) -> impl Iterator<Item = u32> {
        // A flat component has no extent along one axis.
        let shares = self.sides().map(|side| if side > 0.0 { 1.0 / side } else { 0.0 });
        (0..8_u32).filter_map(move |corner| {
            let signed = [0, 1, 2].map(|k| if corner >> k & 1 == 1 { shares[k] } else { -shares[k] });
            let farness = |v: u32| dot(signed, self.along(v));
            let vertices = self.vertices.iter().copied();
            vertices.max_by(|&a, &b| farness(a).total_cmp(&farness(b)).then(b.cmp(&a)))
        })
    }
}
