//! One vertex split: which faces go to the new vertex, which faces appear, wedges, position.

use crate::codec::fan::Fan;
use crate::codec::local::Local;
use crate::codec::model::{MAX_VALENCE, Model};
use crate::codec::plan::{Names, PlannedSplit};
use crate::codec::position::code_position;
use crate::error::DecodeError;
use crate::mesh::Attributes;
use crate::range_coder::Coder;
use crate::symbols::index;

/// What the encoder wants said about a split.
pub(crate) struct Wish<'a, 'p> {
    pub(crate) split: &'a PlannedSplit<'p>,
    pub(crate) position: [i32; 3],
    /// uv and group of the builder's wedges.
    pub(crate) wedges: &'a [crate::mesh::Wedge],
    pub(crate) materials: &'a [u16],
    pub(crate) names: &'a mut Names,
}

/// Grids of the asset.
#[derive(Clone, Copy)]
pub(crate) struct Bits {
    pub(crate) position: u8,
    pub(crate) uv: u8,
    pub(crate) materials: u16,
}

/// Most new faces of one split beyond the usual two.
const MAX_EXTRAS: u32 = 1 << 16;
/// Weight of a neighbour's valence against the area share of the run, in the ranking of starts.
const VALENCE_WEIGHT: f64 = 0.12;
/// Contexts of corners in `Model::same_wedge`.
const AT_TARGET: usize = 0;
const AT_THIRD: usize = 1;
const AT_NEW: usize = 2;

/// A place where a new face may appear: between a face that stays and one that goes, or at an end.
struct Gate {
    /// Ring vertex of the new face.
    x: u32,
    /// The new face is (t, x, u), else (u, x, t).
    left: bool,
    /// Neighbouring spokes: one that stays, one that moves.
    stays: Option<usize>,
    moves: usize,
}

/// A face that the split adds: third vertex, orientation, and the gate that it fills.
struct Added {
    x: u32,
    left: bool,
    gate: Option<usize>,
    /// Builder's face, when encoding.
    face: Option<u32>,
}

/// Codes the split of `t`; returns the new vertex.
pub(crate) fn code_split<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    local: &mut Local<'_>,
    bits: Bits,
    t: u32,
    mut wish: Option<Wish<'_, '_>>,
) -> Result<u32, DecodeError> {
    let fan = local.fan(t);
    let moves = code_labels(coder, model, local, &fan, wish.as_ref())?;
    let gates = gates(&fan, &moves);
    let added = code_faces(coder, model, local, &fan, &gates, t, wish.as_ref())?;

    let u = local.add_vertex([0; 3], Some(t));
    if let Some(wish) = &mut wish {
        wish.names.vertex(wish.split.vertex);
    }
    let targets: Vec<u32> = fan.spokes.iter().map(|s| local.spoke_wedges(s)[0]).collect();
    code_moved_wedges(coder, model, local, bits, u, &fan, &moves, &targets, &mut wish)?;
    for face in &added {
        code_face(coder, model, local, bits, t, u, &fan, &gates, &targets, face, &mut wish)?;
    }
    code_position(coder, &mut model.residual, local, u, wish.map(|w| w.position), bits.position)?;
    coder.check()?;
    Ok(u)
}

