//! The encoder's plan of a chunk: a region's collapses reversed, as a forest of vertex splits.
//!
//! The order of the splits between two truncation points is free, as long as a vertex exists before it splits. The
//! coder visits the forest (by the vertex that each splits from) breadth first, and the stars are those of the mesh
//! in which exactly the splits so far are done, whether or not simplification passed through that mesh: a corner is
//! at the newest existing vertex on its path, and a face exists once its three corners are distinct.

use std::collections::VecDeque;

use crate::codec::local::Local;
use crate::codec::numbering::{BuilderMap, Numbering};
use crate::codec::source::Source;
use crate::collapse::NO_VERTEX;
use crate::collapse::Placed;
use crate::collapse::Records;
use crate::collapse::RemovedFace;
use crate::mesh::corner;
use crate::numbers::id32;

/// A vertex that is not yet split off.
struct PendingVertex {
    /// The vertex that represents it.
    parent: u32,
    /// Its wedges, each with the parent's wedge that represents it.
    wedges: Vec<(u32, u32)>,
}

/// A face that a split adds.
#[derive(Clone, Copy)]
pub(crate) struct SplitFace {
    /// Builder's face.
    pub(crate) face: u32,
    /// Local number of the corner that is neither the split nor the new vertex.
    pub(crate) x: u32,
    /// Orientation: (split vertex, x, new vertex), else (new, x, split).
    pub(crate) left: bool,
}

/// The wedge to encode at a corner.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum TargetWedge {
    /// An existing one, by local number.
    Known(u32),
    /// A new one, by the builder's number.
    New(u32),
}

/// The splits of one region to encode.
pub(crate) struct SplitPlan<'a> {
    pub(crate) source: &'a Source<'a>,
    records: &'a Records,
    /// Ends of the segments as collapse counts, from the coarsest segment's start down to 0.
    ends: Vec<usize>,
    pub(crate) names: Numbering,
    /// Wedges of the faces that this chunk touches, at the end of the current segment.
    state: BuilderMap<[u32; 3]>,
    pending_vertices: BuilderMap<PendingVertex>,
    children: BuilderMap<VecDeque<u32>>,
    /// Faces that do not exist yet, by a vertex that represents two of their corners.
    pending: BuilderMap<Vec<u32>>,
    current: (u32, u32),
    /// One wedge of each vertex involved.
    any_wedge: BuilderMap<u32>,
}

impl<'a> SplitPlan<'a> {
    pub(crate) fn new(source: &'a Source<'a>) -> Self {
        let records = source.records;
        let mut ends = vec![records.collapses.len()];
        ends.extend(records.truncation_points[records.coded_truncation_points()].iter().map(|&s| s as usize));
        ends.push(0);
        Self {
            source,
            records,
            ends,
            names: Numbering::default(),
            state: BuilderMap::default(),
            pending_vertices: BuilderMap::default(),
            children: BuilderMap::default(),
            pending: BuilderMap::default(),
            current: (NO_VERTEX, NO_VERTEX),
            any_wedge: BuilderMap::default(),
        }
    }

    /// Vertices without faces that the chunk starts with, in decoding order.
    pub(crate) fn isolated_vertices(&self) -> Vec<u32> {
        let isolated = self.records.collapses.iter().rev().filter(|c| c.target == NO_VERTEX);
        let mut isolated: Vec<u32> = isolated.map(|c| c.removed).collect();
        // By part, so that the steps between the parts' numbers are small.
        isolated.sort_by_key(|&vertex| self.source.part(vertex));
        isolated
    }

    /// Number of splits in each segment, coarse to fine.
    pub(crate) fn segments(&self) -> Vec<u32> {
        self.ends
            .windows(2)
            .map(|e| {
                id32(self.records.collapses[e[1]..e[0]].iter().filter(|c| c.target != NO_VERTEX).count())
            })
            .collect()
    }

    /// New position of an existing vertex (local number), if it moves.
    pub(crate) fn moving(&self, vertex: u32) -> Option<Placed> {
        let (moves, name) = (self.source.moves, self.names.vertices[vertex as usize]);
        moves.binary_search_by_key(&name, |m| m.vertex).ok().map(|at| moves[at])
    }

    /// Vertices that must be gathered before the first split, ascending.
    pub(crate) fn needed(&self) -> Vec<u32> {
        let mut needed = Vec::new();
        let mut made: Vec<u32> = Vec::new();
        for index in 0..self.records.collapses.len() {
            let (collapse, _, removed) = self.records.parts(index);
            made.push(collapse.removed);
            if collapse.target != NO_VERTEX {
                needed.push(collapse.target);
                needed.extend(removed.iter().flat_map(RemovedFace::third));
            }
        }
        needed.extend(self.source.moves.iter().map(|m| m.vertex));
        made.sort_unstable();
        needed.sort_unstable();
        needed.dedup();
        needed.retain(|v| made.binary_search(v).is_err());
        needed
    }

    fn vertex_of(&self, wedge: u32) -> u32 {
        self.source.wedges.get(wedge).vertex
    }

