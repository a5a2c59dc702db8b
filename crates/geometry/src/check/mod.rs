//! Checks a prepared asset: applies random ancestor-closed cuts in random orders, and undoes them.
//!
//! *Cracks.* Let π map each vertex of the input to its ancestor in the current mesh. The mesh is the image of the
//! input under π without the collapsed faces, and the boundary operator commutes with π. So the sum of the mesh's
//! directed edges (opposite ones cancel) must equal the image of the input's boundary, for any input: open, closed or
//! non-manifold. An edge where it differs is a crack. If the input is a closed manifold, an edge without exactly two
//! faces counts as well. The fully refined mesh stands for the input. If it has more vertices than the input,
//! outlines were not locked and vertices were restored once per region: duplicates are recognised by equal positions
//! and count as one vertex.
//!
//! *Order.* Every chunk is decoded again against the current mesh and must give the same delta as with all coarser
//! chunks applied. Two random orders must give the same state; in one of them chunks are first applied up to
//! truncation points.

pub mod ancestor_closed_cut;

use std::collections::BTreeMap;

use crate::asset::base::Base;
use crate::asset::index::ChunkInfo;
use crate::check::ancestor_closed_cut::Member;
use crate::error::DecodeError;
use crate::mesh::corner;
use crate::pool::{self, Pool};
use crate::random::Random;
use crate::refine::{ActiveMesh, ChunkDelta, ChunkError, Id, Origin, Snapshot};

/// Result of a check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CheckReport {
    /// Cuts tried.
    pub sets: usize,
    /// Cracks: edges at which a mesh was torn.
    pub cracks: usize,
    /// Chunks or cuts whose result depended on the order.
    pub order_dependent: usize,
    /// Cuts whose undoing did not restore the base mesh.
    pub undo_errors: usize,
}

/// An asset with all chunks decoded once.
struct Reference<'a> {
    base: &'a Base,
    infos: &'a [ChunkInfo],
    payloads: &'a [Vec<u8>],
    /// Per chunk: the deltas at its truncation points, and of the whole.
    deltas: Vec<Vec<ChunkDelta>>,
    /// The input's boundary.
    boundary: BTreeMap<(Id, Id), i64>,
    closed_manifold: bool,
    /// Duplicates, with the vertex that each is a duplicate of.
    duplicates: BTreeMap<Id, Id>,
    start: Snapshot,
}

/// Tries `sets` random ancestor-closed cuts.
///
/// # Errors
/// If a chunk cannot be decoded even when everything coarser is applied.
pub fn check(
    base: &Base,
    infos: &[ChunkInfo],
    payloads: &[Vec<u8>],
    sets: usize,
    seed: u64,
    pool: &dyn Pool,
) -> Result<CheckReport, DecodeError> {
    if infos.len() != payloads.len() || infos.len() != base.chunk_count as usize {
        return Err(DecodeError::new(
            "asset",
            "index, payloads and base mesh disagree on the number of chunks",
        ));
    }
    let mut mesh = ActiveMesh::new(base);
    let start = mesh.snapshot();
    let mut deltas = Vec::with_capacity(infos.len());
    for (id, info) in infos.iter().enumerate() {
        let id = id as u32;
        let truncation_points =
            (0..info.truncation_points.len()).map(|truncation| Some(truncation as u8)).chain([None]);
        let ways: Result<Vec<ChunkDelta>, ChunkError> = truncation_points
            .map(|truncation| mesh.decode_prefix(id, info, truncation, &payloads[id as usize]))
            .collect();
        let ways = ways?;
        mesh.apply(&ways[info.truncation_points.len()])
            .map_err(|e| DecodeError::new(format!("chunk {id}"), e.to_string()))?;
        deltas.push(ways);
    }
    let full = mesh.snapshot();
    let duplicates = duplicates(&full, base.totals.vertices);
    let (boundary, counts) = edges(&full, &duplicates);
    let closed_manifold = boundary.is_empty() && counts.values().all(|&c| c == 2);
    let reference = Reference { base, infos, payloads, deltas, boundary, closed_manifold, duplicates, start };
    let mut seeds = Random::new(seed);
    let seeds: Vec<u64> = (0..sets).map(|_| seeds.next_u64()).collect();
    let reports = pool::map(pool, sets, &|i| reference.try_set(&mut Random::new(seeds[i])))
        .map_err(|e| DecodeError::new("check", e.to_string()))?;
    Ok(reports.into_iter().fold(CheckReport::default(), |a, b| CheckReport {
        sets: a.sets + 1,
        cracks: a.cracks + b.cracks,
        order_dependent: a.order_dependent + b.order_dependent,
        undo_errors: a.undo_errors + b.undo_errors,
    }))
}

