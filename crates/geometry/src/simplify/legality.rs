//! Rules for legal collapses.
//!
//! *Strict* rules preserve the topology: the link condition (Dey, Edelsbrunner, Guha and Nekhayev, "Topology
//! preserving edge contraction", 1999) or, at edges of more than two faces, a weaker form; boundary vertices collapse
//! along the boundary, seam vertices along their seam, and no face turns by more than 75°. *Relaxed* rules, used when
//! no strict collapse remains, allow everything that can be encoded and gives no edge more than two faces (or more
//! than in the input): holes close, components vanish, seams shorten; flipped faces cost extra. So a closed manifold
//! remains one, down to nothing.
//!
//! *Clustering* ignores faces: of the strict rules only the seam rule applies, if requested.

use crate::mesh::corner;
use crate::mesh::vec3::{dot, sub, triangle_normal};
use crate::simplify::region::Region;
use crate::simplify::settings::Metric;

/// Cosine of the largest angle by which a face may turn under strict rules with quadrics: 75°.
const MAX_TURN_COS: f64 = 0.258_819_045_102_520_76;
/// Cost of flipping a face under relaxed rules, per (edge length)² × area.
const FLIP_PENALTY: f64 = 0.5;

/// A set of rules, with scratch space for applying them.
pub(crate) struct Rules {
    pub(crate) strict: bool,
    /// Buffer for a ring, borrowed by callers.
    pub(crate) ring_u: Vec<u32>,
    /// Per vertex: number of faces that join it to u, to t, and to both; valid if `stamp` is current.
    around: Vec<Around>,
    stamp: u32,
    neighbours: Vec<u32>,
}

#[derive(Clone, Copy, Default)]
struct Around {
    stamp: u32,
    at_u: u32,
    at_t: u32,
    at_both: u32,
}

impl Rules {
    pub(crate) fn new(vertices: usize) -> Self {
        Self {
            strict: true,
            ring_u: Vec::new(),
            around: vec![Around::default(); vertices],
            stamp: 0,
            neighbours: Vec::new(),
        }
    }

    /// Collects the distinct neighbours of `v`.
    pub(crate) fn ring(&mut self, region: &Region, v: u32, ring: &mut Vec<u32>) {
        self.stamp += 1;
        ring.clear();
        for corner in region.stars.corners(v) {
            let (corners, k) = (region.corners[corner::face_of(corner) as usize], corner::side_of(corner));
            for w in [corners[corner::next(k)], corners[corner::previous(k)]] {
                let around = &mut self.around[w as usize];
                if around.stamp != self.stamp {
                    around.stamp = self.stamp;
                    ring.push(w);
                }
            }
        }
    }

    /// Cost of collapsing `u` onto `t` in addition to its metric; `None` if it is not legal.
    pub(crate) fn penalty(&mut self, region: &Region, u: u32, t: u32) -> Option<f64> {
        if self.strict && region.metric != Metric::Clustering && !seams_allow(region, u, t) {
            return None;
        }
        let removed = self.count_around(region, u, t);
        if removed == 0 {
            return None;
        }
        let clusters = region.metric.clusters();
        let allowed = if self.strict && !clusters {
            self.strict_topology(region, u, t, removed)
        } else {
            self.relaxed_topology(region, u, t)
        };
        if !allowed {
            return None;
        }
        if clusters { Some(0.0) } else { self.turning(region, u, t) }
    }

    /// Counts the faces that join each neighbour to u, to t and to both; returns the number of faces that join u to
    /// t.
    fn count_around(&mut self, region: &Region, u: u32, t: u32) -> u32 {
        self.stamp += 1;
        self.neighbours.clear();
        let mut removed = 0;
        for v in [u, t] {
            for corner in region.stars.corners(v) {
                let (corners, k) =
                    (region.corners[corner::face_of(corner) as usize], corner::side_of(corner));
                let both = corners.contains(&t);
                removed += u32::from(v == u && both);
                for w in [corners[corner::next(k)], corners[corner::previous(k)]] {
                    let around = &mut self.around[w as usize];
                    if around.stamp != self.stamp {
                        *around = Around { stamp: self.stamp, ..Around::default() };
                        self.neighbours.push(w);
                    }
                    if v == u {
                        around.at_u += 1;
                        around.at_both += u32::from(both);
                    } else {
                        around.at_t += 1;
                    }
                }
            }
        }
        removed
    }