    /// Builds the forest of a segment. The region must be gathered.
    pub(crate) fn begin_segment(&mut self, segment: usize, local: &Local<'_>) {
        if segment == 0 {
            for (face, &name) in local.faces.iter().zip(&self.names.faces) {
                self.state.insert(name, face.wedges.map(|w| self.names.wedges[w as usize]));
            }
        }
        let mut born = Vec::new();
        for index in (self.ends[segment + 1]..self.ends[segment]).rev() {
            let (collapse, moved, removed) = self.records.parts(index);
            let (u, t) = (collapse.removed, collapse.target);
            if t == NO_VERTEX {
                continue;
            }
            let mut wedges: Vec<(u32, u32)> = Vec::new();
            let mut stands = |from: u32, to: u32| {
                if !wedges.iter().any(|w| w.0 == from) {
                    wedges.push((from, to));
                }
            };
            for m in moved {
                stands(m.from, m.to);
                if let Some(corners) = self.state.get_mut(&m.face)
                    && let Some(corner) = corners.iter_mut().find(|w| **w == m.to)
                {
                    *corner = m.from;
                }
            }
            for (r, &vanished) in removed.iter().zip(self.records.removed_wedges(index)) {
                let at = |vertex: u32| vanished.into_iter().find(|&w| self.vertex_of(w) == vertex);
                if let (Some(from), Some(to)) = (at(u), at(t)) {
                    stands(from, to);
                }
                for w in vanished {
                    self.any_wedge.entry(self.vertex_of(w)).or_insert(w);
                }
                self.state.insert(r.face, vanished);
                born.push(r.face);
            }
            self.children.entry(t).or_default().push_back(u);
            self.pending_vertices.insert(u, PendingVertex { parent: t, wedges });
        }
        for face in born {
            self.wait(face);
        }
    }

    /// The existing vertex that represents a vertex now.
    fn representative(&self, mut vertex: u32) -> u32 {
        while let Some(pending_vertices) = self.pending_vertices.get(&vertex) {
            vertex = pending_vertices.parent;
        }
        vertex
    }

    /// Stores a face that does not exist yet under the vertex that represents two of its corners; returns its corners
    /// if they are distinct.
    fn wait(&mut self, face: u32) -> Option<[u32; 3]> {
        let corners = self.state[&face].map(|w| self.representative(self.vertex_of(w)));
        let [a, b, c] = corners;
        let pair = if a == b || a == c { a } else { b };
        if a != b && b != c && a != c {
            return Some(corners);
        }
        self.pending.entry(pair).or_default().push(face);
        None
    }

    /// Whether a vertex (local number) splits again in this segment.
    pub(crate) fn splits(&self, vertex: u32) -> bool {
        self.children.get(&self.names.vertices[vertex as usize]).is_some_and(|c| !c.is_empty())
    }

    /// Starts the next split of a vertex; returns the faces that it adds.
    pub(crate) fn begin_split(&mut self, vertex: u32) -> Vec<SplitFace> {
        let t = self.names.vertices[vertex as usize];
        let Some(u) = self.children.get_mut(&t).and_then(VecDeque::pop_front) else { return Vec::new() };
        self.current = (t, u);
        let mut born = Vec::new();
        self.pending_vertices.remove(&u);
        for face in self.pending.remove(&t).unwrap_or_default() {
            if let Some(corners) = self.wait(face)
                && let Some(at) = corners.iter().position(|&v| v == u)
            {
                let third = corners.into_iter().find(|&v| v != u && v != t).unwrap_or(u);
                born.push(SplitFace {
                    face,
                    x: self.names.local_vertex.get(&third).copied().unwrap_or(vertex),
                    left: corners[corner::next(at)] == t,
                });
            }
        }
        born
    }

    /// Whether a face of the split vertex (local number) moves to the new one.
    pub(crate) fn moves(&self, face: u32) -> bool {
        let corners = self.state.get(&self.names.faces[face as usize]);
        corners.is_some_and(|w| w.iter().any(|&w| self.representative(self.vertex_of(w)) == self.current.1))
    }

    pub(crate) fn new_vertex(&self) -> u32 {
        self.current.1
    }

    /// The wedge to encode at a vertex (local number) of a builder's face.
    pub(crate) fn wedge(&self, face: u32, vertex: u32, guess: Option<u32>, own: Option<u32>) -> TargetWedge {
        let vertex = self.names.vertices[vertex as usize];
        let found = self.state.get(&face).and_then(|wedges| {
            let &w = wedges.iter().find(|&&w| self.representative(self.vertex_of(w)) == vertex)?;
            self.representative_wedge(w, vertex)
        });
        if let Some(wedge) = found {
            return self
                .names
                .local_wedge
                .get(&wedge)
                .map_or(TargetWedge::New(wedge), |&w| TargetWedge::Known(w));
        }
        // No collapse determines the wedge of a face that did not exist then. Any wedge will do, since the corner
        // moves later.
        match guess.or(own) {
            Some(known) => TargetWedge::Known(known),
            None => self.any_wedge.get(&vertex).map_or(TargetWedge::Known(0), |&w| TargetWedge::New(w)),
        }
    }

    fn representative_wedge(&self, mut wedge: u32, vertex: u32) -> Option<u32> {
        loop {
            let at = self.vertex_of(wedge);
            if at == vertex {
                return Some(wedge);
            }
            let pending_vertices = self.pending_vertices.get(&at)?;
            wedge = pending_vertices.wedges.iter().find(|w| w.0 == wedge)?.1;
        }
    }
}
