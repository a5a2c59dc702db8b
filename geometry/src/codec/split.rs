//! One vertex split: which faces go to the new vertex, which faces appear, position, wedges.

use crate::codec::attributes::Kinds;
use crate::codec::fan::{Fan, Spoke};
use crate::codec::local::Local;
use crate::codec::model::{
    EXTRA_IN_RING, EXTRAS, GATE, LABEL, LONG_RUN, MAX_VALENCE, MIX_START, RUN_GAP, RUN_LENGTH, RUN_START,
    SINGLE_RUN,
};
use crate::codec::plan::{Born, Guide};
use crate::codec::position::{Roles, code_position};
use crate::codec::residual::Recent;
use crate::codec::wedges::code_wedges;
use crate::error::DecodeError;
use crate::range_coder::Coder;
use crate::symbols::{index, integer, tree, tree_contexts};
use crate::vec3::{Vec3, add, cross, dot, length as length_of, scale, sub};

/// Most new faces of one split beyond the usual two.
const MAX_EXTRAS: u32 = 1 << 16;

/// A place where a new face may appear: between a face that stays and one that goes, or at an end.
pub(crate) struct Gate {
    /// Ring vertex of the new face.
    pub(crate) x: u32,
    /// The new face is (t, x, u), else (u, x, t).
    pub(crate) left: bool,
    /// Neighbouring spokes: one that stays, one that moves.
    pub(crate) stays: Option<usize>,
    pub(crate) moves: usize,
}

/// A face that the split adds: third vertex, orientation, and the gate that it fills.
pub(crate) struct Added {
    pub(crate) x: u32,
    pub(crate) left: bool,
    pub(crate) gate: Option<usize>,
    /// Number in the region.
    pub(crate) local: u32,
    /// Builder's face, when encoding.
    pub(crate) face: Option<u32>,
}

/// What splits of one chunk share: grids, running means, scratch space.
pub(crate) struct Splitter {
    position_bits: u8,
    pub(crate) kinds: Kinds,
    pub(crate) materials: u16,
    pub(crate) recent: Recent,
    pub(crate) recent_uv: Recent,
    star: Vec<Spoke>,
    scores: Vec<(f64, usize)>,
}

/// What was decided about a split so far.
pub(crate) struct Split {
    pub(crate) t: u32,
    pub(crate) u: u32,
    pub(crate) fan: Fan,
    pub(crate) moves: Vec<bool>,
    pub(crate) gates: Vec<Gate>,
    pub(crate) added: Vec<Added>,
}

impl Splitter {
    pub(crate) fn new(position_bits: u8, kinds: Kinds, materials: u16) -> Self {
        Self {
            position_bits,
            kinds,
            materials,
            recent: Recent::default(),
            recent_uv: Recent::default(),
            star: Vec::new(),
            scores: Vec::new(),
        }
    }
}

/// Codes the split of `t`; returns the new vertex.
pub(crate) fn code_split<C: Coder>(
    coder: &mut C,
    splitter: &mut Splitter,
    local: &mut Local<'_>,
    t: u32,
    guide: &mut Option<&mut Guide<'_>>,
) -> Result<u32, DecodeError> {
    let born = guide.as_mut().map_or_else(Vec::new, |g| g.begin_split(t));
    local.star(t, &mut splitter.star);
    let fan = Fan::new(&splitter.star);
    let moves = code_labels(coder, splitter, local, &fan, guide.as_deref())?;
    let gates = gates(&fan, &moves);
    let mut added = code_faces(coder, local, &fan, &gates, t, born)?;

    // Until its place is known, the new vertex is where the old one is.
    let u = local.add_vertex(local.vertices[t as usize].position, Some(t));
    if let Some(guide) = guide {
        let name = guide.new_vertex();
        guide.names.vertex(name);
    }
    for (spoke, _) in fan.spokes.iter().zip(&moves).filter(|(_, moves)| **moves) {
        local.move_corner(spoke.face, spoke.k, u);
    }
    for face in &mut added {
        face.local = local.add_face(if face.left { [t, face.x, u] } else { [u, face.x, t] });
        if let (Some(guide), Some(name)) = (guide.as_mut(), face.face) {
            guide.names.faces.push(name);
        }
    }
    let actual = guide.as_ref().map(|g| g.source.mesh.positions[g.new_vertex() as usize]);
    let position = splitter.position_bits;
    let end = |i: usize| added.get(i).map(|a| a.x);
    let roles = Roles { target: t, ends: [end(0), end(1)] };
    code_position(coder, &mut splitter.recent, local, &mut splitter.star, u, roles, actual, position)?;
    code_wedges(coder, splitter, local, &Split { t, u, fan, moves, gates, added }, guide)?;
    coder.check()?;
    Ok(u)
}

