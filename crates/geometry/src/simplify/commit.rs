//! Applies a region's collapses to the mesh.

use crate::collapse::{NO_VERTEX, Records};
use crate::mesh::vec3::{length, sub};
use crate::simplify::live::Live;

/// Progress of applying a region's collapses.
#[derive(Default)]
pub(crate) struct CommitProgress {
    collapses: usize,
    /// Final ids of the wedges added so far.
    ids: Vec<u32>,
}

impl Records {
    /// Applies the collapses up to `end` to the mesh, except its stars and face list ([`Live::settle`]), and assigns
    /// final ids to added wedges. `done` holds the progress of earlier calls. `changed(corner)` is called for every
    /// corner that moves to another vertex.
    pub(crate) fn commit(
        &mut self,
        live: &mut Live<'_>,
        done: &mut CommitProgress,
        end: usize,
        changed: &mut dyn FnMut(u32),
    ) {
        let first = self.first_added_wedge;
        let final_id = |ids: &[u32], wedge: u32| {
            if wedge >= first { ids[(wedge - first) as usize] } else { wedge }
        };
        let ids = &mut done.ids;
        let (mut moved_at, mut removed_at) = match done.collapses.checked_sub(1) {
            Some(i) => (self.collapses[i].moved_end as usize, self.collapses[i].removed_end as usize),
            None => (0, 0),
        };
        let range = done.collapses..end;
        done.collapses = end;
        for collapse in &self.collapses[range] {
            let (u, t) = (collapse.removed, collapse.target);
            while ids.len() < collapse.added_wedges_end as usize {
                let source = final_id(ids, self.added_wedges[ids.len()]);
                self.added_wedges[ids.len()] = source;
                ids.push(live.add_wedge(t, source));
            }
            for moved in &mut self.moved[moved_at..collapse.moved_end as usize] {
                moved.from = final_id(ids, moved.from);
                moved.to = final_id(ids, moved.to);
                let face = moved.face as usize;
                let k = live.face_vertices[face].iter().position(|&v| v == u).unwrap_or(0);
                live.face_vertices[face][k] = t;
                live.face_wedges[face][k] = moved.to;
                changed(moved.face * 3 + k as u32);
            }
            for removed in &self.removed[removed_at..collapse.removed_end as usize] {
                live.alive[removed.face as usize] = false;
            }
            moved_at = collapse.moved_end as usize;
            removed_at = collapse.removed_end as usize;
            if t != NO_VERTEX {
                let quadric = live.quadrics[u as usize];
                live.quadrics[t as usize].add(&quadric);
                live.moved_to[u as usize] = t;
                let step = length(sub(live.positions[u as usize], live.positions[t as usize]));
                live.reach[t as usize] = live.reach[t as usize].max(live.reach[u as usize] + step);
            }
        }
    }
}
