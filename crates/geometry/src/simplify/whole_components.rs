//! Simplification of meshes that are divided into parts: a component keeps its shape or vanishes.
//!
//! Quadrics alone first turn each of thousands of boxes into a tetrahedron, then each tetrahedron into nothing: coarse
//! levels show shards. Here a collapse may deform a component by a share of its size only. What would deform it more
//! waits until dropping the whole component costs no more than other collapses, small components first.
//!
//! The error limit alone would let a wall vanish wherever a window or a moulding is left within the limit. So the
//! largest components stay if a surface of their area is visible at the limit, and no collapse moves such an area by
//! more than the limit.

use crate::mesh::components::components;
use crate::mesh::vec3::{Vec3, add, dot, length, scale, sub, triangle_normal};
use crate::simplify::deviation::extend;
use crate::simplify::live::Live;

/// Largest deformation of a component, as a share of its diagonal. A component of this share as thickness becomes a
/// sheet.
const MOST_DEFORMATION: f64 = 0.06;
/// How far the ends of a component may recede, as a share of the visible side: corners of joined walls stay straight.
const MOST_SHRINKAGE: f64 = 0.6;
/// Most components that are not dropped for their area, the largest: of thousands of walls some must vanish.
const MOST_KEPT: usize = 256;
/// Distance at which the cost of a vanished component's surface counts, as a share of its diagonal.
const DROP_DISTANCE: f64 = 0.125;
/// Components of at most this many faces lie in one region where possible.
const MAX_TOGETHER: u32 = 256;
/// Components of more vertices are not dropped at once: the cheapest collapse is searched among all of them.
pub(crate) const MAX_DROPPED_VERTICES: u32 = 128;

/// A component, or what a region has of it.
pub(crate) struct Group {
    pub(crate) vertices: Vec<u32>,
    /// The largest cost of a collapse.
    pub(crate) most_cost: f64,
    /// The extent at the level's start, and by how much a collapse may reduce it.
    pub(crate) extent: Extent,
    pub(crate) most_shrinkage: f64,
    /// The cost of dropping it; infinite if it must stay.
    pub(crate) drop_cost: f64,
}

/// The components of the remaining mesh.
pub(crate) struct WholeComponents {
    /// Component of each vertex; meaningless for removed ones.
    of_vertex: Vec<u32>,
    components: Vec<Component>,
    visible: Visible,
    /// Components of more than this area are not dropped.
    kept_area: f64,
}

#[derive(Clone, Copy)]
struct Component {
    vertices: u32,
    faces: u32,
    bounds: [Vec3; 2],
    extent: Extent,
    area: f64,
}

/// The axes and the diagonals of a cube.
const DIRECTIONS: [Vec3; 7] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.57, 0.57, 0.57],
    [0.57, 0.57, -0.57],
    [0.57, -0.57, 0.57],
    [-0.57, 0.57, 0.57],
];

/// The extent of a component in seven directions (a 14-DOP, after Klosowski and others, "Efficient collision detection
/// using bounding volume hierarchies of k-DOPs", 1998).
#[derive(Clone, Copy)]
pub(crate) struct Extent {
    low: [f64; DIRECTIONS.len()],
    high: [f64; DIRECTIONS.len()],
}

impl Extent {
    const NONE: Self = Self { low: [f64::INFINITY; 7], high: [f64::NEG_INFINITY; 7] };

    fn note(&mut self, place: Vec3) {
        for (k, direction) in DIRECTIONS.into_iter().enumerate() {
            let at = dot(direction, place);
            self.low[k] = self.low[k].min(at);
            self.high[k] = self.high[k].max(at);
        }
    }

    /// Whether a vertex leaves an end of the component by more than `most`. The quadrics of a thin component hardly
    /// resist that, since its ends have little area.
    pub(crate) fn shrinks(&self, from: Vec3, to: Vec3, most: f64) -> bool {
        DIRECTIONS.into_iter().enumerate().any(|(k, direction)| {
            let (from, to) = (dot(direction, from), dot(direction, to));
            (from > self.high[k] - most && to < self.high[k] - most)
                || (from < self.low[k] + most && to > self.low[k] + most)
        })
    }
}

