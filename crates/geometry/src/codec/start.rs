//! Where the run of faces begins that goes to a new vertex: the starts that there may be, ranked.
//!
//! The score is linear in what was seen to tell starts apart, with weights from a logistic regression
//! over the splits of several models (bunny left out), so differences are log odds.

use crate::codec::fan::Fan;
use crate::codec::local::Local;
use crate::codec::model::{MAX_VALENCE, MIX_START, RUN_GAP, RUN_START};
use crate::codec::ring::{AREA, INTERIOR, LENGTH, Ring, SMALL_ROOM, VALENCE, X, Y, Z};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::index;
use crate::error::DecodeError;
use crate::mesh::vec3::{Vec3, add, cross, dot, scale, sub};
use crate::numbers::{class, id32, real, truncated};

/// Log odds per: face at either end of the run, share of the star's area in it, how far its middle lies
/// to the star's heavy side (in mean radii squared), cosine between its ends, their distance (in mean
/// radii), end that is interior.
const PER_FACE: f64 = -0.096;
const PER_SHARE: f64 = 2.6;
const OUTWARD: f64 = 5.73;
const STRAIGHT: f64 = -0.513;
const PER_LENGTH: f64 = -1.17;
const INSIDE: f64 = 0.65;

/// Starts that are scored together.
const LANES: usize = 8;

/// Room that each list of a ring needs: for all of it twice, one more, and what the last lanes read of nothing.
fn room(fan: &Fan) -> usize {
    2 * fan.star_faces.len() + 1 + LANES
}

/// The starts that a run may have, in order.
#[derive(Default)]
pub(crate) struct Starts {
    whole: Whole,
    count: usize,
    /// The more plausible, the lower; whole lanes, of which what is behind the last start means nothing.
    scores: Vec<f64>,
    /// Numbers that compare as the scores; the highest behind the last start.
    keys: Vec<i64>,
    /// The starts by score, and by number where scores are equal.
    order: Vec<usize>,
}

impl Starts {
    /// Looks around `t`, whose fan is one segment. That needs nothing of what is coded of the run, and does not wait
    /// for it.
    pub(crate) fn look(&mut self, local: &Local<'_>, fan: &Fan, t: u32, ring: &mut Ring) {
        let room = room(fan);
        self.whole = if room <= SMALL_ROOM {
            look_around(local, fan, t, &mut ring.few)
        } else {
            for list in &mut ring.many {
                list.resize(list.len().max(room), 0.0);
            }
            look_around(local, fan, t, &mut ring.many)
        };
    }

    /// Scores the first `count` starts of a run of `length`, of which [`Self::look`] has seen the fan and the ring.
    pub(crate) fn score(&mut self, fan: &Fan, length: usize, count: usize, ring: &Ring) {
        if room(fan) <= SMALL_ROOM {
            self.score_in(length, count, &ring.few);
        } else {
            self.score_in(length, count, &ring.many);
        }
    }

    #[inline(always)]
    fn score_in<L: AsRef<[f64]>>(&mut self, length: usize, count: usize, ring: &[L; 7]) {
        self.count = count;
        self.scores.clear();
        self.keys.clear();
        // Starts are scored some at a time: each lane of a loop is a start.
        for first in (0..count).step_by(LANES) {
            let scores = score(ring, &self.whole, length, first);
            self.scores.extend_from_slice(&scores);
            let number = |i: usize| if first + i < count { total_order(scores[i]) } else { i64::MAX };
            self.keys.extend_from_slice(&std::array::from_fn::<i64, LANES, _>(number));
        }
        self.order.clear();
        if let Some(keys) = self.keys.as_array::<LANES>() {
            self.order.extend_from_slice(&order(keys));
        } else if let Some(keys) = self.keys.as_array::<{ 2 * LANES }>() {
            self.order.extend_from_slice(&order(keys));
        } else {
            self.order.extend(0..count);
            self.order.sort_unstable_by_key(|&i| (self.keys[i], i));
        }
    }

