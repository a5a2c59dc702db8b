//! One vertex split: which faces go to the new vertex, which faces appear, position, wedges.

use crate::codec::chunk_coder::ChunkCoder;
use crate::codec::fan::Fan;
use crate::codec::local::Local;
use crate::codec::model::{
    CUT, EXTRA_IN_RING, EXTRAS, LABEL, LONG_RUN, MAX_VALENCE, MIX_START, RUN_GAP, RUN_LENGTH, RUN_START,
    SINGLE_RUN,
};
use crate::codec::moves::Whose;
use crate::codec::plan::Born;
use crate::codec::position::Roles;
use crate::codec::scratch::{Added, Cut, RingVertex, Scratch, Split};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::{index, integer, tree, tree_contexts};
use crate::error::DecodeError;
use crate::mesh::vec3::{Vec3, add, cross, dot, scale, sub};
use crate::numbers::{class, id32, real, truncated};

/// Most new faces of one split beyond the usual two.
const MAX_EXTRAS: u32 = 1 << 16;

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes the split of `t`, whose star is the one looked at last; returns the new vertex.
    pub(crate) fn split(&mut self, t: u32) -> Result<u32, DecodeError> {
        let born = self.guide.as_mut().map_or_else(Vec::new, |g| g.begin_split(t));
        let mut split = std::mem::take(&mut self.scratch.split);
        split.t = t;
        split.fan.sort(&self.scratch.star);
        self.labels(&mut split)?;
        find_cuts(&mut split);
        self.faces(&mut split, born)?;
        self.grow(&mut split);

        let u = split.u;
        let actual = self.guide.as_ref().map(|g| (g.source.place)(g.new_vertex()));
        let shift = self.shift(Whose::New, self.resolution.shift, actual.map_or(0, |a| a.shift));
        let end = |i: usize| split.added.get(i).map(|a| a.x);
        let roles = Roles { target: t, ends: [end(0), end(1)] };
        let mut star = std::mem::take(&mut self.scratch.star);
        self.local.star(u, &mut star);
        self.local.vertices[u as usize].shift = shift;
        let position = self.position(u, &star, roles, shift, actual.map(|a| a.cell))?;
        self.local.place_vertex(u, &star, position);
        self.scratch.star = star;
        self.wedges(&split)?;
        self.coder.check()?;
        self.scratch.split = split;
        Ok(u)
    }

    /// Which spokes move to the new vertex.
    fn labels(&mut self, split: &mut Split) -> Result<(), DecodeError> {
        let (fan, moves) = (&split.fan, &mut split.moves);
        let n = fan.spokes.len();
        let guide = self.guide.as_ref();
        let wanted: Option<Vec<bool>> = guide.map(|g| fan.spokes.iter().map(|s| g.moves(s.face)).collect());
        moves.clear();
        moves.resize(n, false);
        if fan.segments.len() == 1 {
            let closed = fan.segments[0].closed;
            let run = wanted.as_ref().map(|w| single_run(w, closed));
            if self.coder.bit(SINGLE_RUN + usize::from(closed), run.as_ref().is_some_and(Option::is_some)) {
                let (start, length) = run.flatten().unwrap_or((0, 0));
                let length = code_length(self.coder, n, closed, length)?;
                let starts = match length {
                    0 => 0,
                    _ if closed && length == n => 1,
                    _ if closed => n,
                    _ => n - length + 1,
                };
                let mut at = 0;
                if starts > 1 {
                    rank_starts(&self.local, fan, split.t, length, starts, &mut self.scratch);
                    at = code_start(self.coder, &self.scratch.scores, n, start)?;
                }
                // A run of a closed star may reach over the end of the list.
                let (over, end) = ((at + length).saturating_sub(n), (at + length).min(n));
                moves[at..end].fill(true);
                moves[..over].fill(true);
                return Ok(());
            }
        }
        let mut previous = false;
        for (i, label) in moves.iter_mut().enumerate() {
            let want = wanted.as_ref().is_some_and(|w| w[i]);
            previous = self.coder.bit(LABEL + usize::from(previous), want);
            *label = previous;
        }
        Ok(())
    }

    /// The faces that the split adds.
    fn faces(&mut self, split: &mut Split, mut born: Vec<Born>) -> Result<(), DecodeError> {
        let Split { t, fan, cuts, added, .. } = split;
        added.clear();
        for (number, cut) in cuts.iter().enumerate() {
            let found = born.iter().position(|b| b.x == cut.x && b.left == cut.left);
            let context = usize::from(cut.stays.is_some()) * 2 + usize::from(cut.left);
            if self.coder.bit(CUT + context, found.is_some()) {
                let face = found.map(|i| born.remove(i).face);
                added.push(Added { x: cut.x, left: cut.left, cut: Some(number), local: 0, face });
            }
        }
        let extras = integer(self.coder, EXTRAS, id32(born.len()));
        if extras > MAX_EXTRAS {
            return Err(DecodeError::new("chunk", format!("a split adds {extras} faces")));
        }
        let ring = if extras > 0 { fan.ring() } else { Vec::new() };
        for i in 0..extras as usize {
            let want = born.get(i);
            let place = want.and_then(|w| ring.iter().position(|&v| v == w.x));
            let x = if !ring.is_empty() && self.coder.bit(EXTRA_IN_RING, place.is_some()) {
                ring[index(self.coder, ring.len(), place.unwrap_or(0), "chunk: ring vertex")?]
            } else {
                let want = want.map_or(0, |w| w.x as usize);
                id32(index(self.coder, self.local.vertices.len(), want, "chunk: vertex")?)
            };
            if x == *t {
                return Err(DecodeError::new("chunk", "a face uses a vertex twice"));
            }
            let left = self.coder.raw(1, u32::from(want.is_some_and(|w| w.left))) == 1;
            added.push(Added { x, left, cut: None, local: 0, face: want.map(|w| w.face) });
            self.coder.check()?;
        }
        Ok(())
    }

    /// Makes the new vertex and its faces. Until its place is known, it is where the old one is.
    fn grow(&mut self, split: &mut Split) {
        let (local, t) = (&mut self.local, split.t);
        let u = local.add_vertex(local.position(t), Some(t), 0);
        split.u = u;
        if let Some(guide) = &mut self.guide {
            let name = guide.new_vertex();
            guide.names.vertex(name);
        }
        split.targets.clear();
        for (spoke, moves) in split.fan.spokes.iter().zip(&split.moves) {
            split.targets.push(local.spoke_wedges(spoke)[0]);
            if *moves {
                local.move_corner(spoke, u);
            }
        }
        for face in &mut split.added {
            face.local = local.add_face(if face.left { [t, face.x, u] } else { [u, face.x, t] });
            if let (Some(guide), Some(name)) = (&mut self.guide, face.face) {
                guide.names.faces.push(name);
            }
        }
    }
}

