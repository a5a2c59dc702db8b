//! One region of a level during its simplification.
//!
//! The region is copied to local arrays, so regions can be simplified in parallel and the result depends on the
//! region only. Only vertices whose complete star is in the region are removed or collapsed onto, so the outline is
//! unchanged.

use crate::collapse::NO_VERTEX;
use crate::collapse::{Collapse, MovedCorner, Records, RemovedFace};
use crate::mesh::corner;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::stars::Stars;
use crate::mesh::vec3::{Vec3, length, sub};
use crate::numbers::id32;
use crate::simplify::live::Live;
use crate::simplify::quadric::Quadric;
use crate::simplify::settings::Metric;
use crate::simplify::whole_components::{Group, MAX_DROPPED_VERTICES, WholeComponents};

/// A region's mesh, in local indices.
pub(crate) struct Region {
    pub(crate) metric: Metric,
    /// Global ids of the local vertices in the order in which faces refer to them, and of the faces, ascending.
    vertices: Vec<u32>,
    faces: Vec<u32>,
    pub(crate) interior: Vec<bool>,
    pub(crate) positions: Vec<Vec3>,
    /// Half the grid: see [`Live::middle`].
    middle: f64,
    quadrics: Vec<Quadric>,
    /// Each quadric evaluated at its own vertex.
    own_cost: Vec<f64>,
    reach: Vec<f64>,
    pub(crate) corners: Vec<[u32; 3]>,
    pub(crate) wedges: Vec<[u32; 3]>,
    pub(crate) stars: Stars,
    pub(crate) removed: Vec<bool>,
    /// Vertices that must not be removed.
    pub(crate) held: Vec<bool>,
    /// The components, if the mesh is divided into parts.
    pub(crate) groups: Vec<Group>,
    /// Group of each vertex; empty without groups.
    group_of: Vec<u32>,
    pub(crate) records: Records,
    highest_cost: f64,
    scratch: Scratch,
}

/// Buffers reused between collapses.
#[derive(Default)]
struct Scratch {
    star: Vec<u32>,
    /// Pairs of a removed vertex's wedge and the target's wedge that it meets across removed faces.
    meets: Vec<(u32, u32)>,
    isolated: Vec<u32>,
}

impl Region {
    /// Copies the region of the given faces. `is_interior` takes global vertex ids.
    pub(crate) fn new(
        live: &Live<'_>,
        faces: Vec<u32>,
        is_interior: &dyn Fn(u32) -> bool,
        metric: Metric,
    ) -> Self {
        let mut names = LocalVertices::new(faces.len());
        let corners: Vec<[u32; 3]> =
            faces.iter().map(|&f| live.face_vertices[f as usize].map(|v| names.local(v))).collect();
        let vertices = names.vertices;
        let mut stars = Stars::new(vertices.len(), faces.len());
        for (face, corner) in corners.iter().enumerate().rev() {
            for (k, &v) in corner.iter().enumerate() {
                stars.insert(v, (face * 3 + k) as u32);
            }
        }
        let positions: Vec<Vec3> = vertices.iter().map(|&v| live.positions[v as usize]).collect();
        let quadrics: Vec<Quadric> = vertices.iter().map(|&v| live.quadrics[v as usize]).collect();
        Self {
            metric,
            interior: vertices.iter().map(|&v| is_interior(v)).collect(),
            own_cost: quadrics.iter().zip(&positions).map(|(q, p)| q.evaluate(*p)).collect(),
            middle: live.middle(),
            reach: vertices.iter().map(|&v| live.reach[v as usize]).collect(),
            positions,
            quadrics,
            wedges: faces.iter().map(|&f| live.face_wedges[f as usize]).collect(),
            removed: vec![false; vertices.len()],
            held: vec![false; vertices.len()],
            groups: Vec::new(),
            group_of: Vec::new(),
            records: Records { first_added_wedge: live.wedges.len() as u32, ..Records::default() },
            highest_cost: 0.0,
            scratch: Scratch::default(),
            vertices,
            faces,
            corners,
            stars,
        }
    }

