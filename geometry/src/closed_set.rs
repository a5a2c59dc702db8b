//! Sets of chunks that are closed under parents: by error, by budget, at random.

use crate::base::Base;
use crate::index::ChunkInfo;
use crate::random::Random;

/// What a set of chunks may come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    /// At most so many faces.
    Faces(u64),
    /// At most this geometric error, in the asset's units.
    Error(f64),
    /// At most so many bytes: header, base and the whole index counted.
    Bytes(u64),
    /// No limit: everything.
    Everything,
}

/// A closed set and what it comes to.
#[derive(Clone, Debug, PartialEq)]
pub struct ClosedSet {
    /// Chunk ids in an order that respects parents.
    pub chunks: Vec<u32>,
    /// Geometric error of the mesh, in the asset's units.
    pub error: f64,
    /// Faces of the mesh.
    pub faces: u64,
    /// Bytes: head, index and the set's payloads.
    pub bytes: u64,
}

/// The closed set of lowest error within a budget.
///
/// Errors are monotone along the DAG, so the chunks in order of falling error are closed at every
/// point; the set is the longest such prefix that fits, and then whatever of the rest still does.
/// `head_bytes` is the size of what every client needs: base blob and index.
#[must_use]
pub fn lowest_error(base: &Base, infos: &[ChunkInfo], head_bytes: u64, budget: Budget) -> ClosedSet {
    let mut order: Vec<u32> = (0..infos.len() as u32).collect();
    order.sort_by(|&a, &b| infos[b as usize].error.total_cmp(&infos[a as usize].error).then(a.cmp(&b)));
    let mut set =
        ClosedSet { chunks: Vec::new(), error: 0.0, faces: base.faces.len() as u64, bytes: head_bytes };
    let mut taken = vec![false; infos.len()];
    let mut error = 0.0_f32;
    for &id in &order {
        let info = &infos[id as usize];
        let fits = match budget {
            Budget::Faces(limit) => set.faces + u64::from(info.faces) <= limit,
            Budget::Bytes(limit) => set.bytes + u64::from(info.payload_bytes) <= limit,
            Budget::Error(limit) => f64::from(info.error) > limit,
            Budget::Everything => true,
        };
        if fits && info.parents.iter().all(|&p| taken[p as usize]) {
            taken[id as usize] = true;
            set.chunks.push(id);
            set.faces += u64::from(info.faces);
            set.bytes += u64::from(info.payload_bytes);
        } else {
            error = error.max(info.error);
        }
    }
    set.error = f64::from(error);
    set
}

/// A random closed set in ascending order, between one chunk's ancestors and nearly everything.
#[must_use]
pub fn random(infos: &[ChunkInfo], random: &mut Random) -> Vec<u32> {
    if infos.is_empty() {
        return Vec::new();
    }
    let most = infos.len() / (1 + random.below(6)) + 1;
    let mut taken = vec![false; infos.len()];
    for _ in 0..random.below(most) + 1 {
        taken[random.below(infos.len())] = true;
    }
    for id in (0..infos.len()).rev() {
        if taken[id] {
            for &parent in &infos[id].parents {
                taken[parent as usize] = true;
            }
        }
    }
    (0..infos.len() as u32).filter(|&id| taken[id as usize]).collect()
}

/// A random order of a closed set in which parents come first.
#[must_use]
pub fn random_order(infos: &[ChunkInfo], set: &[u32], random: &mut Random) -> Vec<u32> {
    let place = |id: u32| set.binary_search(&id).ok();
    let mut children: Vec<Vec<u32>> = vec![Vec::new(); set.len()];
    let mut waiting: Vec<usize> = vec![0; set.len()];
    for (i, &id) in set.iter().enumerate() {
        for &parent in &infos[id as usize].parents {
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