fn code_length<C: Coder>(coder: &mut C, n: usize, closed: bool, length: usize) -> Result<usize, DecodeError> {
    let length = if n <= 15 {
        let at = RUN_LENGTH + (n.min(MAX_VALENCE) * 2 + usize::from(closed)) * tree_contexts(4);
        tree(coder, at, 4, id32(length))
    } else {
        integer(coder, LONG_RUN, id32(length))
    } as usize;
    if length > n {
        return Err(DecodeError::new("chunk", "more faces move than there are"));
    }
    Ok(length)
}

/// Which of the ranked starts it is: "this one?" down the list, by how much worse the next one is.
fn code_start<C: Coder>(
    coder: &mut C,
    scores: &[(f64, usize)],
    n: usize,
    start: usize,
) -> Result<usize, DecodeError> {
    let want = scores.iter().position(|s| s.1 == start).unwrap_or(0);
    if scores.len() > 64 {
        return Ok(scores[index(coder, scores.len(), want, "chunk: start of a run")?].1);
    }
    if let Some(rank) = coder.whole(RUN_START, 6, id32(want)) {
        let start = scores.get(rank as usize);
        return start.map(|s| s.1).ok_or_else(|| DecodeError::new("chunk", "a run starts nowhere"));
    }
    let last = scores.len() - 1;
    for rank in 0..last {
        let gap = class(truncated((scores[rank + 1].0 - scores[rank].0) * 4.0), 16);
        let contexts = [RUN_START + n.min(MAX_VALENCE) * 8 + rank.min(7), RUN_GAP + rank.min(7) * 16 + gap];
        if coder.mix(contexts, MIX_START, rank == want) {
            return Ok(scores[rank].1);
        }
    }
    Ok(scores[last].1)
}

/// The only run of moving spokes, as (start, length), where there is at most one.
fn single_run(moves: &[bool], closed: bool) -> Option<(usize, usize)> {
    let n = moves.len();
    let length = moves.iter().filter(|&&m| m).count();
    if length == 0 || length == n {
        return Some((0, length));
    }
    let starts: Vec<usize> = (0..n)
        .filter(|&i| moves[i] && if i == 0 { !(closed && moves[n - 1]) } else { !moves[i - 1] })
        .collect();
    (starts.len() == 1).then(|| (starts[0], length))
}

