//! A cache from ids to slots: the ids of one delta have few distinct owners.

use crate::refine::applied::{AppliedOwner, AppliedOwners};
use crate::refine::delta::Id;

/// Entries of the cache.
const CACHE_SIZE: usize = 16;

/// First slot and count of an owner's elements.
type Run = [u32; 2];

/// The element ranges of an owner.
#[derive(Clone, Copy)]
struct CachedOwner {
    owner: u32,
    vertices: Run,
    wedges: Run,
    faces: Run,
}

/// An empty entry: no owner has this number.
const EMPTY_ENTRY: CachedOwner =
    CachedOwner { owner: u32::MAX, vertices: [0; 2], wedges: [0; 2], faces: [0; 2] };

/// A direct-mapped cache of the owners of recent ids.
pub(crate) struct Owners<'a> {
    applied: &'a AppliedOwners,
    cache: [CachedOwner; CACHE_SIZE],
    /// Every owner that missed the cache, possibly with duplicates.
    pub(crate) named: Vec<u32>,
}

impl<'a> Owners<'a> {
    pub(crate) fn new(applied: &'a AppliedOwners) -> Self {
        Self { applied, cache: [EMPTY_ENTRY; CACHE_SIZE], named: Vec::new() }
    }

    /// The slot of a vertex, if its owner is applied and has it.
    #[inline]
    pub(crate) fn vertex(&mut self, id: Id) -> Option<u32> {
        slot(self.of(id.owner).vertices, id)
    }

    /// The slot of a wedge, likewise.
    #[inline]
    pub(crate) fn wedge(&mut self, id: Id) -> Option<u32> {
        slot(self.of(id.owner).wedges, id)
    }

    /// The slot of a face, likewise.
    #[inline]
    pub(crate) fn face(&mut self, id: Id) -> Option<u32> {
        slot(self.of(id.owner).faces, id)
    }

    /// The id of a vertex of an owner.
    #[inline]
    pub(crate) fn id_of_vertex(&mut self, owner: u32, slot: u32) -> Id {
        id(owner, self.of(owner).vertices, slot)
    }

    /// The id of a wedge of an owner.
    #[inline]
    pub(crate) fn id_of_wedge(&mut self, owner: u32, slot: u32) -> Id {
        id(owner, self.of(owner).wedges, slot)
    }

    /// The id of a face of an owner.
    #[inline]
    pub(crate) fn id_of_face(&mut self, owner: u32, slot: u32) -> Id {
        id(owner, self.of(owner).faces, slot)
    }

    #[inline]
    fn of(&mut self, owner: u32) -> &CachedOwner {
        let at = owner as usize % CACHE_SIZE;
        if self.cache[at].owner != owner {
            self.look_up(at, owner);
        }
        &self.cache[at]
    }

    #[cold]
    fn look_up(&mut self, at: usize, owner: u32) {
        let run = |range: &std::ops::Range<u32>| [range.start, range.end - range.start];
        self.cache[at] = match self.applied.get(owner) {
            Some(AppliedOwner { vertices, wedges, faces, .. }) => {
                self.named.push(owner);
                CachedOwner { owner, vertices: run(vertices), wedges: run(wedges), faces: run(faces) }
            }
            None => CachedOwner { owner, ..EMPTY_ENTRY },
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