/// What is visible when the error is the largest one.
#[derive(Clone, Copy)]
pub(crate) struct Visible {
    /// The largest error of any level.
    pub(crate) limit: f64,
    /// Side of a visible square ([`crate::Settings::visible_side`]).
    pub(crate) side: f64,
}

/// The area above which components are kept: that of two visible squares, front and back.
fn kept_area(components: &[Component], visible: Visible) -> f64 {
    let visible = 2.0 * visible.side * visible.side;
    let mut areas: Vec<f64> = components.iter().map(|component| component.area).collect();
    if areas.len() <= MOST_KEPT {
        return visible;
    }
    visible.max(*areas.select_nth_unstable_by(MOST_KEPT, |a, b| b.total_cmp(a)).1)
}

impl WholeComponents {
    pub(crate) fn new(live: &Live<'_>, visible: Visible) -> Self {
        let faces: Vec<[u32; 3]> = live.faces.iter().map(|&f| live.face_vertices[f as usize]).collect();
        let roots = components(live.positions.len(), &faces);
        let mut of_vertex = vec![0; roots.len()];
        let none = Component {
            vertices: 0,
            faces: 0,
            bounds: [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]],
            extent: Extent::NONE,
            area: 0.0,
        };
        let mut components = Vec::new();
        for (vertex, &root) in roots.iter().enumerate() {
            if live.stars.row(vertex as u32).is_empty() {
                continue;
            }
            // The root is the smallest vertex, so its number is known.
            if root as usize == vertex {
                of_vertex[vertex] = components.len() as u32;
                components.push(none);
            }
            let number = of_vertex[root as usize];
            of_vertex[vertex] = number;
            let component = &mut components[number as usize];
            component.vertices += 1;
            extend(&mut component.bounds, live.positions[vertex]);
            component.extent.note(live.positions[vertex]);
        }
        for &face in &faces {
            let [a, b, c] = face.map(|v| live.positions[v as usize]);
            let component: &mut Component = &mut components[of_vertex[face[0] as usize] as usize];
            component.faces += 1;
            component.area += 0.5 * length(triangle_normal(a, b, c));
        }
        let kept_area = kept_area(&components, visible);
        Self { of_vertex, components, visible, kept_area }
    }

    fn component(&self, vertex: u32) -> &Component {
        &self.components[self.of_vertex[vertex as usize] as usize]
    }

    /// Number of a vertex's component.
    pub(crate) fn number(&self, vertex: u32) -> u32 {
        self.of_vertex[vertex as usize]
    }

    /// Number of vertices of a vertex's component.
    pub(crate) fn vertices(&self, vertex: u32) -> u32 {
        self.component(vertex).vertices
    }

    /// The diagonal of the bounding box of a vertex's component.
    pub(crate) fn diagonal(&self, vertex: u32) -> f64 {
        let [low, high] = self.component(vertex).bounds;
        length(sub(high, low))
    }

    /// A group for a vertex's component, still empty.
    pub(crate) fn group(&self, vertex: u32) -> Group {
        let (component, size) = (self.component(vertex), self.diagonal(vertex));
        let cost = |share: f64| component.area * (share * size) * (share * size);
        let is_kept = component.area > self.kept_area;
        Group {
            vertices: Vec::new(),
            most_cost: cost(MOST_DEFORMATION).min(self.kept_area * self.visible.limit * self.visible.limit),
            extent: component.extent,
            most_shrinkage: (MOST_DEFORMATION * size).min(MOST_SHRINKAGE * self.visible.side),
            drop_cost: if is_kept { f64::INFINITY } else { cost(DROP_DISTANCE) },
        }
    }

    /// The place by which a face is assigned to a region, if it is that of its component.
    pub(crate) fn place(&self, face: [u32; 3]) -> Option<Vec3> {
        let component = self.component(face[0]);
        let [low, high] = component.bounds;
        (component.faces <= MAX_TOGETHER).then(|| scale(add(low, high), 0.5))
    }
}
