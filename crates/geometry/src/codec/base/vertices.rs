//! A corner's vertex: one that is there, or a new one and where it is.

use crate::codec::base::border::Likely;
use crate::codec::base::position_guesses::{BESIDE, FIRST_CORNER, FIRST_NEWEST, GUESSES, REPEATED};
use crate::codec::base::walk::{Corners, Walk};
use crate::codec::model::{
    BASE_CHOICE, BASE_LIKELY_VERTEX, BASE_NEW_VERTEX, BASE_WHICH_VERTEX, MOST_CHOICES, TOLD,
};
use crate::codec::position::POSITION;
use crate::codec::residual::UNKNOWN;
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::index;
use crate::error::DecodeError;
use crate::mesh::corner;
use crate::numbers::id32;

impl<C: Coder> Walk<'_, C> {
    /// The next corner's vertex; `want` is the wedge there that an encoder wants.
    pub(super) fn vertex(&mut self, corners: &Corners, want: Option<u32>) -> Result<u32, DecodeError> {
        let count = self.mesh.positions.len();
        let wanted = match (&self.wanted, want) {
            (Some(wanted), Some(wedge)) => wanted.said_vertex(wedge),
            _ => None,
        };
        let [b, a, _] = corners.vertices;
        let likely = corners.gate.map(|_| self.border.likely(a, b));
        let context = match &likely {
            None => 0,
            Some(Likely { vertices, .. }) if vertices.is_empty() => 1,
            Some(Likely { closes, .. }) => 2 + usize::from(*closes),
        };
        if count > 0 && !self.flag(BASE_NEW_VERTEX + context * TOLD, wanted.is_none()) {
            let likely = likely.map_or_else(Vec::new, |likely| likely.vertices);
            return self.old_vertex(&likely, wanted.unwrap_or(0));
        }
        let actual = match (&self.wanted, want) {
            (Some(wanted), Some(wedge)) => Some(wanted.position(wedge)),
            _ => None,
        };
        let position = self.position(corners, actual)?;
        self.mesh.positions.push(position);
        self.wedges_of.push(Vec::new());
        self.border.vertex();
        if let (Some(wanted), Some(wedge)) = (&mut self.wanted, want) {
            wanted.say_vertex(wedge);
        }
        Ok(id32(count))
    }

    /// One of the vertices that are there, perhaps a likely one.
    fn old_vertex(&mut self, likely: &[u32], wanted: u32) -> Result<u32, DecodeError> {
        let place = likely.iter().position(|&v| v == wanted);
        if let Some((&last, others)) = likely.split_last()
            && self.flag(BASE_LIKELY_VERTEX, place.is_some())
        {
            for (i, &v) in others.iter().enumerate() {
                if self.flag(BASE_WHICH_VERTEX + i.min(1) * TOLD, place == Some(i)) {
                    return Ok(v);
                }
            }
            return Ok(last);
        }
        index(self.coder, self.mesh.positions.len(), wanted as usize, "base mesh: vertex").map(id32)
    }

    fn position(&mut self, corners: &Corners, actual: Option<[i32; 3]>) -> Result<[i32; 3], DecodeError> {
        let guesses = self.guesses_at_position(corners);
        let gate = usize::from(corners.gate.is_some());
        let top = (1 << self.format.bits) - 1;
        let mut position = [0; 3];
        let mut other = UNKNOWN;
        for axis in 0..3 {
            let known = &self.position_guesses;
            let mut guesses = guesses.map(|guess| guess.map(|guess| guess[axis].clamp(0, top)));
            if self.choosing {
                guesses[FIRST_NEWEST..].copy_from_slice(known.newest[axis].values());
            }
            let trust = if gate == 1 { &known.gate } else { &known.seed };
            let at = BASE_CHOICE + (gate * 3 + axis) * MOST_CHOICES;
            let choice = trust[axis].choose(self.coder, at, guesses, self.choosing, actual.map(|p| p[axis]));
            let known = &mut self.position_guesses;
            let residual = actual.map_or(0, |p| p[axis] - choice.value);
            let recent = known.recent.class(axis);
            let got = POSITION[axis].code(self.coder, choice.size, recent, other, residual);
            position[axis] = choice.value.wrapping_add(got);
            if !(0..=top).contains(&position[axis]) {
                return Err(DecodeError::new("base mesh", "a position is off the grid"));
            }
            other = known.recent.follow(axis, got, choice.size);
            let trust = if gate == 1 { &mut known.gate } else { &mut known.seed };
            trust[axis].follow(guesses, choice, position[axis]);
            known.newest[axis].follow(position[axis]);
        }
        Ok(position)
    }

    /// Where the next vertex may be; see [`GUESSES`].
    fn guesses_at_position(&self, corners: &Corners) -> [Option<[i32; 3]>; GUESSES] {
        let p = &self.mesh.positions;
        let at = |v: u32| p[v as usize];
        let mut guesses = [None; GUESSES];
        let known = match corners.gate {
            Some(gate) => {
                let v = self.corners(gate.face);
                let [a, b, c] = [gate.k, corner::next(gate.k), corner::previous(gate.k)].map(|k| at(v[k]));
                // Parallelogram rule (Touma and Gotsman, 1998).
                guesses[BESIDE] = Some([0, 1, 2].map(|i| a[i] + b[i] - c[i]));
                [Some(a), Some(b), Some(c)]
            }
            None => {
                let before = [0, 1].map(|i| (i < corners.next).then(|| at(corners.vertices[i])));
                let near = before[1].or(before[0]).or(p.last().copied());
                guesses[BESIDE] = Some(near.unwrap_or([1 << (self.format.bits - 1); 3]));
                [before[0], None, None]
            }
        };
        if self.choosing {
            guesses[FIRST_CORNER..FIRST_NEWEST].copy_from_slice(&known);
        }
        let (next, first) = (p.len(), self.repeats.first_vertex());
        let moved =
            |like: [i32; 3], from: [i32; 3], to: [i32; 3]| [0, 1, 2].map(|i| like[i] + to[i] - from[i]);
        guesses[REPEATED] = match (self.repeats.vertex(next), self.repeats.vertex(first)) {
            // Rows go on as they began.
            ([Some(like), earlier], _) if next == first => {
                Some(moved(p[like], earlier.map_or(p[like], |earlier| p[earlier]), p[like]))
            }
            ([Some(like), _], [Some(like_first), _]) => Some(moved(p[like], p[like_first], p[first])),
            _ => None,
        };
        guesses
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::base::mesh::BaseFormat;
    use crate::codec::base::walk::Gate;
    use crate::entropy::null_coder::NullCoder;
    use crate::mesh::{Face, Kinds, Wedge};

    /// Guesses at the next vertex beside these, with a wedge each, of which three and three are a part.
    fn guesses(
        positions: &[[i32; 3]],
        parts: usize,
        choosing: bool,
        corners: &Corners,
    ) -> [Option<[i32; 3]>; GUESSES] {
        let format = BaseFormat { bits: 8, kinds: Kinds::default(), materials: 1, uv_ratio: 1.0 };
        let mut coder = NullCoder;
        let mut walk = Walk::new(&mut coder, format, u64::MAX, choosing);
        walk.mesh.positions = positions.to_vec();
        walk.mesh.wedges =
            (0..id32(positions.len())).map(|v| Wedge { vertex: v, ..Wedge::default() }).collect();
        walk.mesh.faces = vec![Face { wedges: [0, 1, 2], material: 0 }];
        for part in 0..parts {
            walk.repeats.begin(3 * part, 3 * part);
            walk.repeats.follow(7, true);
        }
        walk.guesses_at_position(corners)
    }

    const PART: [[i32; 3]; 3] = [[10, 20, 30], [14, 21, 33], [11, 27, 39]];

    #[test]
    fn over_a_gate_the_fourth_corner_of_a_parallelogram_and_the_gates_corners_are_guessed() {
        for (k, beside) in [(0, [13, 14, 24]), (1, [15, 28, 42]), (2, [7, 26, 36])] {
            let corners = Corners { gate: Some(Gate { face: 0, k }), next: 2, ..Corners::default() };
            let there = guesses(&PART, 0, true, &corners);
            assert_eq!(there[BESIDE], Some(beside));
            let corners_of_gate = [k, corner::next(k), corner::previous(k)].map(|k| Some(PART[k]));
            assert_eq!(there[FIRST_CORNER..FIRST_NEWEST], corners_of_gate);
            assert!(there[REPEATED].is_none() && there[FIRST_NEWEST..].iter().all(Option::is_none));
            // Only who chooses has others than that beside and that of a part before.
            let mut first = [None; GUESSES];
            first[BESIDE] = Some(beside);
            assert_eq!(guesses(&PART, 0, false, &corners), first);
        }
    }

    #[test]
    fn a_seeds_corner_is_guessed_at_the_corner_before_or_at_the_newest_vertex_or_in_the_middle() {
        let beside = |positions: &[[i32; 3]], vertices, next| {
            let there = guesses(positions, 0, true, &Corners { vertices, next, ..Corners::default() });
            (there[BESIDE].unwrap(), there[FIRST_CORNER], there[FIRST_CORNER + 1])
        };
        assert_eq!(beside(&[], [0; 3], 0), ([128; 3], None, None));
        assert_eq!(beside(&PART, [0; 3], 0), (PART[2], None, None));
        assert_eq!(beside(&PART, [1, 0, 0], 1), (PART[1], Some(PART[1]), None));
        assert_eq!(beside(&PART, [1, 0, 0], 2), (PART[0], Some(PART[1]), None));
    }

    #[test]
    fn a_part_like_one_before_is_guessed_to_lie_as_that_one_did() {
        let moved = |by: i32| PART.map(|p| [p[0] + by, p[1], p[2] - 2 * by]);
        let corners = Corners::default();
        let repeated = |positions: &[[i32; 3]], parts| guesses(positions, parts, false, &corners)[REPEATED];
        let all = [PART, moved(50), moved(100)].concat();
        // Of the first part nothing is before; the second begins where the first did, the third as far on.
        assert_eq!(repeated(&all[..1], 1), None);
        assert_eq!(repeated(&all[..3], 2), Some(PART[0]));
        assert_eq!(repeated(&all[..6], 3), Some(all[6]));
        // Where one has begun, the rest lies as before.
        for (parts, there) in [(2, 4), (2, 5), (3, 7), (3, 8)] {
            assert_eq!(repeated(&all[..there], parts), Some(all[there]));
        }
    }
}
