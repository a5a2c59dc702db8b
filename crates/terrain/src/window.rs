//! Generation of any rectangle of any level, level by level from the patch corners around it.

use super::rect::Rect;
use super::refine::{Value, View};

/// Reusable buffers of the generator: at most about four values per point of the largest window. One per thread.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    pub(super) heights: Buffers<i32>,
    pub(super) differences: Buffers<i64>,
    pub(super) sums: Vec<i64>,
}

impl Scratch {
    /// Empty buffers.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Memory held, in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.heights.bytes() + self.differences.bytes() + self.sums.capacity() * size_of::<i64>()
    }
}

/// Two levels: the current one, and the next one computed from it.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers<V> {
    last: Vec<V>,
    next: Vec<V>,
}

impl<V> Buffers<V> {
    pub(super) fn bytes(&self) -> usize {
        (self.last.capacity() + self.next.capacity()) * size_of::<V>()
    }
}

/// The points of level `from` that `rect` of level `to` ≥ `from` depends on.
pub(super) fn needed(rect: Rect, from: u8, to: u8) -> Rect {
    (from + 1..=to).rev().fold(rect, |rect, level| rect.parent(level))
}

/// Generates `rect` of level `to`, starting at level `from` ≤ `to`: `coarsest` fills a rectangle of that level,
/// `step` refines into the level it is given. Cost: about 4/3 of the points of `rect`.
pub(super) fn descend<V: Value>(
    rect: Rect,
    from: u8,
    to: u8,
    buffers: &mut Buffers<V>,
    out: &mut Vec<V>,
    coarsest: impl FnOnce(Rect, &mut Vec<V>),
    mut step: impl FnMut(View<'_, V>, u8, &mut [V]),
) {
    // wanted[i] are the points needed of level from + i.
    let mut wanted = [rect; 16];
    for level in (from + 1..=to).rev() {
        let i = usize::from(level - from);
        wanted[i - 1] = wanted[i].parent(level);
    }
    if from == to {
        return coarsest(rect, out);
    }
    coarsest(wanted[0], &mut buffers.last);
    // The extent of the current array, which may exceed `wanted`.
    let mut have = wanted[0];
    for level in from + 1..=to {
        let i = usize::from(level - from);
        let need = wanted[i - 1];
        let start = have.index_of(need.x, need.y);
        let parent = View { values: &buffers.last[start..], stride: have.width, rect: need };
        let child = need.child();
        // Every value is overwritten, so nothing is cleared.
        if child == rect && level == to {
            out.resize(child.len(), V::default());
            return step(parent, level, out);
        }
        if buffers.next.len() < child.len() {
            buffers.next.resize(child.len(), V::default());
        }
        step(parent, level, &mut buffers.next[..child.len()]);
        have = child;
        std::mem::swap(&mut buffers.last, &mut buffers.next);
    }
    out.clear();
    for row in 0..rect.height {
        let start = have.index_of(rect.x, rect.y) + row * have.width;
        out.extend_from_slice(&buffers.last[start..][..rect.width]);
    }
}
