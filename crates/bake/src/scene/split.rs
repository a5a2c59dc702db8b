//! Splits the meshes of batches by place.
//!
//! A cut is at the roundest coordinate near the middle of the faces, not at the middle itself: when a few meshes of a file
//! change, most cuts stay, and with them most batches.

use std::cmp::Ordering;

use glam::DVec3;

use lodestream_import::BatchMember;

/// Share of the faces that each side of a cut has at least, unless one mesh has more than the rest.
const MIN_SHARE: f64 = 0.375;

/// A mesh that may be in a batch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// Index among the placed meshes.
    pub(super) placed: usize,
    pub(super) member: BatchMember,
    pub(super) faces: usize,
    /// Corners of its box in the scene.
    pub(super) low: DVec3,
    pub(super) high: DVec3,
    /// Range of its texture coordinates, if it has textures.
    pub(super) uvs: Option<[[f64; 2]; 2]>,
}

impl Candidate {
    fn center(&self) -> DVec3 {
        (self.low + self.high) / 2.0
    }
}

/// Splits candidates along the longest side of their centres' bounds until each group has at most `max_faces` (or one
/// candidate) and `max_members`. Groups and their members are in an order that depends only on the candidates.
pub(super) fn by_place(
    candidates: Vec<Candidate>,
    max_faces: usize,
    max_members: usize,
) -> Vec<Vec<Candidate>> {
    let mut groups = Vec::new();
    let mut waiting = vec![candidates];
    while let Some(mut candidates) = waiting.pop() {
        let faces: usize = candidates.iter().map(|candidate| candidate.faces).sum();
        if candidates.len() < 2 || (faces <= max_faces && candidates.len() <= max_members) {
            groups.push(candidates);
            continue;
        }
        let centers = || candidates.iter().map(Candidate::center);
        let low = centers().reduce(DVec3::min).unwrap_or_default();
        let high = centers().reduce(DVec3::max).unwrap_or_default();
        let axis = longest(high - low);
        candidates
            .sort_by(|a, b| a.center()[axis].total_cmp(&b.center()[axis]).then(a.placed.cmp(&b.placed)));
        let rest = candidates.split_off(cut(&candidates, axis, faces));
        waiting.push(rest);
        waiting.push(candidates);
    }
    groups
}

/// The first axis of the longest side.
fn longest(size: DVec3) -> usize {
    let size = size.to_array();
    (1..3).fold(0, |longest, axis| if size[axis] > size[longest] { axis } else { longest })
}

/// How many of the sorted candidates are before the cut: at least one, and not all.
fn cut(candidates: &[Candidate], axis: usize, faces: usize) -> usize {
    let mut before = 0;
    let shares: Vec<f64> = candidates
        .iter()
        .map(|candidate| {
            before += candidate.faces;
            before as f64 / faces.max(1) as f64
        })
        .collect();
    let last = candidates.len() - 1;
    let first = |share: f64| shares.iter().position(|&part| part >= share).unwrap_or(last).min(last - 1);
    let (from, to) = (first(MIN_SHARE), first(1.0 - MIN_SHARE));
    let at = |index: usize| candidates[index].center()[axis];
    match roundest(at(from), at(to)) {
        Some(round) => candidates.partition_point(|candidate| candidate.center()[axis] < round),
        None => first(0.5) + 1,
    }
}

/// The multiple of the largest power of two that is above `low` and at most `high`; `None` if there is no number between.
fn roundest(low: f64, high: f64) -> Option<f64> {
    if low.partial_cmp(&high) != Some(Ordering::Less) {
        return None;
    }
    if low < 0.0 && high >= 0.0 {
        return Some(0.0);
    }
    let mut step = low.abs().max(high.abs()).log2().floor().exp2() * 2.0;
    // Some step below the distance has a multiple between, which its bits bring within reach.
    while step.is_normal() {
        let multiple = (high / step).floor() * step;
        if multiple > low && multiple <= high {
            return Some(multiple);
        }
        step /= 2.0;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_roundest_number_is_between_its_ends() {
        for (low, high, round) in [
            (3.0, 9.0, 8.0),
            (-1.0, 5.0, 0.0),
            (-9.0, -3.0, -8.0),
            (8.0, 11.0, 10.0),
            (0.3, 0.4, 0.375),
            (0.0, 0.3, 0.25),
        ] {
            assert_eq!(roundest(low, high), Some(round), "{low} {high}");
        }
        let next = 4e5_f64.next_up();
        assert_eq!(roundest(4e5, next), Some(next));
        assert_eq!(roundest(1.0, 1.0), None);
        assert_eq!(roundest(f64::NAN, 1.0), None);
    }
}
