//! Ancestor-closed cuts: by error, by budget, at random.
//!
//! A chunk with no child in the cut (a leaf) may be applied up to a truncation point only.

use crate::asset::base::Base;
use crate::asset::index::{ChunkInfo, TruncationPoint};
use crate::random::Random;

/// Limit on an ancestor-closed cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// At most this many faces.
    Faces(u64),
    /// At most this geometric error, in the asset's units.
    Error(f64),
    /// At most this many bytes, including head, base and the whole index.
    Bytes(u64),
    /// No limit: all chunks.
    Everything,
}

/// A chunk of an ancestor-closed cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Member {
    /// The chunk.
    pub chunk: u32,
    /// The truncation point up to which it is applied, an index of [`ChunkInfo::truncation_points`]; `None` for the
    /// whole chunk, as it must be if a child of it is a member.
    pub truncation: Option<u8>,
}

/// An ancestor-closed cut with its error and sizes.
#[derive(Clone, Debug, PartialEq)]
pub struct AncestorClosedCut {
    /// Its chunks, ascending, so parents come first.
    pub members: Vec<Member>,
    /// Geometric error of the mesh, in the asset's units.
    pub error: f64,
    /// Faces of the mesh.
    pub faces: u64,
    /// Bytes of head, index and the payload bytes needed.
    pub bytes: u64,
}

/// A refinement step of one chunk: from its current state, of error `error`, to a truncation point or its end.
struct Step {
    error: f32,
    chunk: u32,
    to: Option<u8>,
}

/// The refinement steps of a chunk; truncation points whose error is not lower than an earlier one's are skipped, so
/// errors fall.
fn steps(chunk: u32, info: &ChunkInfo) -> impl Iterator<Item = Step> {
    let mut error = info.error;
    let truncation_points =
        info.truncation_points.iter().enumerate().map(|(at, truncation)| (Some(at as u8), truncation.error));
    truncation_points.chain([(None, f32::NEG_INFINITY)]).filter_map(move |(to, after)| {
        let better = after < error;
        better.then(|| Step { error: std::mem::replace(&mut error, after), chunk, to })
    })
}

/// The ancestor-closed cut of lowest error within a budget.
///
/// Let S(e) be the smallest ancestor-closed cut of error at most e: the chunks whose error is above e, each up to its
/// first truncation point of error at most e, or whole. A parent's error, at any truncation point, is at least its
/// children's, so S(e) is ancestor-closed, with the fewest faces and bytes of all cuts of error at most e. The result
/// is the largest S(e) within the budget, built by taking steps by falling error, plus any further steps that fit: no
/// ancestor-closed cut within the budget has a lower error. Cost: n log n in chunks and truncation points.
///
/// `head_bytes` is the size of what every client needs: base blob and index.
#[must_use]
pub fn lowest_error(base: &Base, infos: &[ChunkInfo], head_bytes: u64, budget: Budget) -> AncestorClosedCut {
    let mut order: Vec<Step> =
        infos.iter().enumerate().flat_map(|(id, info)| steps(id as u32, info)).collect();
    // Stable: a chunk's own steps keep their order where errors are equal.
    order.sort_by(|a, b| b.error.total_cmp(&a.error).then(a.chunk.cmp(&b.chunk)));
    let (mut faces, mut bytes) = (base.faces.len() as u64, head_bytes);
    let mut reached: Vec<Option<Option<u8>>> = vec![None; infos.len()];
    let mut left: Vec<f32> = infos.iter().map(|i| i.error).collect();
    for step in &order {
        let id = step.chunk as usize;
        let info = &infos[id];
        let from = reached[id].map_or(TruncationPoint::default(), |truncation| info.extent(truncation));
        let to = info.extent(step.to);
        let more = |to: u32, from: u32| u64::from(to.saturating_sub(from));
        let (more_faces, more_bytes) =
            (more(to.faces, from.faces), more(to.payload_bytes, from.payload_bytes));
        let fits = match budget {
            Budget::Faces(limit) => faces + more_faces <= limit,
            Budget::Bytes(limit) => bytes + more_bytes <= limit,
            Budget::Error(limit) => f64::from(step.error) > limit,
            Budget::Everything => true,
        };
        if fits && info.parents.iter().all(|&p| reached[p as usize] == Some(None)) {
            reached[id] = Some(step.to);
            left[id] = to.error;
            faces += more_faces;
            bytes += more_bytes;
        }
    }
    let error = f64::from(left.into_iter().fold(0.0, f32::max));
    let members =
        (0..).zip(reached).filter_map(|(chunk, r)| Some(Member { chunk, truncation: r? })).collect();
    AncestorClosedCut { members, error, faces, bytes }
}

/// A random ancestor-closed cut in ascending order, from one chunk with its ancestors to nearly all chunks, with its
/// leaves at random truncation points.
#[must_use]
pub fn random(infos: &[ChunkInfo], random: &mut Random) -> Vec<Member> {
    if infos.is_empty() {
        return Vec::new();
    }
    let most = infos.len() / (1 + random.below(6)) + 1;
    let mut taken = vec![false; infos.len()];
    for _ in 0..random.below(most) + 1 {
        taken[random.below(infos.len())] = true;
    }
    let mut leaf = vec![true; infos.len()];
    for id in (0..infos.len()).rev() {
        if taken[id] {
            for &parent in &infos[id].parents {
                taken[parent as usize] = true;
                leaf[parent as usize] = false;
            }
        }
    }
    let member = |id: usize| {
        let truncation_points = infos[id].truncation_points.len();
        let truncation = random.below(if leaf[id] { truncation_points + 1 } else { 1 });
        // The last choice, and the only one of an inner chunk, is the whole chunk.
        let partial = leaf[id] && truncation < truncation_points;
        Member { chunk: id as u32, truncation: partial.then_some(truncation as u8) }
    };
    (0..infos.len()).filter(|&id| taken[id]).map(member).collect()
}

/// A random order of an ancestor-closed cut (given in ascending order) in which parents come first.
#[must_use]
pub fn random_order(infos: &[ChunkInfo], set: &[Member], random: &mut Random) -> Vec<Member> {
    let place = |id: u32| set.binary_search_by_key(&id, |m| m.chunk).ok();
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); set.len()];
    let mut waiting: Vec<usize> = vec![0; set.len()];
    for (i, member) in set.iter().enumerate() {
        for &parent in &infos[member.chunk as usize].parents {
            if let Some(p) = place(parent) {
                children[p].push(i as u32);
                waiting[i] += 1;
            }
        }
    }
    let mut ready: Vec<u32> = (0..set.len() as u32).filter(|&i| waiting[i as usize] == 0).collect();
    let mut order = Vec::with_capacity(set.len());
    while !ready.is_empty() {
        let next = ready.swap_remove(random.below(ready.len()));
        order.push(set[next as usize]);
        for &child in &children[next as usize] {
            waiting[child as usize] -= 1;
            if waiting[child as usize] == 0 {
                ready.push(child);
            }
        }
    }
    order
}
