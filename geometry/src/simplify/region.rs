//! Simplifies one region of a level: half-edge collapses between interior vertices, cheapest first.
//!
//! The region is copied into local arrays, so regions can be simplified at the same time and the
//! result depends on nothing but the region. Only vertices whose whole star lies in the region are
//! removed or collapsed onto: the outline stays as it is.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use crate::simplify::legality::Rules;
use crate::simplify::live::{Live, NO_VERTEX};
use crate::simplify::quadric::Quadric;
use crate::simplify::records::{Collapse, Moved, Records, Removed};
use crate::stars::Stars;
use crate::vec3::{Vec3, dot, sub};

/// Gives edges of flat areas an order: cost per fourth power of the edge length (a point quadric
/// would do the same; this needs no memory).
const FLAT_ORDER: f64 = 1e-9;
/// No collapse.
const NONE: u32 = u32::MAX;

/// A region's mesh, in local indices.
pub(crate) struct Region {
    /// Global ids of the local vertices and faces, ascending.
    pub(crate) vertices: Vec<u32>,
    pub(crate) faces: Vec<u32>,
    pub(crate) interior: Vec<bool>,
    pub(crate) positions: Vec<Vec3>,
    quadrics: Vec<Quadric>,
    pub(crate) corners: Vec<[u32; 3]>,
    pub(crate) wedges: Vec<[u32; 3]>,
    pub(crate) stars: Stars,
    gone: Vec<bool>,
    /// Counts the collapses onto a vertex, so that queued candidates can tell that they are stale.
    version: Vec<u32>,
    /// Last collapse that used a face, and that took a face from a vertex, or [`NONE`].
    face_last: Vec<u32>,
    vertex_last: Vec<u32>,
    records: Records,
    highest_cost: f64,
}

/// A queued collapse.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    cost: f64,
    removed: u32,
    target: u32,
    versions: u32,
    penalised: bool,
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    /// Cheapest is greatest, for a max-heap; ties by ids, so the order is total and repeatable.
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .cost
            .total_cmp(&self.cost)
            .then(other.removed.cmp(&self.removed))
            .then(other.target.cmp(&self.target))
    }
}

