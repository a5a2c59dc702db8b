//! A corner's wedge: one of its vertex's, or a new one and its attributes.

use crate::codec::attributes::{Expected, UV, code_attributes};
use crate::codec::base::guess::{Chart, rounded};
use crate::codec::base::uv_guesses::{
    BESIDE, CHART, ELSEWHERE, FACING, FIRST_NEWEST, FIRST_SEAM, FIRST_SIMILAR, GUESSES, REPEATED,
    REPEATED_ALONG, REPEATED_ON, facing,
};
use crate::codec::base::walk::{Corners, Walk};
use crate::codec::model::{
    BASE_CHOICE, BASE_NEW_WEDGE, BASE_SAME_GROUP, BASE_SAME_WEDGE, MOST_CHOICES, TOLD,
};
use crate::codec::residual::{Recent, UNKNOWN};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::index;
use crate::error::DecodeError;
use crate::mesh::{Attributes, Kinds, Wedge, corner};
use crate::numbers::id32;

impl<C: Coder> Walk<'_, C> {
    /// The next corner's wedge; `want` is the one that an encoder wants.
    pub(super) fn wedge(&mut self, corners: &Corners, want: Option<u32>) -> Result<u32, DecodeError> {
        let i = corners.next;
        let (vertex, across) = (corners.vertices[i], corners.across[i]);
        let wanted = match (&self.wanted, want) {
            (Some(wanted), Some(wedge)) => wanted.said_wedge(wedge),
            _ => None,
        };
        let on_chart = across.or_else(|| self.wedge_of_chart(corners));
        if let Some(guess) = on_chart.or(self.wedges_of[vertex as usize].first().copied()) {
            let context = match (across.is_some(), i) {
                (true, 0) => 0,
                (true, _) => 1 + usize::from(!self.shares_gate(corners, 1)),
                (false, _) => 3 + usize::from(on_chart.is_none()),
            };
            if self.flag(BASE_SAME_WEDGE + context * TOLD, wanted == Some(guess)) {
                return Ok(guess);
            }
            if !self.flag(BASE_NEW_WEDGE, wanted.is_none()) {
                let own = &self.wedges_of[vertex as usize];
                let place = own.iter().position(|&w| Some(w) == wanted).unwrap_or(0);
                return Ok(own[index(self.coder, own.len(), place, "base mesh: wedge")?]);
            }
        }
        self.new_wedge(corners, want)
    }

    /// Whether the first `count` corners have the wedges across the gate.
    fn shares_gate(&self, corners: &Corners, count: usize) -> bool {
        corners.gate.is_some() && (0..count).all(|i| corners.across[i] == Some(corners.wedges[i]))
    }

    /// The wedge that a third corner's vertex has in a face next to it which shares a wedge with it.
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

    fn new_wedge(&mut self, corners: &Corners, want: Option<u32>) -> Result<u32, DecodeError> {
        let i = corners.next;
        let vertex = corners.vertices[i];
        let actual = match (&self.wanted, want) {
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
        let uv = self.uv(corners, near, actual.map(|w| w.uv))?;
        let others = Kinds { uv_bits: 0, ..self.format.kinds };
        let attributes = code_attributes(self.coder, others, &mut Recent::default(), &expected, actual)?;
        let wedge = id32(self.mesh.wedges.len());
        self.mesh.wedges.push(Wedge { vertex, attributes: Attributes { uv, ..attributes } });
        self.wedges_of[vertex as usize].push(wedge);
        if let (Some(wanted), Some(name)) = (&mut self.wanted, want) {
            wanted.names.wedge(name);
        }
        Ok(wedge)
    }

    fn uv(
        &mut self,
        corners: &Corners,
        near: Option<u32>,
        actual: Option<[i32; 2]>,
    ) -> Result<[i32; 2], DecodeError> {
        let mut uv = [0; 2];
        if self.format.kinds.uv_bits == 0 {
            return Ok(uv);
        }
        let guesses = self.guesses_at_uv(corners, near);
        let top = (1 << self.format.kinds.uv_bits) - 1;
        let mut other = UNKNOWN;
        for axis in 0..2 {
            let known = &self.uv_guesses;
            let mut guesses = guesses.map(|guess| guess.map(|guess| guess[axis].clamp(0, top)));
            if self.choosing {
                guesses[FIRST_NEWEST..].copy_from_slice(known.newest[axis].values());
            }
            let at = BASE_CHOICE + (6 + corners.next * 2 + axis) * MOST_CHOICES;
            let choice =
                known.trust[axis].choose(self.coder, at, guesses, self.choosing, actual.map(|uv| uv[axis]));
            let known = &mut self.uv_guesses;
            let residual = actual.map_or(0, |uv| uv[axis] - choice.value);
            let got = UV[axis].code(self.coder, choice.size, known.recent.class(axis), other, residual);
            uv[axis] = choice.value.wrapping_add(got);
            if !(0..=top).contains(&uv[axis]) {
                return Err(DecodeError::new("base mesh", "a texture coordinate is off the grid"));
            }
            other = known.recent.follow(axis, got, choice.size);
            known.trust[axis].follow(guesses, choice, uv[axis]);
            known.newest[axis].follow(uv[axis]);
        }
        Ok(uv)
    }

    /// What a new wedge's texture coordinates may be; see [`GUESSES`].
    fn guesses_at_uv(&self, corners: &Corners, near: Option<u32>) -> [Option<[i32; 2]>; GUESSES] {
        let uv = |wedge: usize| self.mesh.wedges[wedge].attributes.uv;
        let place = |wedge: u32| self.place(self.mesh.wedges[wedge as usize].vertex);
        let moved = |like: [i32; 2], from: [i32; 2], to: [i32; 2]| [0, 1].map(|k| like[k] + to[k] - from[k]);
        let ratio = self.format.uv_ratio;
        let beside = near.map_or([0; 2], |w| uv(w as usize));
        let places = corners.vertices.map(|v| self.place(v));
        let mut guesses = [None; GUESSES];
        guesses[BESIDE] = Some(beside);
        guesses[FACING] = self.uv_guesses.facing[facing(places)].map(|wedges| {
            let chart = Chart { at: wedges.map(place), uv: wedges.map(|w| uv(w as usize)) };
            chart.affine(places[corners.next])
        });
        if let (2, Some(gate)) = (corners.next, corners.gate.filter(|_| self.shares_gate(corners, 2))) {
            let opposite = self.mesh.faces[gate.face as usize].wedges[corner::previous(gate.k)];
            let wedges = [corners.wedges[0], corners.wedges[1], opposite];
            let chart = Chart { at: wedges.map(place), uv: wedges.map(|w| uv(w as usize)) };
            guesses[CHART] = Some(chart.affine(places[2]));
        } else if corners.next == 2 {
            let [a, b] = [0, 1].map(|k| uv(corners.wedges[k] as usize));
            let similar = Chart { at: places, uv: [a, b, [0; 2]] }.similar(ratio);
            let similar = similar.map_or([None; 2], |sides| sides.map(Some));
            guesses[FIRST_SIMILAR..FIRST_SIMILAR + 2].copy_from_slice(&similar);
        }
        if let [Some(like), earlier] = self.repeats.wedge(self.mesh.wedges.len()) {
            guesses[REPEATED] = Some(uv(like));
            guesses[REPEATED_ON] = earlier.map(|earlier| moved(uv(like), uv(earlier), uv(like)));
            let near_like = near.and_then(|w| self.repeats.wedge(w as usize)[0]);
            guesses[REPEATED_ALONG] = near_like.map(|near_like| moved(uv(like), uv(near_like), beside));
        }
        let own = &self.wedges_of[corners.vertices[corners.next] as usize];
        guesses[ELSEWHERE] = own.last().map(|&w| uv(w as usize));
        if let (1, [Some(from), Some(to), _]) = (corners.next, corners.across) {
            let [from, to] = [from, to].map(|w| uv(w as usize));
            let [du, dv] = [to[0] - from[0], to[1] - from[1]];
            let turned = [rounded(-f64::from(dv) * ratio), rounded(f64::from(du) / ratio)];
            let [u, v] = uv(corners.wedges[0] as usize);
            let edges = [[du, dv], [-du, -dv], turned, turned.map(|x| -x)];
            guesses[FIRST_SEAM..FACING].copy_from_slice(&edges.map(|[du, dv]| Some([u + du, v + dv])));
        }
        guesses
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

    /// Two texels a unit along x and three against y.
    fn map([x, y, _]: [i32; 3]) -> Uv {
        [20 + 2 * x, 99 - 3 * y]
    }

    /// Of a square in the plane of x and y the first face, 0 1 2, as [`map`] says; the fourth corner, 3, has a wedge of
    /// somewhere else.
    const SQUARE: [[i32; 3]; 4] = [[0, 0, 5], [8, 0, 5], [0, 8, 5], [8, 8, 5]];
    const ELSE: Uv = [77, 7];

    /// What a walk guesses that stands there; `set` may change it.
    fn guesses(
        corners: &Corners,
        near: Option<u32>,
        uv_ratio: f64,
        set: impl FnOnce(&mut Walk<'_, NullCoder>),
    ) -> [Option<Uv>; GUESSES] {
        let kinds = Kinds { uv_bits: 8, ..Kinds::default() };
        let mut coder = NullCoder;
        let format = BaseFormat { bits: 8, kinds, materials: 1, uv_ratio };
        let mut walk = Walk::new(&mut coder, format, u64::MAX, true);
        walk.mesh.positions = SQUARE.to_vec();
        for (vertex, uv) in (0..).zip([map(SQUARE[0]), map(SQUARE[1]), map(SQUARE[2]), ELSE]) {
            walk.mesh.wedges.push(Wedge { vertex, attributes: Attributes { uv, ..Attributes::default() } });
            walk.wedges_of.push(vec![vertex]);
        }
        walk.mesh.faces = vec![Face { wedges: [0, 1, 2], material: 0 }];
        set(&mut walk);
        walk.guesses_at_uv(corners, near)
    }

    /// Where guesses are, in order.
    fn there(guesses: &[Option<Uv>]) -> Vec<usize> {
        guesses.iter().enumerate().filter(|(_, guess)| guess.is_some()).map(|(k, _)| k).collect()
    }

    /// The face across the square's diagonal, at its corner `next`, with these wedges.
    fn across(next: usize, wedges: [u32; 3]) -> Corners {
        let across = [Some(2), Some(1), None];
        Corners { gate: Some(Gate { face: 0, k: 1 }), across, vertices: [2, 1, 3], wedges, next }
    }

    #[test]
    fn a_chart_is_guessed_to_go_on_across_a_gate_whose_wedges_are_shared() {
        let chart = guesses(&across(2, [2, 1, 0]), Some(1), 1.0, |_| ());
        assert_eq!(there(&chart), [BESIDE, CHART, ELSEWHERE]);
        assert_eq!(
            [BESIDE, CHART, ELSEWHERE].map(|k| chart[k].unwrap()),
            [map(SQUARE[1]), map(SQUARE[3]), ELSE]
        );
    }

    #[test]
    fn beyond_a_seam_and_at_a_seed_the_third_corner_is_guessed_to_either_side() {
        // A right angle at 3 with sides of 8: the other two are 8√2 apart, the middle between is the third's foot.
        let seam = |ratio| guesses(&across(2, [2, 3, 0]), Some(3), ratio, |_| ());
        let [from, to] = [map(SQUARE[2]), ELSE];
        let (middle, half) = ([0, 1].map(|k| from[k] + to[k]), [0, 1].map(|k| to[k] - from[k]));
        let side = |sign: i32| {
            let doubled = [middle[0] - sign * half[1], middle[1] + sign * half[0]];
            Some(doubled.map(|x| (x + 1).div_euclid(2)))
        };
        assert_eq!(seam(1.0)[FIRST_SIMILAR..REPEATED], [side(1), side(-1)]);
        assert_eq!(there(&seam(1.0)), [BESIDE, FIRST_SIMILAR, FIRST_SIMILAR + 1, ELSEWHERE]);
        assert_ne!(seam(2.0)[FIRST_SIMILAR], side(1), "a cell's shape counts");
        let seed = Corners { gate: None, across: [None; 3], ..across(2, [2, 3, 0]) };
        assert_eq!(guesses(&seed, Some(3), 1.0, |_| ()), seam(1.0));
        // Corners before the third have none.
        let second = Corners { next: 1, ..seed };
        assert_eq!(there(&guesses(&second, Some(3), 1.0, |_| ())), [BESIDE, ELSEWHERE]);
    }

    #[test]
    fn across_a_seam_the_edge_is_guessed_forwards_backwards_and_turned() {
        // At the second corner; the first has the wedge that is somewhere else. The edge runs from 2 to 1.
        let [du, dv] = [16, 24];
        let seam = guesses(&across(1, [3, 0, 0]), Some(3), 2.0, |_| ());
        let edges = [[du, dv], [-du, -dv], [-dv * 2, du / 2], [dv * 2, -du / 2]];
        assert_eq!(seam[FIRST_SEAM..FACING], edges.map(|[x, y]| Some([ELSE[0] + x, ELSE[1] + y])));
        assert_eq!(there(&seam), [BESIDE, ELSEWHERE, FIRST_SEAM, 9, 10, 11]);
        assert_eq!(seam[ELSEWHERE], Some(map(SQUARE[1])));
        // At the first nothing of it is known.
        assert_eq!(there(&guesses(&across(0, [0; 3]), Some(2), 2.0, |_| ())), [BESIDE, ELSEWHERE]);
    }

    #[test]
    fn a_face_that_looks_as_one_before_did_is_guessed_to_be_on_its_chart() {
        let corners = Corners { gate: None, across: [None; 3], ..across(0, [0; 3]) };
        let facing = |places: [[i32; 3]; 3]| {
            let set = |walk: &mut Walk<'_, NullCoder>| {
                walk.uv_guesses.follow(places.map(|p| p.map(f64::from)), [0, 1, 2]);
            };
            let [first, second, third] =
                [0, 1, 2].map(|next| guesses(&Corners { next, ..corners }, None, 1.0, set)[FACING]);
            [first, second, third]
        };
        // The face 2 1 3 looks along z, as does 0 1 2.
        let [a, b, c, d] = SQUARE;
        assert_eq!(facing([a, b, c]), [c, b, d].map(|p| Some(map(p))));
        assert_eq!(facing([a, c, b]), [None; 3]);
        // Near nothing there is the corner of the map.
        assert_eq!(guesses(&corners, None, 1.0, |_| ())[BESIDE], Some([0; 2]));
    }

    #[test]
    fn six_ways_to_look_are_told_apart_by_the_largest_part_of_the_normal() {
        let [x, y, z] = [[9.0, 1.0, 2.0], [2.0, 9.0, 1.0], [1.0, 2.0, 9.0]];
        let o = [0.0; 3];
        // A normal is near the axis that is in neither edge.
        let ways = [[o, y, z], [o, z, y], [o, z, x], [o, x, z], [o, x, y], [o, y, x]];
        assert_eq!(ways.map(facing), [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn a_part_like_one_before_is_guessed_to_be_mapped_as_that_one_was() {
        let corners = Corners { vertices: [3, 3, 3], ..Corners::default() };
        // Parts of one wedge and then another, the third's second to come.
        let uvs = [[10, 10], [12, 17], [40, 20], [43, 28], [70, 90]];
        let guesses = |wedges: usize, begins: &[usize], near: Option<u32>| {
            guesses(&corners, near, 1.0, |walk| {
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
        // The second part's second wedge: as the first's, and moved as the one near by was.
        let second = guesses(3, &[0, 2], Some(2));
        assert_eq!(there(&second), [BESIDE, REPEATED, REPEATED_ALONG]);
        assert_eq!(
            [BESIDE, REPEATED, REPEATED_ALONG].map(|k| second[k].unwrap()),
            [[40, 20], [12, 17], [42, 27]]
        );
        // The third's: as the second's, as far on from it as that was from the first's, and moved.
        let third = guesses(5, &[0, 2, 4], Some(4));
        let kinds = [REPEATED, REPEATED_ON, REPEATED_ALONG];
        assert_eq!(kinds.map(|k| third[k].unwrap()), [[43, 28], [74, 39], [73, 98]]);
        // With nothing near by there is nothing to move along with.
        assert_eq!(there(&guesses(5, &[0, 2, 4], None)), [BESIDE, REPEATED, REPEATED_ON]);
        // The first part has none before.
        assert_eq!(there(&guesses(1, &[0], Some(0))), [BESIDE]);
    }
}
