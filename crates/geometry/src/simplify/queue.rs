//! The order of a region's collapses: cheapest first from a heap, or rounds of independent collapses.
//!
//! Each vertex has one candidate, its cheapest. A collapse makes its neighbours' candidates stale. Since quadrics
//! only grow, a stale cost is at most too low, so it is recomputed when the candidate reaches the top. Edges to the
//! target may become cheaper and are updated at once.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::collapse::Records;
use crate::simplify::legality::Rules;
use crate::simplify::metric::Pricer;
use crate::simplify::region::Region;
use crate::simplify::settings::Metric;

/// Collapses until `limit` vertices are removed or no legal collapse remains: first by strict rules, then by relaxed
/// ones. See [`crate::Settings::round_share`].
pub(crate) fn simplify_region(region: Region, limit: usize, round_share: Option<f64>) -> Records {
    let mut order = CollapseQueue::new(region, limit);
    for strict in [true, false] {
        order.begin(strict);
        match round_share {
            None => order.run(),
            Some(share) => order.run_rounds(share.clamp(0.01, 0.5)),
        }
    }
    let mut records = order.region.records;
    records.shrink();
    records
}

/// A vertex's candidate.
#[derive(Clone, Copy)]
struct Best {
    cost: f64,
    target: u32,
    /// Whether the cost must be recomputed before use.
    stale: bool,
}

/// No candidate.
const NONE: Best = Best { cost: f64::INFINITY, target: u32::MAX, stale: false };

struct CollapseQueue {
    region: Region,
    rules: Rules,
    pricer: Pricer,
    limit: usize,
    best: Vec<Best>,
    /// Cost (as the bits of a positive f32) in the high half, vertex in the low half.
    heap: BinaryHeap<Reverse<u64>>,
    ring: Vec<u32>,
    /// Whether a component is being dropped, whose shape does not matter.
    drops: bool,
}

impl CollapseQueue {
    fn new(region: Region, limit: usize) -> Self {
        let vertices = region.vertex_count() as usize;
        Self {
            rules: Rules::new(vertices),
            pricer: Pricer::default(),
            limit,
            best: vec![NONE; vertices],
            heap: BinaryHeap::with_capacity(vertices * 2),
            ring: Vec::new(),
            drops: false,
            region,
        }
    }

    fn begin(&mut self, strict: bool) {
        self.rules.strict = strict;
        self.heap.clear();
        if !self.full() {
            for u in 0..self.region.vertex_count() {
                self.best[u as usize] = NONE;
                self.find_candidate(u, None);
            }
            for (number, group) in (self.region.vertex_count()..).zip(&self.region.groups) {
                if group.drop_cost < f64::INFINITY {
                    self.heap.push(Reverse(key(group.drop_cost, number)));
                }
            }
        }
    }

    fn full(&self) -> bool {
        self.region.records.collapses.len() >= self.limit
    }

    fn run(&mut self) {
        while !self.full() {
            let Some(Reverse(entry)) = self.heap.pop() else { break };
            let u = entry as u32;
            if let Some(number) = u.checked_sub(self.region.vertex_count()) {
                self.drop_group(number);
                continue;
            }
            let best = self.best[u as usize];
            if self.region.removed[u as usize] || key(best.cost, u) != entry {
                continue;
            }
            if self.region.group_of(u).is_some_and(|group| best.cost > group.most_cost) {
                // It would deform its component too much.
                self.best[u as usize] = NONE;
            } else if best.stale {
                self.find_candidate(u, None);
            } else if self.region.shrinks(u, best.target)
                || self.rules.penalty(&self.region, u, best.target).is_none()
            {
                self.find_candidate(u, Some(best));
            } else {
                self.region.collapse(u, best.target, best.cost);
                self.update(u, best.target);
            }
        }
    }

    /// Collapses a whole component, cheapest first, all at the cost of dropping it.
    fn drop_group(&mut self, number: u32) {
        let Some(group) = self.region.groups.get_mut(number as usize) else { return };
        let cost = std::mem::replace(&mut group.drop_cost, f64::INFINITY);
        let vertices = std::mem::take(&mut group.vertices);
        let strict = std::mem::replace(&mut self.rules.strict, false);
        self.drops = true;
        loop {
            let mut cheapest: Option<(u32, Best)> = None;
            for &u in &vertices {
                if self.region.stars.is_empty(u) {
                    continue;
                }
                let best = self.cheapest(u, None);
                if best.target != NONE.target && cheapest.is_none_or(|(_, known)| best.cost < known.cost) {
                    cheapest = Some((u, best));
                }
            }
            let Some((u, best)) = cheapest else { break };
            self.region.collapse(u, best.target, cost);
        }
        (self.rules.strict, self.drops) = (strict, false);
    }

