//! From ids to slots, many at a time: the ids of a delta name few owners, again and again.

use crate::refine::applied::{AppliedOwner, AppliedOwners};
use crate::refine::delta::Id;

/// Owners that are remembered.
const NEAR: usize = 16;

/// First slot and number of an owner's elements.
type Run = [u32; 2];

/// An owner's elements.
#[derive(Clone, Copy)]
struct Near {
    owner: u32,
    vertices: Run,
    wedges: Run,
    faces: Run,
}

/// No owner has this number: there are fewer chunks.
const NOBODY: Near = Near { owner: u32::MAX, vertices: [0; 2], wedges: [0; 2], faces: [0; 2] };

/// The owners that a delta's ids named last.
pub(crate) struct Owners<'a> {
    applied: &'a AppliedOwners,
    near: [Near; NEAR],
    /// Every owner that was looked up, some more than once.
    pub(crate) named: Vec<u32>,
}

impl<'a> Owners<'a> {
    pub(crate) fn new(applied: &'a AppliedOwners) -> Self {
        Self { applied, near: [NOBODY; NEAR], named: Vec::new() }
    }

    /// The slot of a vertex, if its owner is there and has it.
    #[inline]
    pub(crate) fn vertex(&mut self, id: Id) -> Option<u32> {
        slot(self.of(id.owner).vertices, id)
    }

    /// The same of a wedge.
    #[inline]
    pub(crate) fn wedge(&mut self, id: Id) -> Option<u32> {
        slot(self.of(id.owner).wedges, id)
    }

    /// The same of a face.
    #[inline]
    pub(crate) fn face(&mut self, id: Id) -> Option<u32> {
        slot(self.of(id.owner).faces, id)
    }

    /// The id of a vertex of an owner.
    #[inline]
    pub(crate) fn id_of_vertex(&mut self, owner: u32, slot: u32) -> Id {
        id(owner, self.of(owner).vertices, slot)
    }

    /// The same of a wedge.
    #[inline]
    pub(crate) fn id_of_wedge(&mut self, owner: u32, slot: u32) -> Id {
        id(owner, self.of(owner).wedges, slot)
    }

    /// The same of a face.
    #[inline]
    pub(crate) fn id_of_face(&mut self, owner: u32, slot: u32) -> Id {
        id(owner, self.of(owner).faces, slot)
    }

    #[inline]
    fn of(&mut self, owner: u32) -> &Near {
        let at = owner as usize % NEAR;
        if self.near[at].owner != owner {
            self.look_up(at, owner);
        }
        &self.near[at]
    }

    #[cold]
    fn look_up(&mut self, at: usize, owner: u32) {
        let run = |range: &std::ops::Range<u32>| [range.start, range.end - range.start];
        self.near[at] = match self.applied.get(owner) {
            Some(AppliedOwner { vertices, wedges, faces, .. }) => {
                self.named.push(owner);
                Near { owner, vertices: run(vertices), wedges: run(wedges), faces: run(faces) }
            }
            None => Near { owner, ..NOBODY },
        };
    }
}

#[inline]
fn slot([start, count]: Run, id: Id) -> Option<u32> {
    (id.index < count).then(|| start + id.index)
}

#[inline]
fn id(owner: u32, [start, _]: Run, slot: u32) -> Id {
    Id { owner, index: slot.wrapping_sub(start) }
}