/// Starts of a run of `length` in order of plausibility, as (score, start), lowest score first.
///
/// The score is linear in what was seen to tell starts apart, with weights from a logistic regression
/// over the splits of several models (bunny left out), so differences are log odds.
fn rank_starts(local: &Local<'_>, fan: &Fan, t: u32, length: usize, starts: usize, scratch: &mut Scratch) {
    let Scratch { ring, scores, .. } = scratch;
    let whole = look_around(local, fan, t, ring);
    if fan.segments[0].closed {
        // Runs may reach over the end of the list.
        ring.extend_from_within(..length);
    }
    scores.clear();
    // Sum over the ring vertices inside the run; exact, since coordinates are integers.
    let mut inside = ring[1..length].iter().fold([0.0; 3], |sum, v| add(sum, v.at));
    for (start, run) in ring.windows(length + 1).enumerate().take(starts) {
        let (left, right) = (&run[0], &run[length]);
        let middle = add(scale(add(left.at, right.at), 0.5), inside);
        let area = run[1..length].iter().fold(left.area, |sum, v| sum + v.area);
        let score = VALENCE * (left.valence + right.valence)
            + SHARE * area / whole.area
            + OUTWARD * dot(middle, whole.outward) / real(length)
            + STRAIGHT * dot(left.at, right.at) / (left.length * right.length).max(1e-9)
            + LENGTH * (left.length + right.length) * whole.inverse
            + INSIDE * (left.interior + right.interior);
        scores.push((-score, start));
        if length > 1 {
            inside = sub(add(inside, right.at), run[1].at);
        }
    }
    scores.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
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
fn look_around(local: &Local<'_>, fan: &Fan, t: u32, ring: &mut Vec<RingVertex>) -> Whole {
    let n = fan.spokes.len();
    let center = local.position(t);
    let mut mean = [0.0; 3];
    let mut square = 0.0;
    ring.clear();
    let mut see = |v: u32, area: f64| {
        let vertex = &local.vertices[v as usize];
        let at = sub(vertex.position, center);
        let size = dot(at, at);
        mean = add(mean, at);
        square += size;
        let (valence, interior) = (real(local.valence(v)), f64::from(u8::from(vertex.interior)));
        ring.push(RingVertex { at, length: size.sqrt(), valence, interior, area });
    };
    for spoke in &fan.spokes {
        see(spoke.a, local.face_area(spoke.face));
    }
    if !fan.segments[0].closed {
        see(fan.spokes[n - 1].b, 0.0);
    }
    let count = ring.len();
    let inverse = 1.0 / (square / real(count)).sqrt().max(1e-9);
    mean = scale(mean, 1.0 / real(count));
    let mut normal = [0.0; 3];
    let mut area = 0.0;
    for i in 0..n {
        let next = if i + 1 < count { i + 1 } else { 0 };
        normal = add(normal, cross(ring[i].at, ring[next].at));
        area += ring[i].area;
    }
    let size = dot(normal, normal);
    if size > 0.0 {
        // What is left of the mean lies in the tangent plane: the new vertex is on that side.
        mean = sub(mean, scale(normal, dot(mean, normal) / size));
    }
    Whole { area: area.max(1e-9), outward: scale(mean, inverse * inverse), inverse }
}

/// Log odds per: face at either end of the run, share of the star's area in it, how far its middle lies
/// to the star's heavy side (in mean radii squared), cosine between its ends, their distance (in mean
/// radii), end that is interior.
const VALENCE: f64 = -0.096;
const SHARE: f64 = 2.6;
const OUTWARD: f64 = 5.73;
const STRAIGHT: f64 = -0.513;
const LENGTH: f64 = -1.17;
const INSIDE: f64 = 0.65;

/// Where new faces are expected: around each run of moving spokes.
fn find_cuts(split: &mut Split) {
    let Split { fan, moves, cuts, .. } = split;
    cuts.clear();
    for segment in &fan.segments {
        let (start, end) = (segment.start, segment.end);
        for i in (start..end).filter(|&i| moves[i]) {
            let before = if i > start { Some(i - 1) } else { segment.closed.then_some(end - 1) };
            let after = if i + 1 < end { Some(i + 1) } else { segment.closed.then_some(start) };
            if before.is_none_or(|j| !moves[j]) {
                cuts.push(Cut { x: fan.spokes[i].a, left: true, stays: before, moves: i });
            }
            if after.is_none_or(|j| !moves[j]) {
                cuts.push(Cut { x: fan.spokes[i].b, left: false, stays: after, moves: i });
            }
        }
    }
}
