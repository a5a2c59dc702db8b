//! Coding of a corner's vertex: an existing one, or a new one with its position.

use crate::codec::base::border::Likely;
use crate::codec::base::position_candidates::{CANDIDATES, FIRST_CORNER, FIRST_RECENT, NEIGHBOUR, REPEATED};
use crate::codec::base::walk::{Corners, Walk};
use crate::codec::model::{
    BASE_CHOICE, BASE_LIKELY_VERTEX, BASE_NEW_VERTEX, BASE_WHICH_VERTEX, MAX_CHOICES, REPEAT_STATES,
};
use crate::codec::position::POSITION;
use crate::codec::residual::UNKNOWN;
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::index;
use crate::error::DecodeError;
use crate::mesh::corner;
use crate::numbers::id32;

impl<C: Coder> Walk<'_, C> {
    /// Codes the next corner's vertex; `want` is the wedge there to encode.
    pub(super) fn vertex(&mut self, corners: &Corners, want: Option<u32>) -> Result<u32, DecodeError> {
        let count = self.mesh.positions.len();
        let wanted = match (&self.target, want) {
            (Some(wanted), Some(wedge)) => wanted.vertex_number(wedge),
            _ => None,
        };
        let [b, a, _] = corners.vertices;
        let likely = corners.gate.map(|_| self.border.likely(a, b));
        let context = match &likely {
            None => 0,
            Some(Likely { vertices, .. }) if vertices.is_empty() => 1,
            Some(Likely { closes, .. }) => 2 + usize::from(*closes),
        };
        if count > 0 && !self.flag(BASE_NEW_VERTEX + context * REPEAT_STATES, wanted.is_none()) {
            let likely = likely.map_or_else(Vec::new, |likely| likely.vertices);
            return self.old_vertex(&likely, wanted.unwrap_or(0));
        }
        let actual = match (&self.target, want) {
            (Some(wanted), Some(wedge)) => Some(wanted.position(wedge)),
            _ => None,
        };
        let position = self.position(corners, actual)?;
        self.mesh.positions.push(position);
        self.wedges_of.push(Vec::new());
        self.border.vertex();
        if let (Some(wanted), Some(wedge)) = (&mut self.target, want) {
            wanted.number_vertex(wedge);
        }
        Ok(id32(count))
    }

    /// Codes which existing vertex it is, the likely ones first.
    fn old_vertex(&mut self, likely: &[u32], wanted: u32) -> Result<u32, DecodeError> {
        let place = likely.iter().position(|&v| v == wanted);
        if let Some((&last, others)) = likely.split_last()
            && self.flag(BASE_LIKELY_VERTEX, place.is_some())
        {
            for (i, &v) in others.iter().enumerate() {
                if self.flag(BASE_WHICH_VERTEX + i.min(1) * REPEAT_STATES, place == Some(i)) {
                    return Ok(v);
                }
            }
            return Ok(last);
        }
        index(self.coder, self.mesh.positions.len(), wanted as usize, "base mesh: vertex").map(id32)
    }

    fn position(&mut self, corners: &Corners, actual: Option<[i32; 3]>) -> Result<[i32; 3], DecodeError> {
        let candidates = self.next_position_candidates(corners);
        let gate = usize::from(corners.gate.is_some());
        let top = (1 << self.format.bits) - 1;
        let mut position = [0; 3];
        let mut other = UNKNOWN;
        for axis in 0..3 {
            let known = &self.position_candidates;
            let mut candidates = candidates.map(|guess| guess.map(|guess| guess[axis].clamp(0, top)));
            if self.choosing {
                candidates[FIRST_RECENT..].copy_from_slice(known.recent_values[axis].values());
            }
            let errors = if gate == 1 { &known.gate } else { &known.seed };
            let at = BASE_CHOICE + (gate * 3 + axis) * MAX_CHOICES;
            let choice =
                errors[axis].choose(self.coder, at, candidates, self.choosing, actual.map(|p| p[axis]));
            let known = &mut self.position_candidates;
            let residual = actual.map_or(0, |p| p[axis] - choice.value);
            let recent = known.recent.class(axis);
            let got = POSITION[axis].code(self.coder, choice.size, recent, other, residual);
            position[axis] = choice.value.wrapping_add(got);
            if !(0..=top).contains(&position[axis]) {
                return Err(DecodeError::new("base mesh", "a position is off the grid"));
            }
            other = known.recent.follow(axis, got, choice.size);
            let errors = if gate == 1 { &mut known.gate } else { &mut known.seed };
            errors[axis].follow(candidates, choice, position[axis]);
            known.recent_values[axis].follow(position[axis]);
        }
        Ok(position)
    }

    /// Candidates for the next vertex's position; see [`CANDIDATES`].
    fn next_position_candidates(&self, corners: &Corners) -> [Option<[i32; 3]>; CANDIDATES] {
        let p = &self.mesh.positions;
        let at = |v: u32| p[v as usize];
        let mut candidates = [None; CANDIDATES];
        let known = match corners.gate {
            Some(gate) => {
                let v = self.corners(gate.face);
                let [a, b, c] = [gate.k, corner::next(gate.k), corner::previous(gate.k)].map(|k| at(v[k]));
                // Parallelogram rule (Touma and Gotsman, 1998).
                candidates[NEIGHBOUR] = Some([0, 1, 2].map(|i| a[i] + b[i] - c[i]));
                [Some(a), Some(b), Some(c)]
            }
            None => {
                let before = [0, 1].map(|i| (i < corners.next).then(|| at(corners.vertices[i])));
                let near = before[1].or(before[0]).or(p.last().copied());
                candidates[NEIGHBOUR] = Some(near.unwrap_or([1 << (self.format.bits - 1); 3]));
                [before[0], None, None]
            }
        };
        if self.choosing {
            candidates[FIRST_CORNER..FIRST_RECENT].copy_from_slice(&known);
        }
        let (next, first) = (p.len(), self.repeats.first_vertex());
        let moved =
            |like: [i32; 3], from: [i32; 3], to: [i32; 3]| [0, 1, 2].map(|i| like[i] + to[i] - from[i]);
        candidates[REPEATED] = match (self.repeats.vertex(next), self.repeats.vertex(first)) {
            // The first vertex of a component continues the spacing of the two before.
            ([Some(like), earlier], _) if next == first => {
                Some(moved(p[like], earlier.map_or(p[like], |earlier| p[earlier]), p[like]))
            }
            ([Some(like), _], [Some(like_first), _]) => Some(moved(p[like], p[like_first], p[first])),
            _ => None,
        };
        candidates
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::base::mesh::BaseFormat;
    use crate::codec::base::walk::Gate;
    use crate::entropy::null_coder::NullCoder;
    use crate::mesh::{Face, Kinds, Wedge};

    /// Candidates for the next vertex after `positions`, each with one wedge; every three positions form a component.
    fn candidates(
        positions: &[[i32; 3]],
        parts: usize,
        choosing: bool,
        corners: &Corners,
    ) -> [Option<[i32; 3]>; CANDIDATES] {
        let format =
            BaseFormat { bits: 8, kinds: Kinds::default(), materials: 1, parts: 1, uv_ratios: [1.0; 2] };
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
        walk.next_position_candidates(corners)
    }

    const PART: [[i32; 3]; 3] = [[10, 20, 30], [14, 21, 33], [11, 27, 39]];

    #[test]
    fn a_gate_predicts_the_parallelogram_and_its_corners() {
        for (k, beside) in [(0, [13, 14, 24]), (1, [15, 28, 42]), (2, [7, 26, 36])] {
            let corners = Corners { gate: Some(Gate { face: 0, k }), next: 2, ..Corners::default() };
            let there = candidates(&PART, 0, true, &corners);
            assert_eq!(there[NEIGHBOUR], Some(beside));
            let corners_of_gate = [k, corner::next(k), corner::previous(k)].map(|k| Some(PART[k]));
            assert_eq!(there[FIRST_CORNER..FIRST_RECENT], corners_of_gate);
            assert!(there[REPEATED].is_none() && there[FIRST_RECENT..].iter().all(Option::is_none));
            // Without choosing, only the neighbour and repetition candidates are given.
            let mut first = [None; CANDIDATES];
            first[NEIGHBOUR] = Some(beside);
            assert_eq!(candidates(&PART, 0, false, &corners), first);
        }
    }

    #[test]
    fn a_seed_predicts_the_previous_corner_or_newest_vertex_or_centre() {
        let beside = |positions: &[[i32; 3]], vertices, next| {
            let there = candidates(positions, 0, true, &Corners { vertices, next, ..Corners::default() });
            (there[NEIGHBOUR].unwrap(), there[FIRST_CORNER], there[FIRST_CORNER + 1])
        };
        assert_eq!(beside(&[], [0; 3], 0), ([128; 3], None, None));
        assert_eq!(beside(&PART, [0; 3], 0), (PART[2], None, None));
        assert_eq!(beside(&PART, [1, 0, 0], 1), (PART[1], Some(PART[1]), None));
        assert_eq!(beside(&PART, [1, 0, 0], 2), (PART[0], Some(PART[1]), None));
    }

    #[test]
    fn a_repeated_component_predicts_its_positions() {
        let moved = |by: i32| PART.map(|p| [p[0] + by, p[1], p[2] - 2 * by]);
        let corners = Corners::default();
        let repeated =
            |positions: &[[i32; 3]], parts| candidates(positions, parts, false, &corners)[REPEATED];
        let all = [PART, moved(50), moved(100)].concat();
        // No component precedes the first; the second starts at the first's position, the third at equal spacing.
        assert_eq!(repeated(&all[..1], 1), None);
        assert_eq!(repeated(&all[..3], 2), Some(PART[0]));
        assert_eq!(repeated(&all[..6], 3), Some(all[6]));
        // Within a component, vertices repeat the offsets of the one before.
        for (parts, there) in [(2, 4), (2, 5), (3, 7), (3, 8)] {
            assert_eq!(repeated(&all[..there], parts), Some(all[there]));
        }
    }
}
