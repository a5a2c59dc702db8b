//! Candidate predictions of a wedge's texture coordinates, and which of them to trust.

use crate::codec::base::guess::{NEWEST, Newest, Trust};
use crate::codec::position::axes;
use crate::codec::residual::Recent;
use crate::mesh::vec3::{Vec3, cross, sub};

/// Guesses at a texture coordinate: that near by; along the chart, or beside it to either side; that of a part
/// before, this moved on as from the one before that, and moved along with what is near by; that which the vertex
/// has elsewhere; the edge across a seam, forwards and backwards, and turned to either side; along the last face
/// that looked the same way; the values that came last.
pub(super) const GUESSES: usize = FIRST_NEWEST + NEWEST;
pub(super) const BESIDE: usize = 0;
pub(super) const CHART: usize = 1;
pub(super) const FIRST_SIMILAR: usize = 2;
pub(super) const REPEATED: usize = 4;
pub(super) const REPEATED_ON: usize = 5;
pub(super) const REPEATED_ALONG: usize = 6;
pub(super) const ELSEWHERE: usize = 7;
pub(super) const FIRST_SEAM: usize = 8;
pub(super) const FACING: usize = 12;
pub(super) const FIRST_NEWEST: usize = 13;

/// Which guesses at a texture coordinate to trust, by axis.
pub(super) struct UvGuesses {
    pub(super) trust: [Trust<GUESSES>; 2],
    pub(super) newest: [Newest; 2],
    /// By the way a face looks, the wedges of the last that looked that way.
    pub(super) facing: [Option<[u32; 3]>; 6],
    pub(super) recent: Recent,
}

impl UvGuesses {
    pub(super) fn new(bits: u8) -> Self {
        let across = 4 * (i32::from(bits) - 3);
        let (mut all, mut chosen) = ([across; GUESSES], [0; GUESSES]);
        (all[CHART], all[REPEATED], all[REPEATED_ON], all[REPEATED_ALONG]) = (8, 16, 8, 0);
        chosen[BESIDE] = across - 8;
        Self {
            trust: [(); 2].map(|()| Trust::new(all, chosen)),
            newest: Default::default(),
            facing: [None; 6],
            recent: Recent::default(),
        }
    }

    /// Takes note of a face.
    pub(super) fn follow(&mut self, places: [Vec3; 3], wedges: [u32; 3]) {
        self.facing[facing(places)] = Some(wedges);
    }
}

/// Which of six ways a triangle looks most.
pub(super) fn facing(at: [Vec3; 3]) -> usize {
    let normal = cross(sub(at[1], at[0]), sub(at[2], at[0]));
    let [_, _, axis] = axes(normal);
    axis * 2 + usize::from(normal[axis] < 0.0)
}
