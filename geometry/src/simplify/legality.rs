//! Which collapses are allowed.
//!
//! *Strict* rules keep the surface's kind: the link condition (Dey, Edelsbrunner, Guha and Nekhayev,
//! "Topology preserving edge contraction", 1999), boundaries collapse along themselves, seam vertices
//! along their seam, no face turns by more than 75°. *Relaxed* rules, for what strict ones leave
//! behind, allow what can be written down and gives no edge more faces than two (or than the input
//! gave it): holes close, components vanish, seams shorten; faces that turn over cost extra. A closed
//! manifold therefore stays one, down to nothing.

use crate::simplify::region::Region;
use crate::vec3::{dot, sub, triangle_normal};

/// Cosine of the largest angle by which a face may turn under the strict rules: 75°.
const MAX_TURN_COS: f64 = 0.258_819_045_102_520_76;
/// Cost of turning a face over under the relaxed rules, per (edge length)² × area.
const FLIP_PENALTY: f64 = 0.5;

/// A set of rules, with scratch space for applying them.
pub(crate) struct Rules {
    strict: bool,
    ring_u: Vec<u32>,
    ring_t: Vec<u32>,
    spokes: Vec<u32>,
    star_faces: Vec<u32>,
}

impl Rules {
    pub(crate) fn strict() -> Self {
        Self {
            strict: true,
            ring_u: Vec::new(),
            ring_t: Vec::new(),
            spokes: Vec::new(),
            star_faces: Vec::new(),
        }
    }

    pub(crate) fn relaxed() -> Self {
        Self { strict: false, ..Self::strict() }
    }

    /// What collapsing `u` onto `t` costs beyond its quadric, or `None` where it is not allowed.
    pub(crate) fn penalty(&mut self, region: &Region, u: u32, t: u32) -> Option<f64> {
        let mut removed = 0;
        self.spokes.clear();
        self.star_faces.clear();
        for corner in region.stars.corners(u) {
            let (face, k) = ((corner / 3) as usize, (corner % 3) as usize);
            let corners = region.corners[face];
            self.spokes.extend([corners[(k + 1) % 3], corners[(k + 2) % 3]]);
            self.star_faces.push(corner / 3);
            removed += usize::from(corners.contains(&t));
        }
        if removed == 0 {
            return None;
        }
        self.spokes.sort_unstable();
        if self.strict {
            self.strict_topology(region, t, removed)?;
            if !seams_allow(region, u, t) {
                return None;
            }
        } else {
            representable(region, u, t)?;
            self.edges_stay_thin(region, t)?;
        }
        self.turning(region, u, t)
    }

    fn strict_topology(&mut self, region: &Region, t: u32, removed: usize) -> Option<()> {
        // Spokes: each neighbour once per face that joins it to u; an inner edge has two faces.
        self.ring_u.clear();
        let mut boundary = false;
        for run in self.spokes.chunk_by(|a, b| a == b) {
            self.ring_u.push(run[0]);
            match run.len() {
                1 => boundary = true,
                2 => {}
                _ => return None,
            }
        }
        let mut ring_t = std::mem::take(&mut self.ring_t);
        region.ring(t, &mut ring_t);
        let common = self.ring_u.iter().filter(|v| ring_t.binary_search(v).is_ok()).count();
        let enough = self.ring_u.len() >= 3 && ring_t.len() >= 3;
        self.ring_t = ring_t;
        let along = removed == if boundary { 1 } else { 2 };
        (enough && along && common == removed).then_some(())
    }

    /// No edge (t, w) of the result has more than two faces, unless one that it comes from had as many.
    fn edges_stay_thin(&self, region: &Region, t: u32) -> Option<()> {
        for run in self.spokes.chunk_by(|a, b| a == b) {
            let (w, at_u) = (run[0], run.len());
            if w == t {
                continue;
            }
            let (mut at_t, mut removed) = (0, 0);
            for corner in region.stars.corners(w) {
                let face = region.corners[(corner / 3) as usize];
                at_t += usize::from(face.contains(&t));
                removed += usize::from(face.contains(&t) && self.star_faces.contains(&(corner / 3)));
            }
            let after = at_u + at_t - 2 * removed;
            if at_t > 0 && after > 2 && after > at_u && after > at_t {
                return None;
            }
        }
        Some(())
    }

    fn turning(&self, region: &Region, u: u32, t: u32) -> Option<f64> {
        let to = region.positions[t as usize];
        let edge = sub(region.positions[u as usize], to);
        let mut penalty = 0.0;
        for corner in region.stars.corners(u) {
            let (face, k) = ((corner / 3) as usize, (corner % 3) as usize);
            let corners = region.corners[face];
            if corners.contains(&t) {
                continue;
            }
            let a = region.positions[corners[(k + 1) % 3] as usize];
            let b = region.positions[corners[(k + 2) % 3] as usize];
            let before = triangle_normal(region.positions[u as usize], a, b);
            let after = triangle_normal(to, a, b);
            let (n0, n1) = (dot(before, before), dot(after, after));
            let cosine = dot(before, after);
            if self.strict {
                if n0 > 0.0 && cosine <= MAX_TURN_COS * (n0 * n1).sqrt() {
                    return None;
                }
            } else if cosine < 0.0 {
                penalty += FLIP_PENALTY * dot(edge, edge) * n1.sqrt();
            }
        }
        Some(penalty)
    }
}

/// Whether every wedge of a seam vertex `u` meets a wedge of `t` across a removed face, so that the
/// collapse runs along the seam. A vertex with one wedge may go anywhere.
fn seams_allow(region: &Region, u: u32, t: u32) -> bool {
    let mut first = None;
    let mut seam = false;
    for corner in region.stars.corners(u) {
        let wedge = region.wedges[(corner / 3) as usize][(corner % 3) as usize];
        match first {
            None => first = Some(wedge),
            Some(w) => seam |= w != wedge,
        }
    }
    !seam
        || region.stars.corners(u).all(|corner| {
            let wedge = region.wedges[(corner / 3) as usize][(corner % 3) as usize];
            region.stars.corners(u).any(|other| {
                let (face, k) = ((other / 3) as usize, (other % 3) as usize);
                region.wedges[face][k] == wedge && region.corners[face].contains(&t)
            })
        })
}

/// The third vertex of a removed face must be addressable by the split that brings it back: inside
/// the region, or still a neighbour of `t`.
fn representable(region: &Region, u: u32, t: u32) -> Option<()> {
    for corner in region.stars.corners(u) {
        let face = region.corners[(corner / 3) as usize];
        if !face.contains(&t) {
            continue;
        }
        let Some(x) = face.into_iter().find(|&v| v != u && v != t) else { continue };
        let joined = |face: &[u32; 3]| face.contains(&x) && (face.contains(&u) != face.contains(&t));
        let still = region.interior[x as usize]
            || region.stars.corners(x).any(|c| joined(&region.corners[(c / 3) as usize]));
        if !still {
            return None;
        }
    }
    Some(())
}