/// Which spokes move to the new vertex.
fn code_labels<C: Coder>(
    coder: &mut C,
    splitter: &mut Splitter,
    local: &Local<'_>,
    fan: &Fan,
    guide: Option<&Guide<'_>>,
) -> Result<Vec<bool>, DecodeError> {
    let n = fan.spokes.len();
    let wanted: Option<Vec<bool>> = guide.map(|g| fan.spokes.iter().map(|s| g.moves(s.face)).collect());
    let mut moves = vec![false; n];
    if fan.segments.len() == 1 {
        let closed = fan.segments[0].closed;
        let run = wanted.as_ref().map(|w| single_run(w, closed));
        if coder.bit(SINGLE_RUN + usize::from(closed), run.as_ref().is_some_and(Option::is_some)) {
            let (start, length) = run.flatten().unwrap_or((0, 0));
            let length = code_length(coder, n, closed, length)?;
            let starts = match length {
                0 => 0,
                _ if closed && length == n => 1,
                _ if closed => n,
                _ => n - length + 1,
            };
            let mut at = 0;
            if starts > 1 {
                rank_starts(local, fan, length, starts, &mut splitter.scores);
                at = code_start(coder, &splitter.scores, n, start)?;
            }
            for i in 0..length {
                moves[(at + i) % n] = true;
            }
            return Ok(moves);
        }
    }
    let mut previous = false;
    for (i, label) in moves.iter_mut().enumerate() {
        let want = wanted.as_ref().is_some_and(|w| w[i]);
        previous = coder.bit(LABEL + usize::from(previous), want);
        *label = previous;
    }
    Ok(moves)
}

