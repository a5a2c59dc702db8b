//! Coding of a corner's wedge: one of its vertex's wedges, or a new one with its attributes.

use crate::codec::attributes::{
    Expected, SHARED_IN_BASE, SharedUv, UV, code_attributes, code_shared, shared_second,
};
use crate::codec::base::candidates::{Chart, rounded};
use crate::codec::base::uv_candidates::{
    CANDIDATES, CHART, FIRST_RECENT, FIRST_SEAM, FIRST_SIMILAR, NEIGHBOUR, OTHER_WEDGE, REPEATED,
    REPEATED_ALONG, REPEATED_ON, SAME_ORIENTATION, orientation,
};
use crate::codec::base::walk::{Corners, Walk};
use crate::codec::model::{
    BASE_CHOICE, BASE_NEW_WEDGE, BASE_SAME_GROUP, BASE_SAME_WEDGE, MAX_CHOICES, REPEAT_STATES, SHARED_UV,
};
use crate::codec::residual::UNKNOWN;
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::index;
use crate::error::DecodeError;
use crate::mesh::{Attributes, Kinds, Wedge, corner};
use crate::numbers::id32;

impl<C: Coder> Walk<'_, C> {
    /// Codes the next corner's wedge; `want` is the one to encode.
    pub(super) fn wedge(&mut self, corners: &Corners, want: Option<u32>) -> Result<u32, DecodeError> {
        let i = corners.next;
        let (vertex, across) = (corners.vertices[i], corners.across[i]);
        let wanted = match (&self.target, want) {
            (Some(wanted), Some(wedge)) => wanted.wedge_number(wedge),
            _ => None,
        };
        let on_chart = across.or_else(|| self.wedge_of_chart(corners));
        let guess = on_chart.or(self.wedges_of[vertex as usize].first().copied());
        if let Some(guess) = guess {
            let context = match (across.is_some(), i) {
                (true, 0) => 0,
                (true, _) => 1 + usize::from(!self.shares_gate(corners, 1)),
                (false, _) => 3 + usize::from(on_chart.is_none()),
            };
            if self.flag(BASE_SAME_WEDGE + context * REPEAT_STATES, wanted == Some(guess)) {
                return Ok(guess);
            }
            if !self.flag(BASE_NEW_WEDGE, wanted.is_none()) {
                let own = &self.wedges_of[vertex as usize];
                let place = own.iter().position(|&w| Some(w) == wanted).unwrap_or(0);
                return Ok(own[index(self.coder, own.len(), place, "base mesh: wedge")?]);
            }
        }
        self.new_wedge(corners, guess, want)
    }

    /// Whether the first `count` corners share the adjacent face's wedges.
    fn shares_gate(&self, corners: &Corners, count: usize) -> bool {
        corners.gate.is_some() && (0..count).all(|i| corners.across[i] == Some(corners.wedges[i]))
    }

    /// The third corner's wedge in an adjacent face that shares a wedge with this one.
    fn wedge_of_chart(&self, corners: &Corners) -> Option<u32> {
        corners.gate.filter(|_| corners.next == 2)?;
        let [b, a, c] = corners.vertices;
        let wedge_at = |face: u32, vertex: u32| {
            let wedges = self.mesh.faces[face as usize].wedges;
            wedges.into_iter().find(|&w| self.mesh.wedges[w as usize].vertex == vertex)
        };
        [((c, a), a, 1), ((b, c), b, 0)].into_iter().find_map(|(edge, shared, corner)| {
            let face = *self.edges.get(&edge)?;
            (wedge_at(face, shared)? == corners.wedges[corner]).then(|| wedge_at(face, c))?
        })
    }

    /// `guess` is another wedge of the vertex.
    fn new_wedge(
        &mut self,
        corners: &Corners,
        guess: Option<u32>,
        want: Option<u32>,
    ) -> Result<u32, DecodeError> {
        let i = corners.next;
        let vertex = corners.vertices[i];
        let actual = match (&self.target, want) {
            (Some(wanted), Some(wedge)) => Some(wanted.attributes(wedge)),
            _ => None,
        };
        let before = i.checked_sub(1).map(|before| corners.wedges[before]);
        let near = corners.across[i].or(before);
        let [like, _] = self.repeats.wedge(self.mesh.wedges.len());
        let group_of = |w: usize| self.mesh.wedges[w].attributes.group;
        let group = match (like, before) {
            (Some(like), _) => Some((group_of(like), BASE_SAME_GROUP + 3 + i)),
            (None, Some(before)) => Some((group_of(before as usize), BASE_SAME_GROUP + i)),
            _ => None,
        };
        let expected = Expected {
            near: near.map(|w| self.mesh.wedges[w as usize].attributes),
            first: self.wedges_of[vertex as usize].is_empty(),
            group,
            ..Expected::default()
        };
        let (uv, second_uv) = self.uvs(corners, near, guess, actual)?;
        let others = Kinds { uv_bits: 0, second_uv_bits: 0, ..self.format.kinds };
        let attributes = code_attributes(self.coder, others, &mut Default::default(), &expected, actual)?;
        let wedge = id32(self.mesh.wedges.len());
        self.mesh.wedges.push(Wedge { vertex, attributes: Attributes { uv, second_uv, ..attributes } });
        self.wedges_of[vertex as usize].push(wedge);
        if let (Some(wanted), Some(name)) = (&mut self.target, want) {
            wanted.names.wedge(name);
        }
        Ok(wedge)
    }

    /// Codes both sets of texture coordinates.
    fn uvs(
        &mut self,
        corners: &Corners,
        near: Option<u32>,
        guess: Option<u32>,
        actual: Option<Attributes>,
    ) -> Result<([i32; 2], [u16; 2]), DecodeError> {
        let kinds = self.format.kinds;
        let first = actual.map(|w| w.uv);
        if kinds.second_uv_bits == 0 {
            return Ok((self.uv(0, corners, near, first)?, [0; 2]));
        }
        let second = actual.map(|w| w.uv_of_set(1));
        let shared = [0, 1].map(|set| {
            let uv = self.mesh.wedges[guess? as usize].attributes.uv_of_set(set);
            Some(SharedUv { uv, place: SHARED_IN_BASE })
        });
        let shared_first =
            if kinds.uv_bits > 0 { code_shared(self.coder, SHARED_UV, shared[0], first) } else { None };
        let uv = shared_first.map_or_else(|| self.uv(0, corners, near, first), Ok)?;
        let context = shared_second(kinds, shared[0], uv);
        let shared_second = code_shared(self.coder, context, shared[1], second);
        let second_uv = shared_second.map_or_else(|| self.uv(1, corners, near, second), Ok)?;
        // In range: below 2^16.
        Ok((uv, second_uv.map(|x| u16::try_from(x).unwrap_or_default())))
    }

    /// Codes one set of texture coordinates.
    fn uv(
        &mut self,
        set: usize,
        corners: &Corners,
        near: Option<u32>,
        actual: Option<[i32; 2]>,
    ) -> Result<[i32; 2], DecodeError> {
        let mut uv = [0; 2];
        let bits = self.format.kinds.uv_bits_of_set(set);
        if bits == 0 {
            return Ok(uv);
        }
        let candidates = self.next_uv_candidates(set, corners, near);
        let top = (1 << bits) - 1;
        let mut other = UNKNOWN;
        for axis in 0..2 {
            let known = &self.uv_candidates[set];
            let mut candidates = candidates.map(|guess| guess.map(|guess| guess[axis].clamp(0, top)));
            if self.choosing {
                candidates[FIRST_RECENT..].copy_from_slice(known.recent_values[axis].values());
            }
            let at = BASE_CHOICE + (6 + corners.next * 2 + axis) * MAX_CHOICES;
            let choice = known.errors[axis].choose(
                self.coder,
                at,
                candidates,
                self.choosing,
                actual.map(|uv| uv[axis]),
            );
            let known = &mut self.uv_candidates[set];
            let residual = actual.map_or(0, |uv| uv[axis] - choice.value);
            let got = UV[axis].code(self.coder, choice.size, known.recent.class(axis), other, residual);
            uv[axis] = choice.value.wrapping_add(got);
            if !(0..=top).contains(&uv[axis]) {
                return Err(DecodeError::new("base mesh", "a texture coordinate is off the grid"));
            }
            other = known.recent.follow(axis, got, choice.size);
            known.errors[axis].follow(candidates, choice, uv[axis]);
            known.recent_values[axis].follow(uv[axis]);
        }
        Ok(uv)
    }

    /// Candidates for a new wedge's texture coordinates; see [`CANDIDATES`].
    fn next_uv_candidates(
        &self,
        set: usize,
        corners: &Corners,
        near: Option<u32>,
    ) -> [Option<[i32; 2]>; CANDIDATES] {
        let uv = |wedge: usize| self.mesh.wedges[wedge].attributes.uv_of_set(set);
        let place = |wedge: u32| self.place(self.mesh.wedges[wedge as usize].vertex);
        let moved = |like: [i32; 2], from: [i32; 2], to: [i32; 2]| [0, 1].map(|k| like[k] + to[k] - from[k]);
        let ratio = self.format.uv_ratios[set];
        let beside = near.map_or([0; 2], |w| uv(w as usize));
        let places = corners.vertices.map(|v| self.place(v));
        let mut candidates = [None; CANDIDATES];
        candidates[NEIGHBOUR] = Some(beside);
        candidates[SAME_ORIENTATION] =
            self.uv_candidates[set].orientation[orientation(places)].map(|wedges| {
                let chart = Chart { at: wedges.map(place), uv: wedges.map(|w| uv(w as usize)) };
                chart.affine(places[corners.next])
            });
        if let (2, Some(gate)) = (corners.next, corners.gate.filter(|_| self.shares_gate(corners, 2))) {
            let opposite = self.mesh.faces[gate.face as usize].wedges[corner::previous(gate.k)];
            let wedges = [corners.wedges[0], corners.wedges[1], opposite];
            let chart = Chart { at: wedges.map(place), uv: wedges.map(|w| uv(w as usize)) };
            candidates[CHART] = Some(chart.affine(places[2]));
        } else if corners.next == 2 {
            let [a, b] = [0, 1].map(|k| uv(corners.wedges[k] as usize));
            let similar = Chart { at: places, uv: [a, b, [0; 2]] }.similar(ratio);
            let similar = similar.map_or([None; 2], |sides| sides.map(Some));
            candidates[FIRST_SIMILAR..FIRST_SIMILAR + 2].copy_from_slice(&similar);
        }
        if let [Some(like), earlier] = self.repeats.wedge(self.mesh.wedges.len()) {
            candidates[REPEATED] = Some(uv(like));
            candidates[REPEATED_ON] = earlier.map(|earlier| moved(uv(like), uv(earlier), uv(like)));
            let near_like = near.and_then(|w| self.repeats.wedge(w as usize)[0]);
            candidates[REPEATED_ALONG] = near_like.map(|near_like| moved(uv(like), uv(near_like), beside));
        }
        let own = &self.wedges_of[corners.vertices[corners.next] as usize];
        candidates[OTHER_WEDGE] = own.last().map(|&w| uv(w as usize));
        if let (1, [Some(from), Some(to), _]) = (corners.next, corners.across) {
            let [from, to] = [from, to].map(|w| uv(w as usize));
            let [du, dv] = [to[0] - from[0], to[1] - from[1]];
            let turned = [rounded(-f64::from(dv) * ratio), rounded(f64::from(du) / ratio)];
            let [u, v] = uv(corners.wedges[0] as usize);
            let edges = [[du, dv], [-du, -dv], turned, turned.map(|x| -x)];
            candidates[FIRST_SEAM..SAME_ORIENTATION]
                .copy_from_slice(&edges.map(|[du, dv]| Some([u + du, v + dv])));
        }
        candidates
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::base::mesh::BaseFormat;
    use crate::codec::base::walk::Gate;
    use crate::entropy::null_coder::NullCoder;
    use crate::mesh::Face;

    type Uv = [i32; 2];

    /// Texture coordinates: two texels per unit along x, minus three along y.
    fn map([x, y, _]: [i32; 3]) -> Uv {
        [20 + 2 * x, 99 - 3 * y]
    }

    /// A square in the xy plane: the first face is 0 1 2, mapped by [`map`]; corner 3 has a wedge of another chart.
    const SQUARE: [[i32; 3]; 4] = [[0, 0, 5], [8, 0, 5], [0, 8, 5], [8, 8, 5]];
    const OTHER_CHART: Uv = [77, 7];

    /// The candidates in that mesh; `set` may change the traversal's state.
    fn candidates(
        corners: &Corners,
        near: Option<u32>,
        uv_ratio: f64,
        set: impl FnOnce(&mut Walk<'_, NullCoder>),
    ) -> [Option<Uv>; CANDIDATES] {
        let kinds = Kinds { uv_bits: 8, ..Kinds::default() };
        let mut coder = NullCoder;
        let format = BaseFormat { bits: 8, kinds, materials: 1, parts: 1, uv_ratios: [uv_ratio; 2] };
        let mut walk = Walk::new(&mut coder, format, u64::MAX, true);
        walk.mesh.positions = SQUARE.to_vec();
        for (vertex, uv) in (0..).zip([map(SQUARE[0]), map(SQUARE[1]), map(SQUARE[2]), OTHER_CHART]) {
            walk.mesh.wedges.push(Wedge { vertex, attributes: Attributes { uv, ..Attributes::default() } });
            walk.wedges_of.push(vec![vertex]);
        }
        walk.mesh.faces = vec![Face { wedges: [0, 1, 2], material: 0 }];
        set(&mut walk);
        walk.next_uv_candidates(0, corners, near)
    }

    /// Indices of the candidates that are given.
    fn there(candidates: &[Option<Uv>]) -> Vec<usize> {
        candidates.iter().enumerate().filter(|(_, guess)| guess.is_some()).map(|(k, _)| k).collect()
    }

    /// The face across the square's diagonal, at its corner `next`, with these wedges.
    fn across(next: usize, wedges: [u32; 3]) -> Corners {
        let across = [Some(2), Some(1), None];
        Corners { gate: Some(Gate { face: 0, k: 1 }), across, vertices: [2, 1, 3], wedges, next }
    }

    #[test]
    fn a_shared_gate_predicts_the_affine_chart() {
        let chart = candidates(&across(2, [2, 1, 0]), Some(1), 1.0, |_| ());
        assert_eq!(there(&chart), [NEIGHBOUR, CHART, OTHER_WEDGE]);
        assert_eq!(
            [NEIGHBOUR, CHART, OTHER_WEDGE].map(|k| chart[k].unwrap()),
            [map(SQUARE[1]), map(SQUARE[3]), OTHER_CHART]
        );
    }

    #[test]
    fn seams_and_seeds_predict_similar_triangles_on_either_side() {
        // A right angle at 3 with sides of 8: the other two corners are 8√2 apart, and the third projects to their
        // middle.
        let seam = |ratio| candidates(&across(2, [2, 3, 0]), Some(3), ratio, |_| ());
        let [from, to] = [map(SQUARE[2]), OTHER_CHART];
        let (middle, half) = ([0, 1].map(|k| from[k] + to[k]), [0, 1].map(|k| to[k] - from[k]));
        let side = |sign: i32| {
            let doubled = [middle[0] - sign * half[1], middle[1] + sign * half[0]];
            Some(doubled.map(|x| (x + 1).div_euclid(2)))
        };
        assert_eq!(seam(1.0)[FIRST_SIMILAR..REPEATED], [side(1), side(-1)]);
        assert_eq!(there(&seam(1.0)), [NEIGHBOUR, FIRST_SIMILAR, FIRST_SIMILAR + 1, OTHER_WEDGE]);
        assert_ne!(seam(2.0)[FIRST_SIMILAR], side(1), "a cell's shape counts");
        let seed = Corners { gate: None, across: [None; 3], ..across(2, [2, 3, 0]) };
        assert_eq!(candidates(&seed, Some(3), 1.0, |_| ()), seam(1.0));
        // Only the third corner has these candidates.
        let second = Corners { next: 1, ..seed };
        assert_eq!(there(&candidates(&second, Some(3), 1.0, |_| ())), [NEIGHBOUR, OTHER_WEDGE]);
    }

    #[test]
    fn a_seam_predicts_the_edge_forwards_backwards_and_turned() {
        // At the second corner; the first has the wedge of the other chart. The edge runs from 2 to 1.
        let [du, dv] = [16, 24];
        let seam = candidates(&across(1, [3, 0, 0]), Some(3), 2.0, |_| ());
        let edges = [[du, dv], [-du, -dv], [-dv * 2, du / 2], [dv * 2, -du / 2]];
        assert_eq!(
            seam[FIRST_SEAM..SAME_ORIENTATION],
            edges.map(|[x, y]| Some([OTHER_CHART[0] + x, OTHER_CHART[1] + y]))
        );
        assert_eq!(there(&seam), [NEIGHBOUR, OTHER_WEDGE, FIRST_SEAM, 9, 10, 11]);
        assert_eq!(seam[OTHER_WEDGE], Some(map(SQUARE[1])));
        // The first corner has no edge yet.
        assert_eq!(there(&candidates(&across(0, [0; 3]), Some(2), 2.0, |_| ())), [NEIGHBOUR, OTHER_WEDGE]);
    }

    #[test]
    fn a_face_predicts_the_chart_of_the_last_with_its_orientation() {
        let corners = Corners { gate: None, across: [None; 3], ..across(0, [0; 3]) };
        let orientation = |places: [[i32; 3]; 3]| {
            let set = |walk: &mut Walk<'_, NullCoder>| {
                walk.uv_candidates[0].follow(places.map(|p| p.map(f64::from)), [0, 1, 2]);
            };
            let [first, second, third] = [0, 1, 2]
                .map(|next| candidates(&Corners { next, ..corners }, None, 1.0, set)[SAME_ORIENTATION]);
            [first, second, third]
        };
        // Face 2 1 3 has the orientation of 0 1 2, along z.
        let [a, b, c, d] = SQUARE;
        assert_eq!(orientation([a, b, c]), [c, b, d].map(|p| Some(map(p))));
        assert_eq!(orientation([a, c, b]), [None; 3]);
        // Without a neighbour the prediction is the origin.
        assert_eq!(candidates(&corners, None, 1.0, |_| ())[NEIGHBOUR], Some([0; 2]));
    }

    #[test]
    fn orientation_is_the_largest_component_of_the_normal() {
        let [x, y, z] = [[9.0, 1.0, 2.0], [2.0, 9.0, 1.0], [1.0, 2.0, 9.0]];
        let o = [0.0; 3];
        // The normal's main axis is in neither edge.
        let ways = [[o, y, z], [o, z, y], [o, z, x], [o, x, z], [o, x, y], [o, y, x]];
        assert_eq!(ways.map(orientation), [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn a_repeated_component_predicts_its_texture_coordinates() {
        let corners = Corners { vertices: [3, 3, 3], ..Corners::default() };
        // Components of one wedge and then another; the third's second is next.
        let uvs = [[10, 10], [12, 17], [40, 20], [43, 28], [70, 90]];
        let candidates = |wedges: usize, begins: &[usize], near: Option<u32>| {
            candidates(&corners, near, 1.0, |walk| {
                let of =
                    |&uv: &Uv| Wedge { vertex: 0, attributes: Attributes { uv, ..Attributes::default() } };
                walk.mesh.wedges = uvs[..wedges].iter().map(of).collect();
                walk.wedges_of = vec![Vec::new(); 4];
                for &begin in begins {
                    walk.repeats.begin(begin, begin);
                    walk.repeats.follow(7, true);
                }
            })
        };
        // The second component's second wedge: equal to the first's, or shifted by the neighbour's offset.
        let second = candidates(3, &[0, 2], Some(2));
        assert_eq!(there(&second), [NEIGHBOUR, REPEATED, REPEATED_ALONG]);
        assert_eq!(
            [NEIGHBOUR, REPEATED, REPEATED_ALONG].map(|k| second[k].unwrap()),
            [[40, 20], [12, 17], [42, 27]]
        );
        // The third's: equal to the second's, shifted by the spacing of the two, or by the neighbour's offset.
        let third = candidates(5, &[0, 2, 4], Some(4));
        let kinds = [REPEATED, REPEATED_ON, REPEATED_ALONG];
        assert_eq!(kinds.map(|k| third[k].unwrap()), [[43, 28], [74, 39], [73, 98]]);
        // Without a neighbour there is no offset.
        assert_eq!(there(&candidates(5, &[0, 2, 4], None)), [NEIGHBOUR, REPEATED, REPEATED_ON]);
        // No component precedes the first.
        assert_eq!(there(&candidates(1, &[0], Some(0))), [NEIGHBOUR]);
    }
}
