//! Compaction: chunks move into slots that undone chunks have left, so that a mesh's memory, and a renderer's, follows the
//! applied part down as it follows it up. Ids are canonical ([`crate::refine::Id`]): only slots change.

use crate::mesh::Wedge;
use crate::mesh::corner::{self, corner, face_of, side_of};
use crate::mesh::shorten::shorten;
use crate::refine::active::ActiveMesh;
use crate::refine::dirty_slots::DirtySlots;
use crate::refine::slots::{Move, after};

/// Planned moves of each kind of slots.
#[derive(Debug, Default)]
struct Plan {
    vertices: Vec<Move>,
    wedges: Vec<Move>,
    faces: Vec<Move>,
    /// Per material, ascending.
    draws: Vec<(u16, Vec<Move>)>,
}

impl ActiveMesh {
    /// Whether [`Self::compact`] has work: from when fewer than half of the slots of one kind are in use, until none of
    /// them is free.
    #[must_use]
    pub fn is_sparse(&self) -> bool {
        let kinds = [&self.vertex_slots, &self.wedge_slots, &self.face_slots];
        kinds.into_iter().chain(&self.index_slots).any(|slots| slots.is_sparse())
    }

    /// Moves chunks down into free slots: about `max_slots` of each kind that is sparse, at most a chunk more. The mesh
    /// stays the same but for slots. Cost: the stars of what moves, and a pass over the applied chunks. Call it until
    /// [`Self::is_sparse`] is false; all calls together move at most what is in use, which is less than what was undone.
    pub fn compact(&mut self, max_slots: u32) -> DirtySlots {
        let plan = self.plan(max_slots);
        let concerned = self.concerned(&plan);
        self.move_vertices(&plan.vertices, &concerned);
        self.move_faces(&plan.faces, &concerned);
        let draws = self.move_draws(&plan.draws);
        self.move_wedges(&plan.wedges, &concerned);
        let mut touched = self.finish_touched(draws);
        let mut moved: Vec<u32> =
            plan.wedges.iter().flat_map(|step| step.to..after(&plan.wedges, step.from.end - 1) + 1).collect();
        moved.extend(touched.wedges);
        moved.sort_unstable();
        moved.dedup();
        touched.wedges = moved;
        self.give_up_slots(&mut touched);
        touched
    }

    fn plan(&self, max_slots: u32) -> Plan {
        let mut plan = Plan::default();
        if self.vertex_slots.is_sparse() {
            plan.vertices = self.vertex_slots.plan(max_slots, |slot| {
                Some(self.applied.get(self.vertex_owner[slot as usize])?.vertices.clone())
            });
        }
        if self.wedge_slots.is_sparse() {
            plan.wedges = self.wedge_slots.plan(max_slots, |slot| {
                Some(self.applied.get(self.wedge_owner[slot as usize])?.wedges.clone())
            });
        }
        if self.face_slots.is_sparse() {
            plan.faces = self.face_slots.plan(max_slots, |slot| {
                Some(self.applied.get(self.face_owner[slot as usize])?.faces.clone())
            });
        }
        if self.index_slots.iter().any(|slots| slots.is_sparse()) {
            let ranges = self.applied.iter().flat_map(|(_, applied)| &applied.draws);
            let mut ranges: Vec<_> = ranges
                .filter(|(material, _)| self.index_slots[usize::from(*material)].is_sparse())
                .map(|(material, range)| (*material, range.start, range.end))
                .collect();
            ranges.sort_unstable();
            for (material, slots) in (0..).zip(&self.index_slots).filter(|(_, slots)| slots.is_sparse()) {
                let moves = slots.plan(max_slots, |slot| {
                    let at = ranges.binary_search_by_key(&(material, slot), |range| (range.0, range.1));
                    at.ok().map(|at| ranges[at].1..ranges[at].2)
                });
                plan.draws.push((material, moves));
            }
        }
        plan
    }

    /// The owners whose vertices, wedges or faces move, and those that refer to any of them, ascending.
    fn concerned(&self, plan: &Plan) -> Vec<u32> {
        let of = |moves: &[Move], owners: &[u32]| -> Vec<u32> {
            moves.iter().map(|step| owners[step.from.start as usize]).collect()
        };
        let mut moving = of(&plan.vertices, &self.vertex_owner);
        moving.extend(of(&plan.wedges, &self.wedge_owner));
        moving.extend(of(&plan.faces, &self.face_owner));
        moving.sort_unstable();
        moving.dedup();
        if moving.is_empty() {
            return moving;
        }
        let moves = |owner: &u32| moving.binary_search(owner).is_ok();
        let all = self.applied.iter();
        all.filter(|(owner, applied)| moves(owner) || applied.needs.iter().any(moves))
            .map(|(owner, _)| owner)
            .collect()
    }

    fn move_vertices(&mut self, moves: &[Move], concerned: &[u32]) {
        self.vertex_slots.moved(moves);
        if moves.is_empty() {
            return;
        }
        for &owner in concerned {
            let Some(applied) = self.applied.get_mut(owner) else { continue };
            for wedge in applied.wedges.clone() {
                let vertex = &mut self.wedges[wedge as usize].vertex;
                *vertex = after(moves, *vertex);
            }
            for (vertex, _) in &mut applied.undo.vertices {
                *vertex = after(moves, *vertex);
            }
            shift(&mut applied.vertices, moves);
        }
        for step in moves {
            let (from, to) = bounds(step);
            self.positions.copy_within(from.clone(), to);
            self.morph_from.copy_within(from.clone(), to);
            self.vertex_owner.copy_within(from.clone(), to);
            self.vertex_mover.copy_within(from.clone(), to);
            self.vertex_shift.copy_within(from.clone(), to);
            if !self.parts.is_empty() {
                self.parts.copy_within(from.clone(), to);
            }
            if !self.skins.is_empty() {
                self.skins.copy_within(from.clone(), to);
            }
            self.stars.move_heads(from, to);
        }
    }