    pub(crate) fn vertex_count(&self) -> u32 {
        self.vertices.len() as u32
    }

    /// The cell of a vertex.
    pub(crate) fn cell(&self, v: u32) -> [i32; 3] {
        self.positions[v as usize].map(|x| (x + self.middle) as i32)
    }

    /// Cost of moving `u` onto `t` by both quadrics.
    pub(crate) fn quadric_cost(&self, u: u32, t: u32) -> f64 {
        self.quadrics[u as usize].evaluate(self.positions[t as usize]) + self.own_cost[t as usize]
    }

    /// Locks the vertices (global ids) that satisfy `holds`: neither they nor all their faces may be removed.
    pub(crate) fn hold(&mut self, holds: impl Fn(u32) -> bool) {
        for (held, &v) in self.held.iter_mut().zip(&self.vertices) {
            *held = holds(v);
        }
    }

    /// Groups the vertices by component. Call it after [`Self::hold`].
    pub(crate) fn group(&mut self, components: Option<&WholeComponents>) {
        let Some(components) = components else { return };
        let mut numbers = SlotMap::with_capacity(self.vertices.len());
        for (local, &vertex) in (0..).zip(&self.vertices) {
            let next = id32(self.groups.len());
            let number = numbers.number_or(components.number(vertex), next);
            if number == next {
                self.groups.push(components.group(vertex));
            }
            let group = &mut self.groups[number as usize];
            group.vertices.push(local);
            let free = self.interior[local as usize] && !self.held[local as usize];
            if !free || components.vertices(vertex) > MAX_DROPPED_VERTICES {
                group.drop_cost = f64::INFINITY;
            }
            self.group_of.push(number);
        }
    }

    /// The group of a vertex.
    pub(crate) fn group_of(&self, vertex: u32) -> Option<&Group> {
        self.groups.get(*self.group_of.get(vertex as usize)? as usize)
    }

    /// Whether collapsing `u` onto `t` would take away an end of its component.
    pub(crate) fn shrinks(&self, u: u32, t: u32) -> bool {
        let [from, to] = [u, t].map(|v| self.positions[v as usize]);
        self.group_of(u).is_some_and(|group| group.extent.shrinks(from, to, group.most_shrinkage))
    }

    /// Collapses an outline vertex onto an interior one although other regions keep it: see
    /// [`crate::Settings::unlock_outlines`].
    pub(crate) fn tear_outline(&mut self) {
        for u in (0..self.vertex_count()).filter(|&u| !self.interior[u as usize]) {
            let neighbours = self.stars.corners(u).flat_map(|c| self.corners[corner::face_of(c) as usize]);
            if let Some(t) = neighbours.filter(|&t| self.interior[t as usize]).min() {
                self.collapse(u, t, 0.0);
                return;
            }
        }
    }

    /// Collapses `u` onto `t`. Both must be interior and adjacent.
    pub(crate) fn collapse(&mut self, u: u32, t: u32, cost: f64) {
        let mut scratch = std::mem::take(&mut self.scratch);
        self.collect_star(u, t, &mut scratch);
        self.stars.clear(u);
        let first_removed = self.records.removed.len();
        for &corner in &scratch.star {
            let (face, k) = (corner::face_of(corner) as usize, corner::side_of(corner));
            if self.corners[face].contains(&t) {
                self.remove_face(face, k, t, &mut scratch.isolated);
            } else {
                self.move_corner(face, k, t, &mut scratch.meets);
            }
        }
        let quadric = self.quadrics[u as usize];
        self.quadrics[t as usize].add(&quadric);
        self.own_cost[t as usize] = self.quadrics[t as usize].evaluate(self.positions[t as usize]);
        self.removed[u as usize] = true;
        self.highest_cost = self.highest_cost.max(cost);
        self.extend_reach(u, t);
        self.record_third_vertices(t, first_removed);
        self.record(self.vertices[u as usize], self.vertices[t as usize]);
        for &v in &scratch.isolated {
            if self.interior[v as usize] && !self.removed[v as usize] && self.stars.is_empty(v) {
                self.removed[v as usize] = true;
                self.record(self.vertices[v as usize], NO_VERTEX);
            }
        }
        self.scratch = scratch;
    }

