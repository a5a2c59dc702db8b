//! Candidate predictions of a wedge's texture coordinates, with their recent errors.

use crate::codec::base::candidates::{CandidateErrors, RECENT_VALUES, RecentValues};
use crate::codec::position::axes;
use crate::codec::residual::Recent;
use crate::mesh::vec3::{Vec3, cross, sub};

/// Number of candidates for a texture coordinate, in order: a neighbouring wedge; the affine extension of the chart,
/// or a similar triangle on either side; the corresponding wedge of an earlier component, shifted as between the two
/// before, and shifted by the neighbour's offset; another wedge of the vertex; the edge across a seam, forwards,
/// backwards and turned either way; the chart of the last face with the same orientation; recent values.
pub(super) const CANDIDATES: usize = FIRST_RECENT + RECENT_VALUES;
pub(super) const NEIGHBOUR: usize = 0;
pub(super) const CHART: usize = 1;
pub(super) const FIRST_SIMILAR: usize = 2;
pub(super) const REPEATED: usize = 4;
pub(super) const REPEATED_ON: usize = 5;
pub(super) const REPEATED_ALONG: usize = 6;
pub(super) const OTHER_WEDGE: usize = 7;
pub(super) const FIRST_SEAM: usize = 8;
pub(super) const SAME_ORIENTATION: usize = 12;
pub(super) const FIRST_RECENT: usize = 13;

/// Errors of the candidates for a texture coordinate, by axis.
pub(super) struct UvCandidates {
    pub(super) errors: [CandidateErrors<CANDIDATES>; 2],
    pub(super) recent_values: [RecentValues; 2],
    /// By orientation, the wedges of the last face with it.
    pub(super) orientation: [Option<[u32; 3]>; 6],
    pub(super) recent: Recent,
}

impl UvCandidates {
    pub(super) fn new(bits: u8) -> Self {
        let across = 4 * (i32::from(bits) - 3);
        let (mut all, mut chosen) = ([across; CANDIDATES], [0; CANDIDATES]);
        (all[CHART], all[REPEATED], all[REPEATED_ON], all[REPEATED_ALONG]) = (8, 16, 8, 0);
        chosen[NEIGHBOUR] = across - 8;
        Self {
            errors: [(); 2].map(|()| CandidateErrors::new(all, chosen)),
            recent_values: Default::default(),
            orientation: [None; 6],
            recent: Recent::default(),
        }
    }

    /// Records a face.
    pub(super) fn follow(&mut self, places: [Vec3; 3], wedges: [u32; 3]) {
        self.orientation[orientation(places)] = Some(wedges);
    }
}

/// Orientation of a triangle: one of six axis directions, by the largest component of the normal.
pub(super) fn orientation(at: [Vec3; 3]) -> usize {
    let normal = cross(sub(at[1], at[0]), sub(at[2], at[0]));
    let [_, _, axis] = axes(normal);
    axis * 2 + usize::from(normal[axis] < 0.0)
}
