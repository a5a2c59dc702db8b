//! What is known of each applied owner: memory follows what is applied, not how many chunks the
//! asset claims to have.

use std::ops::Range;

use crate::numbers::id32;

/// Where an applied owner's elements are.
#[derive(Clone, Debug, Default)]
pub(crate) struct AppliedOwner {
    pub(crate) vertices: Range<u32>,
    pub(crate) wedges: Range<u32>,
    pub(crate) faces: Range<u32>,
    /// Per material: slots in its index list.
    pub(crate) draws: Vec<(u16, Range<u32>)>,
    /// The truncation that a chunk is applied up to; `None` once it is whole.
    pub(crate) truncation: Option<u8>,
    /// Applied chunks that name this one as a parent, or refer to what it brought.
    pub(crate) children: u32,
    /// Owners among whose children this one was counted.
    pub(crate) needs: Vec<u32>,
    /// What undoing it puts back.
    pub(crate) undo: Undo,
}

/// What chunks change of a vertex that is older than they are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VertexState {
    pub(crate) position: [i32; 3],
    pub(crate) morph_from: [i32; 3],
    pub(crate) shift: u8,
    pub(crate) mover: u32,
}

/// What undoing a chunk puts back, by slot.
#[derive(Clone, Debug, Default)]
pub(crate) struct Undo {
    /// Older vertices that it moved, as they are put back.
    pub(crate) vertices: Box<[(u32, VertexState)]>,
    /// Corners of older faces that it moved (`face × 3 + k`), and the wedges that they were at.
    pub(crate) corners: Box<[(u32, u32)]>,
}

impl Undo {
    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.vertices) + size_of_val(&*self.corners)
    }
}

/// Owners per page: those of one index page, which is asked for as a whole.
const PAGE: usize = 64;

/// What is applied, by owner, in pages that exist once one of their owners is applied. A untrusted peer's asset may
/// claim 2^22 chunks in a few bytes: that costs 0.5 MB here, and a list of all of them 0.5 GB.
#[derive(Clone, Debug)]
pub(crate) struct AppliedOwners {
    pages: Vec<Option<Box<[Option<AppliedOwner>; PAGE]>>>,
    owners: usize,
}

impl AppliedOwners {
    /// None applied, of the base mesh and so many chunks.
    pub(crate) fn new(chunks: u32) -> Self {
        let owners = chunks as usize + 1;
        Self { pages: vec![None; owners.div_ceil(PAGE)], owners }
    }

    /// How many owners there may be: the chunks and the base mesh.
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
    fn owners_come_back_in_order_and_pages_go_with_their_last() {
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
