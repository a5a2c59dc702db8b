//! The neighbours of a split vertex as a structure of arrays, for scoring in parallel lanes.

/// Lists of a ring: position relative to the centre, its length, valence, 1 if interior else 0, and the doubled area
/// of the face to the next neighbour.
pub(crate) const X: usize = 0;
pub(crate) const Y: usize = 1;
pub(crate) const Z: usize = 2;
pub(crate) const LENGTH: usize = 3;
pub(crate) const VALENCE: usize = 4;
pub(crate) const INTERIOR: usize = 5;
pub(crate) const AREA: usize = 6;

/// Capacity of each list of a small ring.
pub(crate) const SMALL_CAPACITY: usize = 32;

/// The neighbours in order, one list per property; entries past the end are meaningless. Small rings use arrays of
/// constant size, which need no bounds checks or pointer loads.
pub(crate) struct Ring {
    pub(crate) few: Box<[[f64; SMALL_CAPACITY]; 7]>,
    pub(crate) many: [Vec<f64>; 7],
}

impl Default for Ring {
    fn default() -> Self {
        Self { few: Box::new([[0.0; SMALL_CAPACITY]; 7]), many: Default::default() }
    }
}