/// Which spokes move to the new vertex.
fn code_labels<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    local: &Local<'_>,
    fan: &Fan,
    wish: Option<&Wish<'_, '_>>,
) -> Result<Vec<bool>, DecodeError> {
    let n = fan.spokes.len();
    let wanted: Option<Vec<bool>> = wish.map(|w| {
        fan.spokes
            .iter()
            .map(|s| {
                let face = w.names.faces[s.face as usize];
                w.split.moved.iter().any(|m| m.face == face)
            })
            .collect()
    });
    let mut moves = vec![false; n];
    if fan.segments.len() == 1 {
        let closed = fan.segments[0].closed;
        let run = wanted.as_ref().map(|w| single_run(w, closed));
        if coder.bit(&mut model.single_run, run.as_ref().is_some_and(Option::is_some)) {
            let (start, length) = run.flatten().unwrap_or((0, 0));
            let context = n.min(MAX_VALENCE);
            let length = if n <= 30 {
                model.run_length[context].code(coder, length as u32) as usize
            } else {
                model.long_run.code(coder, length as u32) as usize
            };
            if length > n {
                return Err(DecodeError::new("chunk", "more faces move than there are"));
            }
            let starts = match length {
                0 => 0,
                _ if closed && length == n => 1,
                _ if closed => n,
                _ => n - length + 1,
            };
            let mut at = 0;
            if starts > 1 {
                let order = rank_starts(local, fan, length, starts);
                let rank = order.iter().position(|&s| s == start).unwrap_or(0);
                let rank = if starts <= 32 {
                    model.run_start[context].code(coder, rank as u32) as usize
                } else {
                    index(coder, starts, rank, "chunk: start of a run")?
                };
                at = *order
                    .get(rank)
                    .ok_or_else(|| DecodeError::new("chunk", format!("start {rank} of {starts}")))?;
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
        previous = coder.bit(&mut model.label[usize::from(previous)], want);
        *label = previous;
    }
    Ok(moves)
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

/// Starts of a run of `length` in order of plausibility: runs that take much area and end at
/// neighbours of low valence first.
fn rank_starts(local: &Local<'_>, fan: &Fan, length: usize, starts: usize) -> Vec<usize> {
    let n = fan.spokes.len();
    let areas: Vec<f64> = fan.spokes.iter().map(|s| local.face_area(s.face)).collect();
    let total: f64 = areas.iter().sum();
    let valences: Vec<(usize, usize)> =
        fan.spokes.iter().map(|s| (local.valence(s.a), local.valence(s.b))).collect();
    let mut run: f64 = areas[..length].iter().sum();
    let mut scores = Vec::with_capacity(starts);
    for start in 0..starts {
        let ends = valences[start].0 + valences[(start + length - 1) % n].1;
        let share = if total > 0.0 { run / total } else { 0.0 };
        scores.push((VALENCE_WEIGHT * ends as f64 - share, start));
        run += areas[(start + length) % n] - areas[start];
    }
    scores.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    scores.into_iter().map(|s| s.1).collect()
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
    model: &mut Model,
    local: &Local<'_>,
    fan: &Fan,
    gates: &[Gate],
    t: u32,
    wish: Option<&Wish<'_, '_>>,
) -> Result<Vec<Added>, DecodeError> {
    let mut left_over = wish.map_or_else(Vec::new, |w| wanted_faces(w, t));
    let mut added = Vec::new();
    for (number, gate) in gates.iter().enumerate() {
        let found = left_over.iter().position(|a| a.x == gate.x && a.left == gate.left);
        let context = usize::from(gate.stays.is_some()) * 2 + usize::from(gate.left);
        if coder.bit(&mut model.gate[context], found.is_some()) {
            let face = found.and_then(|i| left_over.remove(i).face);
            added.push(Added { x: gate.x, left: gate.left, gate: Some(number), face });
        }
    }
    let extras = model.extras.code(coder, left_over.len() as u32);
    if extras > MAX_EXTRAS {
        return Err(DecodeError::new("chunk", format!("a split adds {extras} faces")));
    }
    let ring = if extras > 0 { fan.ring() } else { Vec::new() };
    for i in 0..extras as usize {
        let want = left_over.get(i);
        let place = want.and_then(|w| ring.iter().position(|&v| v == w.x));
        let x = if coder.bit(&mut model.extra_in_ring, place.is_some()) {
            ring[index(coder, ring.len(), place.unwrap_or(0), "chunk: ring vertex")?
                .min(ring.len().max(1) - 1)]
        } else {
            index(coder, local.vertices.len(), want.map_or(0, |w| w.x as usize), "chunk: vertex")? as u32
        };
        if x == t {
            return Err(DecodeError::new("chunk", "a face uses a vertex twice"));
        }
        let left = coder.raw(1, u32::from(want.is_some_and(|w| w.left))) == 1;
        added.push(Added { x, left, gate: None, face: want.and_then(|w| w.face) });
        coder.check()?;
    }
    Ok(added)
}

/// The builder's removed faces as seen from the split.
fn wanted_faces(wish: &Wish<'_, '_>, t: u32) -> Vec<Added> {
    let (target, vertex) = (wish.split.target, wish.split.vertex);
    wish.split
        .removed
        .iter()
        .map(|r| {
            let corners = r.wedges.map(|w| wish.wedges[w as usize].vertex);
            let at = corners.iter().position(|&v| v == vertex).unwrap_or(0);
            let left = corners[(at + 1) % 3] == target;
            let third = corners.into_iter().find(|&v| v != vertex && v != target);
            let x = third.and_then(|v| wish.names.local_vertex.get(&v).copied()).unwrap_or(t);
            Added { x, left, gate: None, face: Some(r.face) }
        })
        .collect()
}

/// Wedges of the new vertex for the faces that move to it, and the move itself.
#[allow(clippy::too_many_arguments)]
fn code_moved_wedges<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    local: &mut Local<'_>,
    bits: Bits,
    u: u32,
    fan: &Fan,
    moves: &[bool],
    targets: &[u32],
    wish: &mut Option<Wish<'_, '_>>,
) -> Result<(), DecodeError> {
    // (wedge of t, wedge of u) pairs so far.
    let mut pairs: Vec<(u32, u32)> = Vec::new();
    for i in (0..fan.spokes.len()).filter(|&i| moves[i]) {
        let spoke = fan.spokes[i];
        let from = targets[i];
        let builder = wish.as_ref().and_then(|w| {
            let face = w.names.faces[spoke.face as usize];
            w.split.moved.iter().find(|m| m.face == face).map(|m| m.from)
        });
        let want = builder.and_then(|b| wish.as_ref()?.names.local_wedge.get(&b).copied());
        let same = pairs.iter().find(|p| p.0 == from).map(|p| p.1);
        let mut chosen = None;
        if let Some(same) = same
            && coder.bit(&mut model.same_moved_wedge, want == Some(same))
        {
            chosen = Some(same);
        }
        if chosen.is_none() {
            let own = local.wedges_of(u);
            let new = own.is_empty() || coder.bit(&mut model.new_moved_wedge, want.is_none());
            chosen = Some(if new {
                let guess = moved_uv(local, fan, moves, targets, from);
                new_wedge(coder, model, local, bits, u, guess, builder, wish)?
            } else {
                let place = own.iter().position(|&w| Some(w) == want).unwrap_or(0);
                own[index(coder, own.len(), place, "chunk: wedge")?]
            });
        }
        if let Some(wedge) = chosen {
            if same.is_none() {
                pairs.push((from, wedge));
            }
            local.move_corner(spoke.face, spoke.k, wedge);
        }
    }
    Ok(())
}

/// Mean of the uvs around the moving faces that used one wedge of t.
fn moved_uv(local: &Local<'_>, fan: &Fan, moves: &[bool], targets: &[u32], from: u32) -> [i32; 2] {
    let (mut sum, mut count) = ([0_i64; 2], 0_i64);
    for i in (0..fan.spokes.len()).filter(|&i| moves[i] && targets[i] == from) {
        let [_, a, b] = local.spoke_wedges(&fan.spokes[i]);
        for w in [a, b] {
            let uv = local.wedges[w as usize].attributes.uv;
            sum = [sum[0] + i64::from(uv[0]), sum[1] + i64::from(uv[1])];
            count += 1;
        }
    }
    if count == 0 {
        local.wedges[from as usize].attributes.uv
    } else {
        sum.map(|s| (s.div_euclid(count)) as i32)
    }
}

#[allow(clippy::too_many_arguments)]
fn new_wedge<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    local: &mut Local<'_>,
    bits: Bits,
    vertex: u32,
    guess: [i32; 2],
    builder: Option<u32>,
    wish: &mut Option<Wish<'_, '_>>,
) -> Result<u32, DecodeError> {
    let want = match (builder, wish.as_ref()) {
        (Some(b), Some(w)) => Some(w.wedges[b as usize]),
        _ => None,
    };
    let mut uv = [0; 2];
    if bits.uv > 0 {
        for axis in 0..2 {
            let residual = want.map_or(0, |w| w.attributes.uv[axis] - guess[axis]);
            uv[axis] = guess[axis].wrapping_add(model.uv[axis].code(coder, residual));
            if uv[axis] < 0 || uv[axis] >= 1 << bits.uv {
                return Err(DecodeError::new("chunk", "a texture coordinate is off the grid"));
            }
        }
    }
    let first = local.wedges_of(vertex).is_empty();
    let group = model.group[usize::from(first)].code(coder, want.map_or(0, |w| w.attributes.group));
    let wedge = local.add_wedge(vertex, Attributes { uv, group, ..Attributes::default() });
    if let (Some(wish), Some(builder)) = (wish.as_mut(), builder) {
        wish.names.wedge(builder);
    }
    Ok(wedge)
}

/// Wedges and material of one new face, and the face itself.
#[allow(clippy::too_many_arguments)]
fn code_face<C: Coder>(
    coder: &mut C,
    model: &mut Model,
    local: &mut Local<'_>,
    bits: Bits,
    t: u32,
    u: u32,
    fan: &Fan,
    gates: &[Gate],
    targets: &[u32],
    added: &Added,
    wish: &mut Option<Wish<'_, '_>>,
) -> Result<(), DecodeError> {
    let gate = added.gate.map(|g| &gates[g]);
    // The neighbours' wedges at t, x and u.
    let (mut at_t, mut at_x, mut at_u, mut beside) = (None, None, None, None);
    if let Some(gate) = gate {
        let moving = &fan.spokes[gate.moves];
        let [centre, a, b] = local.spoke_wedges(moving);
        at_u = Some(centre);
        at_x = Some(if gate.left { a } else { b });
        at_t = Some(gate.stays.map_or(targets[gate.moves], |s| targets[s]));
        beside = Some(moving.face);
    } else if let Some(spoke) = fan.spokes.first() {
        at_t = Some(targets[0]);
        beside = Some(spoke.face);
    }
    let wanted = match (added.face, wish.as_ref()) {
        (Some(face), Some(w)) => w.split.removed.iter().find(|r| r.face == face).map(|r| r.wedges),
        _ => None,
    };
    let mut corner = |coder: &mut C,
                      local: &mut Local<'_>,
                      kind: usize,
                      vertex: u32,
                      guess: Option<u32>,
                      wish: &mut Option<Wish<'_, '_>>|
     -> Result<u32, DecodeError> {
        let builder = wanted.and_then(|wedges| {
            let w = wish.as_ref()?;
            let v = w.names.vertices[vertex as usize];
            wedges.into_iter().find(|&x| w.wedges[x as usize].vertex == v)
        });
        let want = builder.and_then(|b| wish.as_ref()?.names.local_wedge.get(&b).copied());
        if let Some(guess) = guess
            && coder.bit(&mut model.same_wedge[kind], want == Some(guess))
        {
            return Ok(guess);
        }
        let own = local.wedges_of(vertex);
        if own.is_empty() || coder.bit(&mut model.new_wedge[kind], want.is_none()) {
            let near = guess.or(own.first().copied()).or(at_t);
            let uv = near.map_or([0; 2], |w| local.wedges[w as usize].attributes.uv);
            return new_wedge(coder, model, local, bits, vertex, uv, builder, wish);
        }
        let place = own.iter().position(|&w| Some(w) == want).unwrap_or(0);
        Ok(own[index(coder, own.len(), place, "chunk: wedge")?])
    };
    let t_wedge = corner(coder, local, AT_TARGET, t, at_t, wish)?;
    let x_wedge = corner(coder, local, AT_THIRD, added.x, at_x, wish)?;
    let u_guess = at_u.or(local.wedges_of(u).first().copied());
    let u_wedge = corner(coder, local, AT_NEW, u, u_guess, wish)?;

    let near = beside.map_or(0, |f| local.faces[f as usize].material);
    let want = match (added.face, wish.as_ref()) {
        (Some(face), Some(w)) => w.materials[face as usize],
        _ => near,
    };
    let mut material = near;
    if bits.materials > 1 && !coder.bit(&mut model.same_material, want == near) {
        material = model.material.code(coder, u32::from(want)).min(u32::from(u16::MAX)) as u16;
        if material >= bits.materials {
            return Err(DecodeError::new("chunk", format!("material {material} of {}", bits.materials)));
        }
    }
    let wedges = if added.left { [t_wedge, x_wedge, u_wedge] } else { [u_wedge, x_wedge, t_wedge] };
    local.add_face(wedges, material);
    if let (Some(wish), Some(face)) = (wish.as_mut(), added.face) {
        wish.names.faces.push(face);
    }
    Ok(())
}
