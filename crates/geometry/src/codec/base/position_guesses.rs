//! Candidate predictions of a vertex's position, and which of them to trust.

use crate::codec::base::guess::{NEWEST, Newest, Trust};
use crate::codec::residual::Recent;

/// Guesses at a coordinate: by the neighbours; as in a part before; those of the corners that are known; the values
/// that came last.
pub(super) const GUESSES: usize = FIRST_NEWEST + NEWEST;
pub(super) const BESIDE: usize = 0;
pub(super) const REPEATED: usize = 1;
pub(super) const FIRST_CORNER: usize = 2;
pub(super) const FIRST_NEWEST: usize = 5;

/// Which guesses at a coordinate to trust, by axis.
pub(super) struct PositionGuesses {
    pub(super) seed: [Trust<GUESSES>; 3],
    pub(super) gate: [Trust<GUESSES>; 3],
    pub(super) newest: [Newest; 3],
    pub(super) recent: Recent,
}

impl PositionGuesses {
    pub(super) fn new(bits: u8) -> Self {
        // A face of a base mesh is some eighth of the grid across.
        let across = 4 * (i32::from(bits) - 3);
        let trust = |beside: i32, chosen: i32| {
            let (mut all, mut when_chosen) = ([across; GUESSES], [0; GUESSES]);
            (all[BESIDE], all[REPEATED], when_chosen[BESIDE]) = (beside, 0, chosen);
            Trust::new(all, when_chosen)
        };
        Self {
            seed: [(); 3].map(|()| trust(across, across)),
            gate: [(); 3].map(|()| trust(across - 2, across - 4)),
            newest: Default::default(),
            recent: Recent::default(),
        }
    }
}
