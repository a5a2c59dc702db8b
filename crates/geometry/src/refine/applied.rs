//! Records of applied owners. Memory is proportional to the applied owners, not to the number of chunks that an asset
//! claims.

use std::ops::Range;

use crate::numbers::id32;

/// The slots of an applied owner's elements, and its undo record.
#[derive(Clone, Debug, Default)]
pub(crate) struct AppliedOwner {
    pub(crate) vertices: Range<u32>,
    pub(crate) wedges: Range<u32>,
    pub(crate) faces: Range<u32>,
    /// Per material: slots in its index list.
    pub(crate) draws: Vec<(u16, Range<u32>)>,
    /// The truncation point that the chunk is applied up to; `None` if whole.
    pub(crate) truncation: Option<u8>,
    /// Number of applied chunks that depend on this one: as a parent, or by a reference to its elements.
    pub(crate) children: u32,
    /// Owners that this one depends on.
    pub(crate) needs: Vec<u32>,
    /// Restores the state before the chunk.
    pub(crate) undo: Undo,
}

/// The part of a vertex's state that later chunks may change.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VertexState {
    pub(crate) position: [i32; 3],
    pub(crate) morph_from: [i32; 3],
    pub(crate) shift: u8,
    pub(crate) mover: u32,
}

/// Undo record of a chunk, by slot.
#[derive(Clone, Debug, Default)]
pub(crate) struct Undo {
    /// Older vertices that the chunk moved, with the state to restore.
    pub(crate) vertices: Box<[(u32, VertexState)]>,
    /// Corners of older faces that the chunk moved (`face × 3 + k`), with the wedge to restore.
    pub(crate) corners: Box<[(u32, u32)]>,
}

impl Undo {
    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.vertices) + size_of_val(&*self.corners)
    }
}

/// Owners per page: the size of an index page, which is requested as a whole.
const PAGE: usize = 64;

/// Applied owners in pages that are allocated when one of their owners is applied. An untrusted peer's asset may
/// claim 2^22 chunks in a few bytes: pages cost 0.5 MB for it, a flat list 0.5 GB.
#[derive(Clone, Debug)]
pub(crate) struct AppliedOwners {
    pages: Vec<Option<Box<[Option<AppliedOwner>; PAGE]>>>,
    owners: usize,
}

impl AppliedOwners {
    /// An empty table for the base mesh and `chunks` chunks.
    pub(crate) fn new(chunks: u32) -> Self {
        let owners = chunks as usize + 1;
        Self { pages: vec![None; owners.div_ceil(PAGE)], owners }
    }

    /// Number of possible owners: the chunks and the base mesh.
    pub(crate) fn len(&self) -> usize {
        self.owners
    }

    pub(crate) fn get(&self, owner: u32) -> Option<&AppliedOwner> {
        self.pages.get(owner as usize / PAGE)?.as_ref()?[owner as usize % PAGE].as_ref()
    }

    pub(crate) fn get_mut(&mut self, owner: u32) -> Option<&mut AppliedOwner> {
        self.pages.get_mut(owner as usize / PAGE)?.as_mut()?[owner as usize % PAGE].as_mut()
    }

    /// `owner` must be below [`Self::len`].
    pub(crate) fn insert(&mut self, owner: u32, applied: AppliedOwner) {
        let page = &mut self.pages[owner as usize / PAGE];
        let page = page.get_or_insert_with(|| Box::new([const { None }; PAGE]));
        page[owner as usize % PAGE] = Some(applied);
    }

    pub(crate) fn remove(&mut self, owner: u32) -> Option<AppliedOwner> {
        let slot = self.pages.get_mut(owner as usize / PAGE)?;
        let page = slot.as_mut()?;
        let applied = page[owner as usize % PAGE].take();
        if page.iter().all(Option::is_none) {
            *slot = None;
        }
        applied
    }

    /// The applied owners, ascending.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u32, &AppliedOwner)> {
        self.pages.iter().enumerate().filter_map(|(i, page)| Some((i, page.as_ref()?))).flat_map(
            |(i, page)| {
                let numbered = page.iter().enumerate();
                numbered.filter_map(move |(k, applied)| Some((id32(i * PAGE + k), applied.as_ref()?)))
            },
        )
    }

    /// As [`Self::iter`], mutable.
    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut AppliedOwner> {
        self.pages.iter_mut().flatten().flat_map(|page| page.iter_mut().flatten())
    }

    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.pages.capacity() * size_of::<Option<Box<[Option<AppliedOwner>; PAGE]>>>()
            + self.pages.iter().flatten().count() * size_of::<[Option<AppliedOwner>; PAGE]>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn owners_are_sorted_and_empty_pages_are_freed() {
        let mut applied = AppliedOwners::new(1 << 24);
        let empty = applied.bytes();
        assert!(empty < 3 << 20, "{empty} bytes");
        for owner in [1 << 24, 0, 63, 64] {
            applied.insert(owner, AppliedOwner { children: owner, ..AppliedOwner::default() });
        }
        let there: Vec<(u32, u32)> =
            applied.iter().map(|(owner, applied)| (owner, applied.children)).collect();
        assert_eq!(there, [(0, 0), (63, 63), (64, 64), (1 << 24, 1 << 24)]);
        assert!(applied.bytes() > empty);
        for owner in [63, 1 << 24, 64, 0, 5, u32::MAX] {
            applied.remove(owner);
            assert!(applied.get(owner).is_none() && applied.get_mut(owner).is_none());
        }
        assert_eq!((applied.iter().count(), applied.bytes()), (0, empty));
    }
}