    /// The link condition; boundary vertices only along the boundary. Edges of more than two faces may collapse as
    /// well; otherwise everything around them would collapse instead.
    fn strict_topology(&self, region: &Region, u: u32, t: u32, removed: u32) -> bool {
        let (mut ring_u, mut ring_t, mut common) = (0, 0, 0);
        let mut boundary = false;
        for &w in &self.neighbours {
            let around = self.around[w as usize];
            if around.at_u > 2 {
                return self.touching_topology(region, u, t);
            }
            boundary |= around.at_u == 1;
            ring_u += u32::from(around.at_u > 0);
            ring_t += u32::from(around.at_t > 0);
            common += u32::from(w != u && w != t && around.at_u > 0 && around.at_t > 0);
        }
        let along = removed == if boundary { 1 } else { 2 };
        ring_u >= 3 && ring_t >= 3 && along && common == removed
    }

    /// A weaker link condition for vertices at edges where sheets touch: no two other edges merge, no edge loses all
    /// faces, and none gets more faces than the relaxed rules allow.
    fn touching_topology(&self, region: &Region, u: u32, t: u32) -> bool {
        let linked = self.neighbours.iter().filter(|&&w| w != u && w != t).all(|&w| {
            let Around { at_u, at_t, at_both, .. } = self.around[w as usize];
            at_u == 0 || at_t == 0 || (at_both > 0 && at_u + at_t > 2 * at_both)
        });
        linked && self.relaxed_topology(region, u, t)
    }

    /// No edge (t, w) of the result has more than two faces, unless one of its sources had as many. The third vertex
    /// of a removed face must be addressable by the split that restores it: inside the region, or still a neighbour
    /// of `t`.
    fn relaxed_topology(&self, region: &Region, u: u32, t: u32) -> bool {
        let held = &region.held;
        let mut left = 0;
        let thin = self.neighbours.iter().filter(|&&w| w != u && w != t).all(|&w| {
            let Around { at_u, at_t, at_both, .. } = self.around[w as usize];
            let after = at_u + at_t - 2 * at_both;
            let thin = at_u == 0 || at_t == 0 || after <= 2 || after <= at_u || after <= at_t;
            left += after;
            // A locked vertex keeps a face.
            let isolated = at_both > 0 && after == 0;
            thin && (!isolated || (region.interior[w as usize] && !held[w as usize]))
        });
        thin && (left > 0 || !held[t as usize])
    }

    fn turning(&self, region: &Region, u: u32, t: u32) -> Option<f64> {
        let most = if region.metric == Metric::Qem { MAX_TURN_COS } else { 0.0 };
        let to = region.positions[t as usize];
        let edge = sub(region.positions[u as usize], to);
        let mut penalty = 0.0;
        for corner in region.stars.corners(u) {
            let (face, k) = (corner::face_of(corner) as usize, corner::side_of(corner));
            let corners = region.corners[face];
            if corners.contains(&t) {
                continue;
            }
            let a = region.positions[corners[corner::next(k)] as usize];
            let b = region.positions[corners[corner::previous(k)] as usize];
            let before = triangle_normal(region.positions[u as usize], a, b);
            let after = triangle_normal(to, a, b);
            let (n0, n1) = (dot(before, before), dot(after, after));
            let cosine = dot(before, after);
            if self.strict {
                if n0 > 0.0 && cosine <= most * (n0 * n1).sqrt() {
                    return None;
                }
            } else if cosine < 0.0 {
                penalty += if region.metric == Metric::Qem {
                    FLIP_PENALTY * dot(edge, edge) * n1.sqrt()
                } else {
                    dot(edge, edge).sqrt()
                };
            }
        }
        Some(penalty)
    }
}

/// Whether every wedge of a seam vertex `u` meets a wedge of `t` across a removed face, so the collapse runs along
/// the seam. A vertex with one wedge may collapse anywhere.
fn seams_allow(region: &Region, u: u32, t: u32) -> bool {
    let mut first = None;
    let mut seam = false;
    for corner in region.stars.corners(u) {
        let wedge = corner::at(&region.wedges, corner);
        match first {
            None => first = Some(wedge),
            Some(w) => seam |= w != wedge,
        }
    }
    !seam
        || region.stars.corners(u).all(|corner| {
            let wedge = corner::at(&region.wedges, corner);
            region.stars.corners(u).any(|other| {
                let (face, k) = (corner::face_of(other) as usize, corner::side_of(other));
                region.wedges[face][k] == wedge && region.corners[face].contains(&t)
            })
        })
}
