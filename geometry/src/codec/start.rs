//! Where the run of faces begins that goes to a new vertex: the starts that there may be, ranked.
//!
//! The score is linear in what was seen to tell starts apart, with weights from a logistic regression
//! over the splits of several models (bunny left out), so differences are log odds.

use crate::codec::fan::Fan;
use crate::codec::local::Local;
use crate::codec::model::{MAX_VALENCE, MIX_START, RUN_GAP, RUN_START};
use crate::codec::scratch::{AREA, INTERIOR, LENGTH, Ring, VALENCE, X, Y, Z};
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

/// Scores the starts of a run of `length`: (score, start), the more plausible the lower, in order of the starts.
pub(crate) fn score_starts(
    local: &Local<'_>,
    fan: &Fan,
    t: u32,
    length: usize,
    starts: usize,
    ring: &mut Ring,
    scores: &mut Vec<(f64, usize)>,
) {
    let n = fan.spokes.len();
    ring.grow(2 * n + 1 + LANES);
    let whole = look_around(local, fan, t, ring);
    if fan.segments[0].closed {
        // Runs may reach over the end of the list.
        ring.repeat(n, length);
    }
    scores.clear();
    // Starts are scored some at a time: each lane of a loop is a start.
    for first in (0..starts).step_by(LANES) {
        let lanes = score(ring, &whole, length, first);
        scores.extend(lanes.into_iter().zip(first..starts).map(|(score, start)| (-score, start)));
    }
}

/// Starts that are scored together.
const LANES: usize = 8;

/// The scores of so many starts from `first` on; those of starts that there are not mean nothing.
fn score(ring: &Ring, whole: &Whole, length: usize, first: usize) -> [f64; LANES] {
    let at = |list: usize, offset: usize| -> &[f64; LANES] {
        const NOTHING: &[f64; LANES] = &[0.0; LANES];
        ring.list(list).get(first + offset..).and_then(<[f64]>::first_chunk).unwrap_or(NOTHING)
    };
    // Sums over the ring vertices inside the run; exact of places, since coordinates are integers.
    let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    let mut area = *at(AREA, 0);
    for offset in 1..length {
        for (sum, list) in [(&mut x, X), (&mut y, Y), (&mut z, Z), (&mut area, AREA)] {
            sum.iter_mut().zip(at(list, offset)).for_each(|(sum, part)| *sum += part);
        }
    }
    let (x0, x1, y0, y1, z0, z1) =
        (at(X, 0), at(X, length), at(Y, 0), at(Y, length), at(Z, 0), at(Z, length));
    let (length0, length1) = (at(LENGTH, 0), at(LENGTH, length));
    let (valence0, valence1) = (at(VALENCE, 0), at(VALENCE, length));
    let (interior0, interior1) = (at(INTERIOR, 0), at(INTERIOR, length));
    let (out, count) = (whole.outward, real(length));
    std::array::from_fn(|i| {
        let middle =
            [(x0[i] + x1[i]) * 0.5 + x[i], (y0[i] + y1[i]) * 0.5 + y[i], (z0[i] + z1[i]) * 0.5 + z[i]];
        let outward = dot(middle, out);
        let across = x0[i] * x1[i] + y0[i] * y1[i] + z0[i] * z1[i];
        let product = length0[i] * length1[i];
        // As `f64::max`, of what is a number.
        let product = if product > 1e-9 { product } else { 1e-9 };
        PER_FACE * (valence0[i] + valence1[i])
            + PER_SHARE * area[i] / whole.area
            + OUTWARD * outward / count
            + STRAIGHT * across / product
            + PER_LENGTH * (length0[i] + length1[i]) * whole.inverse
            + INSIDE * (interior0[i] + interior1[i])
    })
}