    /// Which of the starts it is: "this one?" down the list of the most plausible first, by how much worse the next one
    /// is. `n` faces are around the vertex.
    pub(crate) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        n: usize,
        start: Option<usize>,
    ) -> Result<usize, DecodeError> {
        let Self { count, ref scores, .. } = *self;
        let order = &self.order[..count];
        let want = start.and_then(|start| order.iter().position(|&i| i == start)).unwrap_or(0);
        if count > 64 {
            return Ok(order[index(coder, count, want, "chunk: start of a run")?]);
        }
        if let Some(rank) = coder.whole(RUN_START, 6, id32(want)) {
            let start = order.get(rank as usize);
            return start.copied().ok_or_else(|| DecodeError::new("chunk", "a run starts nowhere"));
        }
        for (rank, pair) in order.windows(2).enumerate() {
            let gap = class(truncated((scores[pair[1]] - scores[pair[0]]) * 4.0), 16);
            let contexts =
                [RUN_START + n.min(MAX_VALENCE) * 8 + rank.min(7), RUN_GAP + rank.min(7) * 16 + gap];
            if coder.mix(contexts, MIX_START, rank == want) {
                return Ok(pair[0]);
            }
        }
        Ok(order[count - 1])
    }
}

/// The places of keys, the least first, and of equal ones the first.
#[inline]
fn order<const N: usize>(keys: &[i64; N]) -> [usize; N] {
    // How many come before each. Sums of comparisons have no branch: of half a dozen scores in any order none can be
    // foreseen.
    let mut ranks = [0_usize; N];
    for i in 1..N {
        for j in 0..i {
            let before = usize::from(keys[j] <= keys[i]);
            ranks[i] += before;
            ranks[j] += 1 - before;
        }
    }
    let mut order = [0; N];
    for (i, rank) in ranks.into_iter().enumerate() {
        order[rank % N] = i;
    }
    order
}

/// The negative scores of so many starts from `first` on; those of starts that there are not mean nothing.
#[inline(always)]
fn score<L: AsRef<[f64]>>(ring: &[L; 7], whole: &Whole, length: usize, first: usize) -> [f64; LANES] {
    let at = |list: usize, offset: usize| -> &[f64; LANES] {
        const NOTHING: &[f64; LANES] = &[0.0; LANES];
        ring[list].as_ref().get(first + offset..).and_then(<[f64]>::first_chunk).unwrap_or(NOTHING)
    };
    // Sums over the ring vertices inside the run; exact of places, since coordinates are integers.
    let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let mut area = *at(AREA, 0);
    for offset in 1..length {
        let (dx, dy, dz, part) = (at(X, offset), at(Y, offset), at(Z, offset), at(AREA, offset));
        for i in 0..LANES {
            x[i] += dx[i];
            y[i] += dy[i];
            z[i] += dz[i];
            area[i] += part[i];
        }
    }
    let (x0, x1, y0, y1, z0, z1) =
        (at(X, 0), at(X, length), at(Y, 0), at(Y, length), at(Z, 0), at(Z, length));
    let (length0, length1) = (at(LENGTH, 0), at(LENGTH, length));
    let (valence0, valence1) = (at(VALENCE, 0), at(VALENCE, length));
    let (interior0, interior1) = (at(INTERIOR, 0), at(INTERIOR, length));
    let (out, count) = (whole.outward, real(length));
    let mut scores = [0.0; LANES];
    for i in 0..LANES {
        let middle =
            [(x0[i] + x1[i]) * 0.5 + x[i], (y0[i] + y1[i]) * 0.5 + y[i], (z0[i] + z1[i]) * 0.5 + z[i]];
        let outward = dot(middle, out);
        let across = x0[i] * x1[i] + y0[i] * y1[i] + z0[i] * z1[i];
        let product = length0[i] * length1[i];
        // As `f64::max`, of what is a number.
        let product = if product > 1e-9 { product } else { 1e-9 };
        let score = PER_FACE * (valence0[i] + valence1[i])
            + PER_SHARE * area[i] / whole.area
            + OUTWARD * outward / count
            + STRAIGHT * across / product
            + PER_LENGTH * (length0[i] + length1[i]) * whole.inverse
            + INSIDE * (interior0[i] + interior1[i]);
        scores[i] = -score;
    }
    scores
}