fn code_length<C: Coder>(coder: &mut C, n: usize, closed: bool, length: usize) -> Result<usize, DecodeError> {
    let length = if n <= 15 {
        let at = RUN_LENGTH + (n.min(MAX_VALENCE) * 2 + usize::from(closed)) * tree_contexts(4);
        tree(coder, at, 4, length as u32)
    } else {
        integer(coder, LONG_RUN, length as u32)
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
    let last = scores.len() - 1;
    for rank in 0..last {
        let gap = ((scores[rank + 1].0 - scores[rank].0) * 4.0).min(15.0) as usize;
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
fn rank_starts(local: &Local<'_>, fan: &Fan, length: usize, starts: usize, scores: &mut Vec<(f64, usize)>) {
    let n = fan.spokes.len();
    let center =
        local.position(local.faces[fan.spokes[0].face as usize].corners[usize::from(fan.spokes[0].k)]);
    let mut ring: Vec<RingVertex> = Vec::with_capacity(n + 1);
    let mut mean = [0.0; 3];
    let mut square = 0.0;
    let closed = fan.segments[0].closed;
    for i in 0..n + usize::from(!closed) {
        let v = if i < n { fan.spokes[i].a } else { fan.spokes[n - 1].b };
        let at = sub(local.position(v), center);
        mean = add(mean, at);
        square += dot(at, at);
        ring.push(RingVertex {
            at,
            length: dot(at, at).sqrt(),
            valence: local.valence(v) as f64,
            interior: f64::from(u8::from(local.vertices[v as usize].interior)),
            area: 0.0,
        });
    }
    let count = ring.len();
    let inverse = 1.0 / (square / count as f64).sqrt().max(1e-9);
    mean = scale(mean, 1.0 / count as f64);
    let mut normal = [0.0; 3];
    let mut total = 0.0;
    for i in 0..n {
        let area = cross(ring[i].at, ring[(i + 1) % count].at);
        normal = add(normal, area);
        ring[i].area = length_of(area);
        total += ring[i].area;
    }
    let size = dot(normal, normal);
    if size > 0.0 {
        // What is left of the mean lies in the tangent plane: the new vertex is on that side.
        mean = sub(mean, scale(normal, dot(mean, normal) / size));
    }
    let outward = scale(mean, inverse * inverse);
    scores.clear();
    for start in 0..starts {
        let (left, right) = (&ring[start], &ring[(start + length) % count]);
        let mut middle = scale(add(left.at, right.at), 0.5);
        let mut area = left.area;
        for i in 1..length {
            let inside = &ring[(start + i) % count];
            middle = add(middle, inside.at);
            area += inside.area;
        }
        let score = VALENCE * (left.valence + right.valence)
            + SHARE * area / total.max(1e-9)
            + OUTWARD * dot(middle, outward) / length as f64
            + STRAIGHT * dot(left.at, right.at) / (left.length * right.length).max(1e-9)
            + LENGTH * (left.length + right.length) * inverse
            + INSIDE * (left.interior + right.interior);
        scores.push((-score, start));
    }
    scores.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
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

/// A neighbour, relative to the star's centre.
struct RingVertex {
    at: Vec3,
    length: f64,
    valence: f64,
    interior: f64,
    /// Of the face from here to the next, doubled.
    area: f64,
}

/// Where new faces are expected: around each run of moving spokes.
fn gates(fan: &Fan, moves: &[bool]) -> Vec<Gate> {
    let mut gates = Vec::new();
    for segment in &fan.segments {
        let (start, end) = (segment.start, segment.end);
        for i in start..end {
            if !moves[i] {
                continue;
            }
            let before = if i > start { Some(i - 1) } else { segment.closed.then_some(end - 1) };
            let after = if i + 1 < end { Some(i + 1) } else { segment.closed.then_some(start) };
            if before.is_none_or(|j| !moves[j]) {
                gates.push(Gate { x: fan.spokes[i].a, left: true, stays: before, moves: i });
            }
            if after.is_none_or(|j| !moves[j]) {
                gates.push(Gate { x: fan.spokes[i].b, left: false, stays: after, moves: i });
            }
        }
    }
    gates
}

/// The faces that the split adds.
fn code_faces<C: Coder>(
    coder: &mut C,
    local: &Local<'_>,
    fan: &Fan,
    gates: &[Gate],
    t: u32,
    mut born: Vec<Born>,
) -> Result<Vec<Added>, DecodeError> {
    let mut added = Vec::new();
    for (number, gate) in gates.iter().enumerate() {
        let found = born.iter().position(|b| b.x == gate.x && b.left == gate.left);
        let context = usize::from(gate.stays.is_some()) * 2 + usize::from(gate.left);
        if coder.bit(GATE + context, found.is_some()) {
            let face = found.map(|i| born.remove(i).face);
            added.push(Added { x: gate.x, left: gate.left, gate: Some(number), local: 0, face });
        }
    }
    let extras = integer(coder, EXTRAS, born.len() as u32);
    if extras > MAX_EXTRAS {
        return Err(DecodeError::new("chunk", format!("a split adds {extras} faces")));
    }
    let ring = if extras > 0 { fan.ring() } else { Vec::new() };
    for i in 0..extras as usize {
        let want = born.get(i);
        let place = want.and_then(|w| ring.iter().position(|&v| v == w.x));
        let x = if !ring.is_empty() && coder.bit(EXTRA_IN_RING, place.is_some()) {
            ring[index(coder, ring.len(), place.unwrap_or(0), "chunk: ring vertex")?]
        } else {
            index(coder, local.vertices.len(), want.map_or(0, |w| w.x as usize), "chunk: vertex")? as u32
        };
        if x == t {
            return Err(DecodeError::new("chunk", "a face uses a vertex twice"));
        }
        let left = coder.raw(1, u32::from(want.is_some_and(|w| w.left))) == 1;
        added.push(Added { x, left, gate: None, local: 0, face: want.map(|w| w.face) });
        coder.check()?;
    }
    Ok(added)
}
