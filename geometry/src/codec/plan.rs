//! What an encoder wants to say: a region's collapses reversed, and how the builder's ids map to
//! local ones.

use std::collections::HashMap;

use crate::codec::local::SlotMap;
use crate::simplify::live::NO_VERTEX;
use crate::simplify::records::{Moved, Records, Removed};

/// One vertex split in the builder's ids.
pub(crate) struct PlannedSplit<'a> {
    pub(crate) target: u32,
    pub(crate) vertex: u32,
    pub(crate) moved: &'a [Moved],
    pub(crate) removed: &'a [Removed],
}

/// A chunk's splits in rounds of independent ones, in decoding order.
pub(crate) struct Plan<'a> {
    /// Vertices without faces that the chunk starts from, in decoding order.
    pub(crate) births: Vec<u32>,
    /// Rounds; each maps a vertex to the split that it undergoes.
    pub(crate) rounds: Vec<HashMap<u32, PlannedSplit<'a>>>,
    /// Vertices that must be known before the first round, ascending.
    pub(crate) needed: Vec<u32>,
}

impl<'a> Plan<'a> {
    /// Reverses a region's collapses. Collapses of equal round share no face, so they commute.
    pub(crate) fn new(records: &'a Records) -> Self {
        let rounds = records.collapses.iter().map(|c| c.round).max().unwrap_or(0) as usize;
        let mut plan = Self { births: Vec::new(), rounds: Vec::new(), needed: Vec::new() };
        plan.rounds.resize_with(rounds, HashMap::new);
        let mut made: Vec<u32> = Vec::new();
        for index in (0..records.collapses.len()).rev() {
            let (collapse, moved, removed) = records.parts(index);
            made.push(collapse.removed);
            if collapse.target == NO_VERTEX {
                plan.births.push(collapse.removed);
                continue;
            }
            plan.needed.push(collapse.target);
            plan.needed.extend(removed.iter().flat_map(|r| r.third));
            plan.rounds[rounds - collapse.round as usize].insert(
                collapse.target,
                PlannedSplit { target: collapse.target, vertex: collapse.removed, moved, removed },
            );
        }
        plan.rounds.retain(|r| !r.is_empty());
        made.sort_unstable();
        plan.needed.sort_unstable();
        plan.needed.dedup();
        plan.needed.retain(|v| made.binary_search(v).is_err());
        plan
    }
}

/// Builder ids by local number, and back.
#[derive(Default)]
pub(crate) struct Names {
    pub(crate) vertices: Vec<u32>,
    pub(crate) wedges: Vec<u32>,
    pub(crate) faces: Vec<u32>,
    pub(crate) local_vertex: SlotMap,
    pub(crate) local_wedge: SlotMap,
}

impl Names {
    pub(crate) fn vertex(&mut self, builder: u32) {
        self.local_vertex.insert(builder, self.vertices.len() as u32);
        self.vertices.push(builder);
    }

    pub(crate) fn wedge(&mut self, builder: u32) {
        self.local_wedge.insert(builder, self.wedges.len() as u32);
        self.wedges.push(builder);
    }
}