/// A number that compares as [`f64::total_cmp`] does.
fn total_order(x: f64) -> i64 {
    let bits = x.to_bits().cast_signed();
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}

/// What the starts of one star share.
#[derive(Default)]
struct Whole {
    /// Sum of the areas.
    area: f64,
    /// Where the ring's mean lies in the tangent plane, over the mean square radius.
    outward: Vec3,
    /// One over the root of the mean square radius.
    inverse: f64,
}

/// The ring around `t`, in order, and of a closed star once more: runs may reach over the end of the list.
#[inline(always)]
fn look_around<L: AsMut<[f64]>>(local: &Local<'_>, fan: &Fan, t: u32, ring: &mut [L; 7]) -> Whole {
    let n = fan.star_faces.len();
    let center = local.position(t);
    let (mut mean, mut square, mut area) = ([0.0; 3], 0.0, 0.0);
    // Cross products of neighbouring places, in order.
    let (mut normal, mut first, mut before) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    let known = |v: u32| {
        let vertex = &local.vertices[v as usize];
        let at = sub(vertex.position, center);
        let size = dot(at, at);
        (at, size, f64::from(id32(vertex.valence())), f64::from(u8::from(vertex.interior)))
    };
    for (i, star_face) in fan.star_faces.iter().enumerate() {
        let (at, size, valence, interior) = known(star_face.a);
        let face = local.face_area(star_face.face);
        mean = add(mean, at);
        square += size;
        area += face;
        // The first has none before it: what is no place spans nothing.
        normal = add(normal, cross(before, at));
        before = at;
        first = if i == 0 { at } else { first };
        let [x, y, z] = at;
        for (list, value) in ring.iter_mut().zip([x, y, z, size.sqrt(), valence, interior, face]) {
            let list = list.as_mut();
            list[i] = value;
            list[i + n] = value;
        }
    }
    let mut count = n;
    if fan.segments[0].closed {
        normal = add(normal, cross(before, first));
    } else {
        let (at, size, valence, interior) = known(fan.star_faces[n - 1].b);
        mean = add(mean, at);
        square += size;
        normal = add(normal, cross(before, at));
        let [x, y, z] = at;
        for (list, value) in ring.iter_mut().zip([x, y, z, size.sqrt(), valence, interior, 0.0]) {
            list.as_mut()[n] = value;
        }
        count += 1;
    }
    let inverse = 1.0 / (square / real(count)).sqrt().max(1e-9);
    mean = scale(mean, 1.0 / real(count));
    let size = dot(normal, normal);
    if size > 0.0 {
        // What is left of the mean lies in the tangent plane: the new vertex is on that side.
        mean = sub(mean, scale(normal, dot(mean, normal) / size));
    }
    Whole { area: area.max(1e-9), outward: scale(mean, inverse * inverse), inverse }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counting_what_comes_before_is_sorting() {
        let mut random = crate::random::Random::new(11);
        for _ in 0..4000 {
            // Few values, so that some are equal; and both zeros.
            let scores: [f64; 2 * LANES] =
                std::array::from_fn(|_| [-1.5, -0.0, 0.0, 2.0, f64::INFINITY][random.below(5)]);
            let mut expected: Vec<usize> = (0..2 * LANES).collect();
            expected.sort_by(|&a, &b| scores[a].total_cmp(&scores[b]).then(a.cmp(&b)));
            assert_eq!(order(&scores.map(total_order)).to_vec(), expected);
        }
    }
}