    fn move_faces(&mut self, moves: &[Move], concerned: &[u32]) {
        self.face_slots.moved(moves);
        if moves.is_empty() {
            return;
        }
        for &owner in concerned {
            let Some(applied) = self.applied.get_mut(owner) else { continue };
            for (at, _) in &mut applied.undo.corners {
                *at = corner(after(moves, face_of(*at)), side_of(*at));
            }
            shift(&mut applied.faces, moves);
        }
        for step in moves {
            for (face, to) in step.from.clone().zip(step.to..) {
                for (k, wedge) in self.faces[face as usize].into_iter().enumerate() {
                    let vertex = self.wedges[wedge as usize].vertex;
                    self.stars.rename(vertex, corner(face, k), corner(to, k));
                }
            }
            let (from, to) = bounds(step);
            self.faces.copy_within(from.clone(), to);
            self.face_owner.copy_within(from.clone(), to);
            self.materials.copy_within(from.clone(), to);
            self.draw_slots.copy_within(from, to);
        }
    }

    /// Returns the entries of the index lists whose faces have moved, old and new.
    fn move_draws(&mut self, plan: &[(u16, Vec<Move>)]) -> Vec<(u16, u32)> {
        let mut touched = Vec::new();
        for (material, moves) in plan {
            let material = *material;
            self.index_slots[usize::from(material)].moved(moves);
            let (Some(first), Some(last)) = (moves.first(), moves.last()) else { continue };
            let list = &mut self.indices[usize::from(material)];
            for step in moves {
                let (from, to) = bounds(step);
                list.copy_within(from, to);
            }
            let end = last.to + (last.from.end - last.from.start);
            list[end as usize..last.from.end as usize].fill([0; 3]);
            touched.extend((first.to..last.from.end).map(|slot| (material, slot)));
            for applied in self.applied.iter_mut() {
                for (_, range) in applied.draws.iter_mut().filter(|(of, _)| *of == material) {
                    let was = range.start;
                    shift(range, moves);
                    if range.start == was {
                        continue;
                    }
                    for face in applied.faces.clone() {
                        if self.materials[face as usize] == material {
                            let draw = &mut self.draw_slots[face as usize];
                            *draw = after(moves, *draw);
                        }
                    }
                }
            }
        }
        touched
    }

    /// Marks the faces whose wedges have moved.
    fn move_wedges(&mut self, moves: &[Move], concerned: &[u32]) {
        self.wedge_slots.moved(moves);
        let Some(last) = moves.last() else { return };
        for &owner in concerned {
            let Some(applied) = self.applied.get_mut(owner) else { continue };
            for (_, wedge) in &mut applied.undo.corners {
                *wedge = after(moves, *wedge);
            }
            shift(&mut applied.wedges, moves);
        }
        for step in moves {
            for (wedge, to) in step.from.clone().zip(step.to..) {
                // Ascending and downwards, so that no corner has a slot yet that is still to move.
                for at in self.stars.corners(self.wedges[wedge as usize].vertex) {
                    if corner::at(&self.faces, at) != wedge {
                        continue;
                    }
                    let (face, k) = (face_of(at), side_of(at));
                    self.faces[face as usize][k] = to;
                    let list = usize::from(self.materials[face as usize]);
                    self.indices[list][self.draw_slots[face as usize] as usize][k] = to;
                    self.marks.faces.set(face);
                }
            }
            let (from, to) = bounds(step);
            self.wedges.copy_within(from.clone(), to);
            self.wedge_owner.copy_within(from, to);
        }
        let end = last.to + (last.from.end - last.from.start);
        self.wedges[end as usize..last.from.end as usize].fill(Wedge::default());
    }

    /// Shortens the lists to the slots in use, gives up memory of lists that use less than half of theirs, and removes
    /// dirty slots past the end.
    pub(crate) fn give_up_slots(&mut self, touched: &mut DirtySlots) {
        let [v, w, f] = [&self.vertex_slots, &self.wedge_slots, &self.face_slots].map(|s| s.high() as usize);
        shorten(&mut self.positions, v);
        shorten(&mut self.morph_from, v);
        shorten(&mut self.vertex_owner, v);
        shorten(&mut self.vertex_mover, v);
        shorten(&mut self.vertex_shift, v);
        shorten(&mut self.parts, v);
        shorten(&mut self.skins, v);
        shorten(&mut self.wedges, w);
        shorten(&mut self.wedge_owner, w);
        shorten(&mut self.faces, f);
        shorten(&mut self.face_owner, f);
        shorten(&mut self.materials, f);
        shorten(&mut self.draw_slots, f);
        for (list, slots) in self.indices.iter_mut().zip(&self.index_slots) {
            shorten(list, slots.high() as usize);
        }
        self.stars.shorten(v, f);
        touched.wedges.truncate(touched.wedges.partition_point(|&slot| (slot as usize) < w));
        touched.draws.retain(|&(material, slot)| slot < self.index_slots[usize::from(material)].high());
    }
}

fn bounds(step: &Move) -> (std::ops::Range<usize>, usize) {
    (step.from.start as usize..step.from.end as usize, step.to as usize)
}

/// Moves a range of an owner along.
fn shift(range: &mut std::ops::Range<u32>, moves: &[Move]) {
    if range.start < range.end {
        let start = after(moves, range.start);
        *range = start..start + (range.end - range.start);
    }
}
