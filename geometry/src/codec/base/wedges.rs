//! A corner's wedge: one of its vertex's, or a new one and its attributes.

use crate::codec::attributes::{Expected, UV, code_attributes};
use crate::codec::base::guess::{Chart, NEWEST, Newest, Trust, rounded};
use crate::codec::base::walk::{Corners, Walk};
use crate::codec::model::{BASE_CHOICE, BASE_NEW_WEDGE, BASE_SAME_WEDGE, MOST_CHOICES, TOLD};
use crate::codec::position::axes;
use crate::codec::residual::{Recent, UNKNOWN};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::index;
use crate::error::DecodeError;
use crate::mesh::vec3::{Vec3, cross, sub};
use crate::mesh::{Attributes, Kinds, Wedge, corner};
use crate::numbers::id32;

/// Guesses at a texture coordinate: that near by; along the chart, or beside it to either side; that of a part
/// before, this moved on as from the one before that, and moved along with what is near by; that which the vertex
/// has elsewhere; the edge across a seam, forwards and backwards, and turned to either side; along the last face
/// that looked the same way; the values that came last.
const GUESSES: usize = FIRST_NEWEST + NEWEST;
const BESIDE: usize = 0;
const CHART: usize = 1;
const FIRST_SIMILAR: usize = 2;
const REPEATED: usize = 4;
const REPEATED_ON: usize = 5;
const REPEATED_ALONG: usize = 6;
const ELSEWHERE: usize = 7;
const FIRST_SEAM: usize = 8;
const FACING: usize = 12;
const FIRST_NEWEST: usize = 13;

/// Which guesses at a texture coordinate to trust, by axis.
pub(super) struct UvGuesses {
    trust: [Trust<GUESSES>; 2],
    newest: [Newest; 2],
    /// By the way a face looks, the wedges of the last that looked that way.
    facing: [Option<[u32; 3]>; 6],
    recent: Recent,
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
fn facing(at: [Vec3; 3]) -> usize {
    let normal = cross(sub(at[1], at[0]), sub(at[2], at[0]));
    let [_, _, axis] = axes(normal);
    axis * 2 + usize::from(normal[axis] < 0.0)
}

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
            (Some(like), _) => Some((group_of(like), 3 + i)),
            (None, Some(before)) => Some((group_of(before as usize), i)),
            _ => None,
        };
        let expected = Expected {
            uv: [0; 2],
            uv_size: None,
            near: near.map(|w| self.mesh.wedges[w as usize].attributes),
            normal: [0.0; 3],
            first: self.wedges_of[vertex as usize].is_empty(),
            group,
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
