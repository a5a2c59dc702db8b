//! The slots that a change of the mesh touches.

/// What changed with a chunk: slots whose data a renderer must fetch again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Touched {
    /// Wedge slots, ascending.
    pub wedges: Vec<u32>,
    /// (material, slot in its index list), ascending.
    pub draws: Vec<(u16, u32)>,
}

impl Touched {
    /// Adds what changed after this.
    pub fn merge(&mut self, later: Self) {
        self.wedges.extend(later.wedges);
        self.draws.extend(later.draws);
        // Stable sorting merges what is in order already.
        self.wedges.sort();
        self.wedges.dedup();
        self.draws.sort();
        self.draws.dedup();
    }
}
