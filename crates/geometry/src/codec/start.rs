//! The start of the run of faces that moves to a new vertex: possible starts, ranked by a score.
//!
//! The score is linear in features of the run, with weights from a logistic regression over the splits of several
//! models (without the bunny), so differences are log odds.

use crate::codec::fan::Fan;
use crate::codec::local::Local;
use crate::codec::model::{MAX_VALENCE, MIX_START, RUN_GAP, RUN_START};
use crate::codec::ring::{AREA, INTERIOR, LENGTH, Ring, SMALL_CAPACITY, VALENCE, X, Y, Z};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::index;
use crate::error::DecodeError;
use crate::mesh::vec3::{Vec3, add, cross, dot, scale, sub};
use crate::numbers::{class, id32, real, truncated};

/// Weights, as log odds per: face at either end of the run, share of the star's area in it, distance of its middle
/// towards the star's heavy side (in squared mean radii), cosine between its ends, their distance (in mean radii),
/// interior end.
const PER_FACE: f64 = -0.096;
const PER_SHARE: f64 = 2.6;
const OUTWARD: f64 = 5.73;
const STRAIGHT: f64 = -0.513;
const PER_LENGTH: f64 = -1.17;
const INSIDE: f64 = 0.65;

/// Starts scored in parallel.
const LANES: usize = 8;

/// Length of each list of a ring: twice the neighbours, one more, and padding for the last lanes.
fn list_length(fan: &Fan) -> usize {
    2 * fan.star_faces.len() + 1 + LANES
}

/// The possible starts of a run, ranked.
#[derive(Default)]
pub(crate) struct Starts {
    star: StarMeasures,
    count: usize,
    /// Lower is more plausible; padded to star lanes.
    scores: Vec<f64>,
    /// Integers that compare like the scores; the maximum for padding.
    keys: Vec<i64>,
    /// Starts by score, then by number.
    order: Vec<usize>,
}

impl Starts {
    /// Measures the ring of `t`, whose fan is one segment. This needs nothing that is coded of the run, so it does
    /// not wait for decoding.
    pub(crate) fn measure(&mut self, local: &Local<'_>, fan: &Fan, t: u32, ring: &mut Ring) {
        let list_length = list_length(fan);
        self.star = if list_length <= SMALL_CAPACITY {
            measure_star(local, fan, t, &mut ring.few)
        } else {
            for list in &mut ring.many {
                list.resize(list.len().max(list_length), 0.0);
            }
            measure_star(local, fan, t, &mut ring.many)
        };
    }

    /// Scores the first `count` starts of a run of `length`, after [`Self::measure`].
    pub(crate) fn score(&mut self, fan: &Fan, length: usize, count: usize, ring: &Ring) {
        if list_length(fan) <= SMALL_CAPACITY {
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
        // Each lane scores one start.
        for first in (0..count).step_by(LANES) {
            let scores = score(ring, &self.star, length, first);
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

    /// Codes the start in unary down the ranked list, with contexts by the score difference to the next. `n` is the
    /// number of faces around the vertex.
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
        if let Some(rank) = coder.integer(RUN_START, 6, id32(want)) {
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

/// Indices sorted by key, stable.
#[inline]
fn order<const N: usize>(keys: &[i64; N]) -> [usize; N] {
    // Rank of each by counting smaller keys. Sums of comparisons are branch-free, and the order of a few scores is
    // unpredictable.
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

/// Negative scores of the starts from `first` on; lanes past the last start are meaningless.
#[inline(always)]
fn score<L: AsRef<[f64]>>(ring: &[L; 7], star: &StarMeasures, length: usize, first: usize) -> [f64; LANES] {
    let at = |list: usize, offset: usize| -> &[f64; LANES] {
        const ZEROS: &[f64; LANES] = &[0.0; LANES];
        ring[list].as_ref().get(first + offset..).and_then(<[f64]>::first_chunk).unwrap_or(ZEROS)
    };
    // Sums over the ring vertices inside the run; exact for positions, which are integers.
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
    let (out, count) = (star.outward, real(length));
    let mut scores = [0.0; LANES];
    for i in 0..LANES {
        let middle =
            [(x0[i] + x1[i]) * 0.5 + x[i], (y0[i] + y1[i]) * 0.5 + y[i], (z0[i] + z1[i]) * 0.5 + z[i]];
        let outward = dot(middle, out);
        let across = x0[i] * x1[i] + y0[i] * y1[i] + z0[i] * z1[i];
        let product = length0[i] * length1[i];
        // As `f64::max`, without its NaN handling.
        let product = if product > 1e-9 { product } else { 1e-9 };
        let score = PER_FACE * (valence0[i] + valence1[i])
            + PER_SHARE * area[i] / star.area
            + OUTWARD * outward / count
            + STRAIGHT * across / product
            + PER_LENGTH * (length0[i] + length1[i]) * star.inverse
            + INSIDE * (interior0[i] + interior1[i]);
        scores[i] = -score;
    }
    scores
}

/// An integer that compares as [`f64::total_cmp`] does.
fn total_order(x: f64) -> i64 {
    let bits = x.to_bits().cast_signed();
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}

/// Measures of a star, shared by all starts.
#[derive(Default)]
struct StarMeasures {
    /// Sum of the face areas.
    area: f64,
    /// The ring's mean in the tangent plane, over the mean square radius.
    outward: Vec3,
    /// Reciprocal of the root mean square radius.
    inverse: f64,
}

/// Fills the ring around `t` in order, and for a closed star twice, since runs may wrap around.
#[inline(always)]
fn measure_star<L: AsMut<[f64]>>(local: &Local<'_>, fan: &Fan, t: u32, ring: &mut [L; 7]) -> StarMeasures {
    let n = fan.star_faces.len();
    let center = local.position(t);
    let (mut mean, mut square, mut area) = ([0.0; 3], 0.0, 0.0);
    // Cross products of consecutive neighbours.
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
        // For the first, `before` is zero and adds nothing.
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
        // The rest of the mean lies in the tangent plane and points towards the new vertex.
        mean = sub(mean, scale(normal, dot(mean, normal) / size));
    }
    StarMeasures { area: area.max(1e-9), outward: scale(mean, inverse * inverse), inverse }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_order_equals_a_stable_sort() {
        let mut random = crate::random::Random::new(11);
        for _ in 0..4000 {
            // Few distinct values, to test ties, and both zeros.
            let scores: [f64; 2 * LANES] =
                std::array::from_fn(|_| [-1.5, -0.0, 0.0, 2.0, f64::INFINITY][random.below(5)]);
            let mut expected: Vec<usize> = (0..2 * LANES).collect();
            expected.sort_by(|&a, &b| scores[a].total_cmp(&scores[b]).then(a.cmp(&b)));
            assert_eq!(order(&scores.map(total_order)).to_vec(), expected);
        }
    }
}
