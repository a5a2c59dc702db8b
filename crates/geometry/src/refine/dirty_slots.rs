//! Dirty slots: the slots whose render data a change affects.

/// Slots whose data a renderer must fetch again after a change.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DirtySlots {
    /// Wedge slots, ascending.
    pub wedges: Vec<u32>,
    /// (material, slot in its index list), ascending.
    pub draws: Vec<(u16, u32)>,
}

impl DirtySlots {
    /// Adds the dirty slots of a later change.
    pub fn merge(&mut self, later: Self) {
        self.wedges.extend(later.wedges);
        self.draws.extend(later.draws);
        // A stable sort exploits existing runs.
        self.wedges.sort();
        self.wedges.dedup();
        self.draws.sort();
        self.draws.dedup();
    }
}