    /// Rounds of the cheapest collapses that share no face.
    fn run_rounds(&mut self, share: f64) {
        let mut used = vec![0_u32; self.region.corners.len()];
        for round in 1.. {
            let mut candidates: Vec<u64> = Vec::new();
            for u in 0..self.region.vertex_count() {
                let at = u as usize;
                if self.region.removed[at] || !self.region.interior[at] || self.region.held[at] {
                    continue;
                }
                self.best[u as usize].stale |= self.best[u as usize].target == NONE.target;
                while self.best[u as usize].stale {
                    self.find_candidate(u, None);
                    self.find_legal_candidate(u);
                }
                if self.best[u as usize].target != NONE.target {
                    candidates.push(key(self.best[u as usize].cost, u));
                }
            }
            candidates.sort_unstable();
            let quota = ((candidates.len() as f64 * share) as usize).max(1);
            let before = self.region.records.collapses.len();
            for &entry in &candidates {
                if self.full() || self.region.records.collapses.len() - before >= quota {
                    break;
                }
                let u = entry as u32;
                let best = self.best[u as usize];
                let region = &self.region;
                let faces = || {
                    [u, best.target]
                        .into_iter()
                        .flat_map(|v| region.stars.corners(v))
                        .map(|c| (c / 3) as usize)
                };
                if region.removed[u as usize] || faces().any(|f| used[f] == round) {
                    continue;
                }
                // Adjacent faces may have changed since the candidate was checked.
                if self.rules.penalty(region, u, best.target).is_none() {
                    self.best[u as usize].stale = true;
                    continue;
                }
                faces().for_each(|f| used[f] = round);
                self.region.collapse(u, best.target, best.cost);
                self.update(u, best.target);
            }
            self.heap.clear();
            if self.full() || self.region.records.collapses.len() == before {
                break;
            }
        }
    }

    /// Selects the cheapest legal candidate of `u`.
    fn find_legal_candidate(&mut self, u: u32) {
        loop {
            let best = self.best[u as usize];
            if best.target == NONE.target || self.rules.penalty(&self.region, u, best.target).is_some() {
                return;
            }
            self.find_candidate(u, Some(best));
        }
    }

    /// Updates candidates after `u` was collapsed onto `t`.
    fn update(&mut self, u: u32, t: u32) {
        let mut ring = std::mem::take(&mut self.ring);
        self.rules.ring(&self.region, t, &mut ring);
        self.find_candidate(t, None);
        for &w in &ring {
            if !self.region.interior[w as usize] || self.region.held[w as usize] {
                continue;
            }
            if self.region.metric != Metric::Qem {
                self.find_candidate(w, None);
                continue;
            }
            let best = &mut self.best[w as usize];
            let cost = self.pricer.cost(&self.region, w, t);
            if cost < best.cost {
                *best = Best { cost, target: t, stale: !self.rules.strict };
                self.heap.push(Reverse(key(cost, w)));
            } else if best.target == u || best.target == t {
                best.stale = true;
            }
        }
        self.ring = ring;
    }

    /// Finds the cheapest candidate of `u`; with `after`, only among dearer ones. Strict candidates are checked for
    /// legality when they reach the top, relaxed ones now, since a penalty changes their order.
    fn find_candidate(&mut self, u: u32, after: Option<Best>) {
        let at = u as usize;
        if !self.region.interior[at] || self.region.removed[at] || self.region.held[at] {
            return;
        }
        let best = self.cheapest(u, after);
        self.best[at] = best;
        if best.target != NONE.target {
            self.heap.push(Reverse(key(best.cost, u)));
        }
    }

    /// The cheapest candidate of `u`, as in [`Self::find_candidate`].
    fn cheapest(&mut self, u: u32, after: Option<Best>) -> Best {
        let mut ring = std::mem::take(&mut self.rules.ring_u);
        self.rules.ring(&self.region, u, &mut ring);
        self.pricer.prepare(&self.region, u);
        let mut best = NONE;
        for &t in ring.iter().filter(|&&t| self.region.interior[t as usize]) {
            if !self.drops && self.region.shrinks(u, t) {
                continue;
            }
            let mut cost = self.pricer.cost(&self.region, u, t);
            let dearer = |a: &Best| (cost, t) > (a.cost, a.target);
            if self.rules.strict {
                if after.as_ref().is_some_and(|a| !dearer(a)) {
                    continue;
                }
            } else if cost <= best.cost {
                match self.rules.penalty(&self.region, u, t) {
                    Some(penalty) => cost += penalty,
                    None => continue,
                }
            }
            if (cost, t) < (best.cost, best.target) {
                best = Best { cost, target: t, stale: false };
            }
        }
        self.rules.ring_u = ring;
        best
    }
}

fn key(cost: f64, vertex: u32) -> u64 {
    u64::from((cost as f32).to_bits()) << 32 | u64::from(vertex)
}
