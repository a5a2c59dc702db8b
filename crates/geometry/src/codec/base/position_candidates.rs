//! Candidate predictions of a vertex's position, with their recent errors.

use crate::codec::base::candidates::{CandidateErrors, RECENT_VALUES, RecentValues};
use crate::codec::residual::Recent;

/// Number of candidates for a coordinate: parallelogram or neighbour; repetition of an earlier component; the known
/// corners; recent values.
pub(super) const CANDIDATES: usize = FIRST_RECENT + RECENT_VALUES;
pub(super) const NEIGHBOUR: usize = 0;
pub(super) const REPEATED: usize = 1;
pub(super) const FIRST_CORNER: usize = 2;
pub(super) const FIRST_RECENT: usize = 5;

/// Errors of the candidates for a coordinate, by axis, for seed faces and faces at gates.
pub(super) struct PositionCandidates {
    pub(super) seed: [CandidateErrors<CANDIDATES>; 3],
    pub(super) gate: [CandidateErrors<CANDIDATES>; 3],
    pub(super) recent_values: [RecentValues; 3],
    pub(super) recent: Recent,
}

impl PositionCandidates {
    pub(super) fn new(bits: u8) -> Self {
        // A face of a base mesh spans about an eighth of the grid.
        let across = 4 * (i32::from(bits) - 3);
        let errors = |beside: i32, chosen: i32| {
            let (mut all, mut when_chosen) = ([across; CANDIDATES], [0; CANDIDATES]);
            (all[NEIGHBOUR], all[REPEATED], when_chosen[NEIGHBOUR]) = (beside, 0, chosen);
            CandidateErrors::new(all, when_chosen)
        };
        Self {
            seed: [(); 3].map(|()| errors(across, across)),
            gate: [(); 3].map(|()| errors(across - 2, across - 4)),
            recent_values: Default::default(),
            recent: Recent::default(),
        }
    }
}