    /// Collects the star of `u` in face order, and the wedges that meet across removed faces.
    fn collect_star(&self, u: u32, t: u32, scratch: &mut Scratch) {
        scratch.isolated.clear();
        scratch.meets.clear();
        scratch.star.clear();
        scratch.star.extend(self.stars.corners(u));
        scratch.star.sort_unstable();
        for &corner in &scratch.star {
            let (face, k) = (corner::face_of(corner) as usize, corner::side_of(corner));
            if let Some(j) = (0..3).find(|&j| self.corners[face][j] == t) {
                let (from, to) = (self.wedges[face][k], self.wedges[face][j]);
                if !scratch.meets.iter().any(|m| m.0 == from) {
                    scratch.meets.push((from, to));
                }
            }
        }
    }

    fn remove_face(&mut self, face: usize, k: usize, t: u32, isolated: &mut Vec<u32>) {
        let corners = self.corners[face];
        let third = corners.into_iter().find(|&v| v != corners[k] && v != t);
        self.records.removed.push(RemovedFace::new(self.faces[face], third));
        for j in (0..3).filter(|&j| j != k) {
            self.stars.remove(corners[j], (face * 3 + j) as u32);
            if self.stars.is_empty(corners[j]) {
                isolated.push(corners[j]);
            }
        }
    }

    fn move_corner(&mut self, face: usize, k: usize, t: u32, meets: &mut Vec<(u32, u32)>) {
        let from = self.wedges[face][k];
        let to = match meets.iter().find(|m| m.0 == from) {
            Some(&(_, to)) => to,
            None => {
                let kept = self.records.first_added_wedge + self.records.added_wedges.len() as u32;
                self.records.added_wedges.push(from);
                meets.push((from, kept));
                kept
            }
        };
        self.records.moved.push(MovedCorner { face: self.faces[face], from, to });
        self.corners[face][k] = t;
        self.wedges[face][k] = to;
        self.stars.insert(t, (face * 3 + k) as u32);
    }

    fn extend_reach(&mut self, u: u32, t: u32) {
        let step = length(sub(self.positions[u as usize], self.positions[t as usize]));
        let reach = self.reach[t as usize].max(self.reach[u as usize] + step);
        self.reach[t as usize] = reach;
        self.records.reach = self.records.reach.max(reach);
    }

    /// Records third vertices of removed faces that a split could not find among the neighbours of `t`.
    fn record_third_vertices(&mut self, t: u32, first_removed: usize) {
        for i in first_removed..self.records.removed.len() {
            let RemovedFace { face, .. } = self.records.removed[i];
            let Some(x) = self.records.removed[i].third() else { continue };
            // From the third vertex's side, since the target is more often the one of high valence.
            let found = self.stars.corners(x).any(|c| self.corners[corner::face_of(c) as usize].contains(&t));
            let third = (!found).then_some(self.vertices[x as usize]);
            self.records.removed[i] = RemovedFace::new(face, third);
            if !found {
                // The face has shrunk to an edge without faces, so its points may be far from any face.
                self.records.reach = f64::INFINITY;
            }
        }
    }

    fn record(&mut self, removed: u32, target: u32) {
        self.records.costs.push(self.highest_cost);
        self.records.collapses.push(Collapse {
            removed,
            target,
            moved_end: self.records.moved.len() as u32,
            removed_end: self.records.removed.len() as u32,
            added_wedges_end: self.records.added_wedges.len() as u32,
        });
    }
}

/// Numbers vertices in order of first use.
struct LocalVertices {
    names: SlotMap,
    vertices: Vec<u32>,
}

impl LocalVertices {
    fn new(faces: usize) -> Self {
        Self { names: SlotMap::with_capacity(3 * faces), vertices: Vec::with_capacity(faces) }
    }

    fn local(&mut self, vertex: u32) -> u32 {
        let next = self.vertices.len() as u32;
        let name = self.names.number_or(vertex, next);
        if name == next {
            self.vertices.push(vertex);
        }
        name
    }
}