impl Reference<'_> {
    fn try_set(&self, random: &mut Random) -> CheckReport {
        let mut report = CheckReport::default();
        let set = ancestor_closed_cut::random(self.infos, random);
        let mut mesh = ActiveMesh::new(self.base);
        for &member in &ancestor_closed_cut::random_order(self.infos, &set, random) {
            let known = self.delta(member);
            match self.decode(&mesh, member) {
                Ok(delta) if delta == *known => {}
                _ => report.order_dependent += 1,
            }
            if mesh.apply(known).is_err() {
                report.order_dependent += 1;
            }
        }
        let state = mesh.snapshot();
        report.cracks = self.cracks(&state);

        let mut other = ActiveMesh::new(self.base);
        let order = ancestor_closed_cut::random_order(self.infos, &set, random);
        let applied = order.iter().all(|&member| self.apply_in_two_steps(&mut other, member, random));
        if !applied || other.snapshot() != state {
            report.order_dependent += 1;
        }
        let back = ancestor_closed_cut::random_order(self.infos, &set, random);
        let undone = back.iter().rev().all(|&member| other.undo(member.chunk).is_ok());
        if !undone || other.snapshot() != self.start {
            report.undo_errors += 1;
        }
        report
    }

    fn delta(&self, member: Member) -> &ChunkDelta {
        let ways = &self.deltas[member.chunk as usize];
        &ways[member.truncation.map_or(ways.len() - 1, usize::from)]
    }

    fn decode(&self, mesh: &ActiveMesh, member: Member) -> Result<ChunkDelta, ChunkError> {
        let id = member.chunk as usize;
        mesh.decode_prefix(member.chunk, &self.infos[id], member.truncation, &self.payloads[id])
    }

    /// Applies a chunk, first up to a random truncation point if it has any, then to the member's.
    fn apply_in_two_steps(&self, mesh: &mut ActiveMesh, member: Member, random: &mut Random) -> bool {
        let id = member.chunk as usize;
        let ways = &self.deltas[id];
        let way = &ways[random.below(ways.len())];
        if mesh.apply(way).is_err() {
            return false;
        }
        if way.truncation == member.truncation {
            return true;
        }
        if way.truncation.is_some() {
            return mesh.raise(member.chunk, &self.infos[id], member.truncation, &self.payloads[id]).is_ok();
        }
        mesh.undo(member.chunk).is_ok() && mesh.apply(self.delta(member)).is_ok()
    }

    fn cracks(&self, state: &Snapshot) -> usize {
        let (boundary, counts) = edges(state, &self.duplicates);
        let mut difference = boundary;
        for (&(a, b), &times) in &self.boundary {
            let [a, b] = [a, b].map(|v| representative(&self.duplicates, self.ancestor(state, v)));
            add(&mut difference, a, b, -times);
        }
        let torn = difference.values().filter(|&&times| times != 0).count();
        let odd = if self.closed_manifold { counts.values().filter(|&&c| c != 2).count() } else { 0 };
        torn + odd
    }

    /// The ancestor in this mesh of a vertex of the input.
    fn ancestor(&self, state: &Snapshot, mut vertex: Id) -> Id {
        while vertex.owner > 0 && state.vertices.binary_search_by_key(&vertex, |v| v.0).is_err() {
            let whole = Member { chunk: vertex.owner - 1, truncation: None };
            match self.delta(whole).vertices[vertex.index as usize].origin {
                Origin::Split(parent) => vertex = parent,
                Origin::Part(_) => break,
            }
        }
        vertex
    }
}

type Boundary = BTreeMap<(Id, Id), i64>;

/// Vertices at the same position as an earlier one, if there are more vertices than expected.
fn duplicates(full: &Snapshot, vertices: u64) -> BTreeMap<Id, Id> {
    let mut duplicates = BTreeMap::new();
    if full.vertices.len() as u64 > vertices {
        let mut first = BTreeMap::new();
        for &(id, position, part) in &full.vertices {
            let representative = *first.entry((position, part)).or_insert(id);
            if representative != id {
                duplicates.insert(id, representative);
            }
        }
    }
    duplicates
}

fn representative(duplicates: &BTreeMap<Id, Id>, vertex: Id) -> Id {
    duplicates.get(&vertex).copied().unwrap_or(vertex)
}

/// The boundary of a mesh (signed sum of directed edges) and the number of faces at each edge.
fn edges(state: &Snapshot, duplicates: &BTreeMap<Id, Id>) -> (Boundary, BTreeMap<(Id, Id), u32>) {
    let mut boundary = Boundary::new();
    let mut counts = BTreeMap::new();
    let vertex =
        |wedge: Id| state.wedges.binary_search_by_key(&wedge, |w| w.0).map_or(wedge, |i| state.wedges[i].1);
    for &(_, wedges, _) in &state.faces {
        let v = wedges.map(|w| representative(duplicates, vertex(w)));
        for k in 0..3 {
            let (a, b) = (v[k], v[corner::next(k)]);
            add(&mut boundary, a, b, 1);
            *counts.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    boundary.retain(|_, times| *times != 0);
    (boundary, counts)
}

fn add(boundary: &mut Boundary, a: Id, b: Id, times: i64) {
    match a.cmp(&b) {
        std::cmp::Ordering::Less => *boundary.entry((a, b)).or_insert(0) += times,
        std::cmp::Ordering::Greater => *boundary.entry((b, a)).or_insert(0) -= times,
        std::cmp::Ordering::Equal => {}
    }
}