/// Which of the starts it is: "this one?" down the list of the most plausible first, by how much worse the next one is.
pub(crate) fn code_start<C: Coder>(
    coder: &mut C,
    scores: &mut [(f64, usize)],
    keys: &mut Vec<i64>,
    n: usize,
    start: Option<usize>,
) -> Result<usize, DecodeError> {
    let many = scores.len() > 64;
    // A decoder that models seldom comes far down the list: it looks for the next one only.
    if many || start.is_some() || !C::MODELS {
        scores.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
    let want = start.and_then(|start| scores.iter().position(|s| s.1 == start)).unwrap_or(0);
    if many {
        return Ok(scores[index(coder, scores.len(), want, "chunk: start of a run")?].1);
    }
    if let Some(rank) = coder.whole(RUN_START, 6, id32(want)) {
        let start = scores.get(rank as usize);
        return start.map(|s| s.1).ok_or_else(|| DecodeError::new("chunk", "a run starts nowhere"));
    }
    keys.clear();
    keys.extend(scores.iter().map(|s| total_order(s.0)));
    let mut this = take_least(keys);
    for rank in 0..scores.len() - 1 {
        let next = take_least(keys);
        let gap = class(truncated((scores[next].0 - scores[this].0) * 4.0), 16);
        let contexts = [RUN_START + n.min(MAX_VALENCE) * 8 + rank.min(7), RUN_GAP + rank.min(7) * 16 + gap];
        if coder.mix(contexts, MIX_START, rank == want) {
            break;
        }
        this = next;
    }
    Ok(scores[this].1)
}

/// Where the least key is, the first of equal ones, which is then taken.
#[inline]
fn take_least(keys: &mut [i64]) -> usize {
    let (mut least, mut at) = (i64::MAX, 0);
    // Without a branch: of half a dozen scores in any order none can be foreseen.
    for (i, &key) in keys.iter().enumerate() {
        at = if key < least { i } else { at };
        least = least.min(key);
    }
    if let Some(key) = keys.get_mut(at) {
        *key = i64::MAX;
    }
    at
}

/// A number that compares as [`f64::total_cmp`] does.
fn total_order(x: f64) -> i64 {
    let bits = x.to_bits().cast_signed();
    bits ^ ((bits >> 63).cast_unsigned() >> 1).cast_signed()
}

/// What the starts of one star share.
struct Whole {
    /// Sum of the areas.
    area: f64,
    /// Where the ring's mean lies in the tangent plane, over the mean square radius.
    outward: Vec3,
    /// One over the root of the mean square radius.
    inverse: f64,
}

/// The ring around `t`, in order.
fn look_around(local: &Local<'_>, fan: &Fan, t: u32, ring: &mut Ring) -> Whole {
    let n = fan.spokes.len();
    let center = local.position(t);
    let mut mean = [0.0; 3];
    let mut square = 0.0;
    let mut see = |i: usize, v: u32, area: f64| {
        let vertex = &local.vertices[v as usize];
        let at = sub(vertex.position, center);
        let size = dot(at, at);
        mean = add(mean, at);
        square += size;
        let interior = f64::from(u8::from(vertex.interior));
        let [x, y, z] = at;
        ring.set(i, [x, y, z, size.sqrt(), f64::from(id32(vertex.valence())), interior, area]);
    };
    for (i, spoke) in fan.spokes.iter().enumerate() {
        see(i, spoke.a, local.face_area(spoke.face));
    }
    let mut count = n;
    if !fan.segments[0].closed {
        see(n, fan.spokes[n - 1].b, 0.0);
        count += 1;
    }
    let inverse = 1.0 / (square / real(count)).sqrt().max(1e-9);
    mean = scale(mean, 1.0 / real(count));
    let mut normal = [0.0; 3];
    let mut area = 0.0;
    for i in 0..n {
        let next = if i + 1 < count { i + 1 } else { 0 };
        normal = add(normal, cross(ring.place(i), ring.place(next)));
        area += ring.list(AREA)[i];
    }
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
    fn taking_the_least_again_and_again_is_sorting() {
        let mut random = crate::random::Random::new(11);
        for n in 1..20 {
            for _ in 0..200 {
                // Few values, so that some are equal; and both zeros.
                let value = |x: usize| [-1.5, -0.0, 0.0, 2.0, f64::INFINITY][x];
                let scores: Vec<(f64, usize)> = (0..n).map(|i| (value(random.below(5)), i)).collect();
                let mut keys: Vec<i64> = scores.iter().map(|s| total_order(s.0)).collect();
                let taken: Vec<usize> = (0..n).map(|_| take_least(&mut keys)).collect();
                let mut expected = scores;
                expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                assert_eq!(taken, expected.iter().map(|s| s.1).collect::<Vec<_>>());
            }
        }
    }
}
