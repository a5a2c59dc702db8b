//! Where the vertices that a level leaves come to lie: on a grid as coarse as the level's errors allow, each
//! at the point of that grid, among those near by, where its quadric is least.
//!
//! A vertex that stands for many needs few bits of its position, and which way it is rounded is free: the
//! grid's points about it lie on both sides of the surface that it stands for, so rounding by the quadric
//! loses less than rounding to the nearest, and often gains. What is left out comes with the chunk that
//! undoes the level (`codec/moves`).

use crate::collapse::Placed;
use crate::mesh::corner;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::vec3::{Vec3, add, cross, dot, length, scale, sub};
use crate::simplify::live::Live;

/// How strongly a vertex is held where it was, against the planes that it stands for: less lets more
/// vertices lie far off in the surface, which costs bits and gains nothing.
const HOLD: f64 = 0.1;
/// Cosine of the angle by which a face may turn, at least.
const LEAST_COSINE: f64 = 0.25;
/// A grid has this many bits per axis at least.
const LEAST_BITS: u8 = 4;
/// Most of the lowest bits that a grid leaves out.
pub(crate) const MAX_SHIFT: u8 = 15;

/// How vertices are brought to a coarser grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rounding {
    /// How many of the lowest bits of cells are left out.
    pub(crate) shift: u8,
    pub(crate) way: Placement,
}

/// How much vertices may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// To the best point of the grid near by.
    Best,
    /// To the nearest.
    Nearest,
    /// Not at all: each keeps the grid that it is on.
    Stay,
}

impl Rounding {
    /// The next to try where this does too much, on no finer grid than the one that leaves out `least` bits.
    pub(crate) fn gentler(self, least: u8) -> Option<Self> {
        match self {
            Self { shift, way: Placement::Best } if shift > least => Some(Self { shift: shift - 1, ..self }),
            Self { way: Placement::Best, .. } => Some(Self { way: Placement::Nearest, ..self }),
            Self { way: Placement::Nearest, .. } => Some(Self { way: Placement::Stay, ..self }),
            Self { way: Placement::Stay, .. } => None,
        }
    }
}

/// How many of the lowest bits the next coarser grid leaves out, where this one leaves out `shift`: its
/// points are as far apart as `share` of the median of the regions' errors, in cells.
pub(crate) fn coarser(live: &Live<'_>, shift: u8, share: f64, errors: &mut [f64]) -> u8 {
    errors.sort_unstable_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
    let most = live.bits().saturating_sub(LEAST_BITS).min(MAX_SHIFT);
    let fits = |shift: u8| f64::from(1_u32 << shift) <= share * median;
    (shift..most).find(|&s| !fits(s + 1)).unwrap_or(most.max(shift))
}

/// Where a vertex is, and where on the grid it comes to lie.
pub(crate) struct Move {
    pub(crate) from: Placed,
    pub(crate) to: Vec3,
}

/// Where on a grid those of the vertices inside a region that have faces come to lie, one after the other: each in view of
/// where those before it went. Nothing outside of the region moves that they look at.
pub(crate) fn place(live: &Live<'_>, vertices: &[u32], rounding: Rounding) -> Vec<Move> {
    let mut moves: Vec<Move> = Vec::new();
    let mut moved = SlotMap::with_room(vertices.len());
    let mut sides = Vec::new();
    for &v in vertices {
        if live.moved_to[v as usize] != v || live.stars.corners(v).next().is_none() {
            continue;
        }
        let before = live.positions[v as usize];
        let to = match rounding.way {
            Placement::Stay => before,
            Placement::Nearest => live.on_grid(before, rounding.shift),
            Placement::Best => {
                let now = |u: u32| moved.get(u).map_or(live.positions[u as usize], |i| moves[i as usize].to);
                sides.clear();
                sides.extend(live.stars.corners(v).map(|corner| {
                    let (of, k) =
                        (live.face_vertices[corner::face_of(corner) as usize], corner::side_of(corner));
                    [corner::next(k), corner::previous(k)].map(|side| now(of[side]))
                }));
                best(live, v, rounding.shift, &sides)
            }
        };
        moved.insert(v, moves.len() as u32);
        moves.push(Move { from: live.placed(v), to });
    }
    moves
}

/// The nearest point of the grid or, of the 26 around it, one where the quadric and the way there cost less. `sides` are the
/// other corners of the faces at the vertex.
fn best(live: &Live<'_>, v: u32, shift: u8, sides: &[[Vec3; 2]]) -> Vec3 {
    let before = live.positions[v as usize];
    let nearest = live.on_grid(before, shift);
    let quadric = &live.quadrics[v as usize];
    let weight = HOLD * quadric.weight();
    let cost = |x: Vec3| {
        let way = sub(x, before);
        quadric.evaluate(x) + weight * dot(way, way)
    };
    let (mut best, mut least) = (nearest, cost(nearest));
    for i in 0..27 {
        let step = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1].map(f64::from);
        let x = live.on_grid(add(nearest, scale(step, f64::from(1_u32 << shift))), shift);
        let c = cost(x);
        if c < least && upright(before, x, sides) {
            (best, least) = (x, c);
        }
    }
    best
}

/// Whether no face at a vertex turns far when the vertex goes from `p` to `x`.
fn upright(p: Vec3, x: Vec3, sides: &[[Vec3; 2]]) -> bool {
    sides.iter().all(|&[a, b]| {
        let (before, after) = (cross(sub(a, p), sub(b, p)), cross(sub(a, x), sub(b, x)));
        dot(before, after) > LEAST_COSINE * length(before) * length(after)
    })
}