impl Region {
    /// Copies the region of the given faces. `is_interior` answers by global vertex id.
    pub(crate) fn new(live: &Live, faces: Vec<u32>, is_interior: &dyn Fn(u32) -> bool) -> Self {
        let mut vertices: Vec<u32> = faces.iter().flat_map(|&f| live.face_vertices[f as usize]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let local = |v: u32| vertices.binary_search(&v).map_or(0, |i| i as u32);
        let corners: Vec<[u32; 3]> =
            faces.iter().map(|&f| live.face_vertices[f as usize].map(local)).collect();
        let mut stars = Stars::new(vertices.len(), faces.len());
        for (face, corner) in corners.iter().enumerate().rev() {
            for (k, &v) in corner.iter().enumerate() {
                stars.insert(v, (face * 3 + k) as u32);
            }
        }
        Self {
            interior: vertices.iter().map(|&v| is_interior(v)).collect(),
            positions: vertices.iter().map(|&v| live.positions[v as usize]).collect(),
            quadrics: vertices.iter().map(|&v| live.quadrics[v as usize]).collect(),
            wedges: faces.iter().map(|&f| live.face_wedges[f as usize]).collect(),
            gone: vec![false; vertices.len()],
            version: vec![0; vertices.len()],
            face_last: vec![NONE; faces.len()],
            vertex_last: vec![NONE; vertices.len()],
            records: Records { first_kept: live.wedges.len() as u32, ..Records::default() },
            highest_cost: 0.0,
            vertices,
            faces,
            corners,
            stars,
        }
    }

    /// Collapses until `limit` vertices are gone or nothing more is allowed: strictly first, then by
    /// the relaxed rules.
    pub(crate) fn simplify(mut self, limit: usize) -> Records {
        for rules in [Rules::strict(), Rules::relaxed()] {
            self.run(limit, rules);
        }
        self.records
    }

    /// Collapses one outline vertex onto an interior one, although other regions keep it: see
    /// [`crate::Settings::unlock_outlines`].
    pub(crate) fn tear_outline(&mut self) {
        let mut ring = Vec::new();
        for u in (0..self.vertices.len() as u32).filter(|&u| !self.interior[u as usize]) {
            self.ring(u, &mut ring);
            if let Some(&t) = ring.iter().find(|&&t| self.interior[t as usize]) {
                self.collapse(u, t, 0.0);
                return;
            }
        }
    }

    fn run(&mut self, limit: usize, mut rules: Rules) {
        let mut heap = BinaryHeap::new();
        let mut ring = Vec::new();
        for v in 0..self.vertices.len() as u32 {
            if self.interior[v as usize] && !self.gone[v as usize] {
                self.ring(v, &mut ring);
                for &w in &ring {
                    self.push(&mut heap, v, w);
                }
            }
        }
        while self.records.collapses.len() < limit {
            let Some(candidate) = heap.pop() else { break };
            let (u, t) = (candidate.removed, candidate.target);
            if self.gone[u as usize]
                || self.gone[t as usize]
                || candidate.versions != self.version[u as usize] + self.version[t as usize]
            {
                continue;
            }
            let Some(penalty) = rules.penalty(self, u, t) else { continue };
            if penalty > 0.0 && !candidate.penalised {
                heap.push(Candidate { cost: candidate.cost + penalty, penalised: true, ..candidate });
                continue;
            }
            self.collapse(u, t, candidate.cost);
            self.ring(t, &mut ring);
            for &w in &ring {
                self.push(&mut heap, w, t);
                self.push(&mut heap, t, w);
            }
        }
    }

    fn push(&self, heap: &mut BinaryHeap<Candidate>, u: u32, t: u32) {
        if !self.interior[u as usize] || !self.interior[t as usize] {
            return;
        }
        let mut quadric = self.quadrics[t as usize];
        quadric.add(&self.quadrics[u as usize]);
        let at = self.positions[t as usize];
        let edge = sub(self.positions[u as usize], at);
        let square = dot(edge, edge);
        heap.push(Candidate {
            cost: quadric.evaluate(at) + FLAT_ORDER * square * square,
            removed: u,
            target: t,
            versions: self.version[u as usize] + self.version[t as usize],
            penalised: false,
        });
    }

    /// The distinct neighbours of `v`, ascending.
    pub(crate) fn ring(&self, v: u32, ring: &mut Vec<u32>) {
        ring.clear();
        for corner in self.stars.corners(v) {
            let (face, k) = ((corner / 3) as usize, (corner % 3) as usize);
            ring.push(self.corners[face][(k + 1) % 3]);
            ring.push(self.corners[face][(k + 2) % 3]);
        }
        ring.sort_unstable();
        ring.dedup();
    }

    fn collapse(&mut self, u: u32, t: u32, cost: f64) {
        let mut star: Vec<u32> = self.stars.corners(u).collect();
        star.sort_unstable();
        // Which wedge of t each wedge of u meets across the removed faces.
        let mut meets: Vec<(u32, u32)> = Vec::new();
        for &corner in &star {
            let (face, k) = ((corner / 3) as usize, (corner % 3) as usize);
            if let Some(j) = (0..3).find(|&j| self.corners[face][j] == t) {
                let (from, to) = (self.wedges[face][k], self.wedges[face][j]);
                if !meets.iter().any(|m| m.0 == from) {
                    meets.push((from, to));
                }
            }
        }
        self.book(u, t);
        let index = self.records.collapses.len() as u32;
        self.stars.clear(u);
        let mut lonely = Vec::new();
        let first_removed = self.records.removed.len();
        for &corner in &star {
            let (face, k) = ((corner / 3) as usize, (corner % 3) as usize);
            if self.corners[face].contains(&t) {
                let third = self.corners[face].into_iter().find(|&v| v != u && v != t);
                self.records.removed.push(Removed {
                    face: self.faces[face],
                    wedges: self.wedges[face],
                    third,
                });
                for j in (0..3).filter(|&j| j != k) {
                    let v = self.corners[face][j];
                    self.stars.remove(v, (face * 3 + j) as u32);
                    if self.stars.is_empty(v) {
                        lonely.push(v);
                    }
                }
                continue;
            }
            let from = self.wedges[face][k];
            let to = match meets.iter().find(|m| m.0 == from) {
                Some(&(_, to)) => to,
                None => {
                    let kept = self.records.first_kept + self.records.kept.len() as u32;
                    self.records.kept.push(from);
                    meets.push((from, kept));
                    kept
                }
            };
            self.records.moved.push(Moved { face: self.faces[face], from, to });
            self.corners[face][k] = t;
            self.wedges[face][k] = to;
            self.stars.insert(t, corner);
        }
        let quadric = self.quadrics[u as usize];
        self.quadrics[t as usize].add(&quadric);
        self.version[t as usize] += 1;
        self.gone[u as usize] = true;
        self.highest_cost = self.highest_cost.max(cost);
        let ring: Vec<u32> = self.stars.corners(t).flat_map(|c| self.corners[(c / 3) as usize]).collect();
        for removed in &mut self.records.removed[first_removed..] {
            if let Some(x) = removed.third {
                self.vertex_last[x as usize] = index;
                removed.third = (!ring.contains(&x)).then_some(self.vertices[x as usize]);
            }
        }
        self.record(self.vertices[u as usize], self.vertices[t as usize]);
        for v in lonely {
            if self.interior[v as usize] && !self.gone[v as usize] && self.stars.is_empty(v) {
                self.gone[v as usize] = true;
                self.record(self.vertices[v as usize], NO_VERTEX);
            }
        }
    }

    /// Notes the collapses that used what this one uses, and that this one has used it.
    fn book(&mut self, u: u32, t: u32) {
        let index = self.records.collapses.len() as u32;
        let first = self.records.after.len();
        for v in [u, t] {
            let last = std::mem::replace(&mut self.vertex_last[v as usize], index);
            self.records.after.push(last);
            for corner in self.stars.corners(v) {
                let last = std::mem::replace(&mut self.face_last[(corner / 3) as usize], index);
                if !self.records.after[first..].contains(&last) {
                    self.records.after.push(last);
                }
            }
        }
        let mut kept = first;
        for i in first..self.records.after.len() {
            let last = self.records.after[i];
            if last != NONE && last != index {
                self.records.after[kept] = last;
                kept += 1;
            }
        }
        self.records.after.truncate(kept);
    }

    fn record(&mut self, removed: u32, target: u32) {
        self.records.collapses.push(Collapse {
            removed,
            target,
            cost: self.highest_cost,
            round: 0,
            after_end: self.records.after.len() as u32,
            moved_end: self.records.moved.len() as u32,
            removed_end: self.records.removed.len() as u32,
            kept_end: self.records.kept.len() as u32,
        });
    }
}
