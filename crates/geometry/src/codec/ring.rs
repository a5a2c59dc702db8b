//! The neighbours of a split vertex, as lists that are scored lane by lane.

/// What is known of a neighbour of a star's centre, by list: where it is relative to the centre, how far that is, its
/// valence, whether it is interior (1 or 0), and the area of the face from here to the next, doubled.
pub(crate) const X: usize = 0;
pub(crate) const Y: usize = 1;
pub(crate) const Z: usize = 2;
pub(crate) const LENGTH: usize = 3;
pub(crate) const VALENCE: usize = 4;
pub(crate) const INTERIOR: usize = 5;
pub(crate) const AREA: usize = 6;

/// Room of each list of a small ring.
pub(crate) const SMALL_ROOM: usize = 32;

/// The neighbours in order, a list for each thing that is known of them; what is behind the last means nothing. Those of
/// few neighbours are where it is known when compiling, so nothing asks where and whether there is room.
pub(crate) struct Ring {
    pub(crate) few: Box<[[f64; SMALL_ROOM]; 7]>,
    pub(crate) many: [Vec<f64>; 7],
}

impl Default for Ring {
    fn default() -> Self {
        Self { few: Box::new([[0.0; SMALL_ROOM]; 7]), many: Default::default() }
    }
}
