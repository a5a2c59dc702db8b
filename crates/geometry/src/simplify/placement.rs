//! Placement of a level's remaining vertices on a grid as coarse as the level's errors allow, each at the nearby grid
//! point where its quadric is smallest.
//!
//! Coarse vertices need few position bits, and the direction of rounding is free: nearby grid points lie on both
//! sides of the surface, so rounding by quadric loses less than rounding to the nearest, and often gains. The chunk
//! that refines the level adds the omitted bits (`codec/moves`).

use crate::collapse::Placed;
use crate::mesh::corner;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::vec3::{Vec3, add, cross, dot, length, scale, sub};
use crate::simplify::live::Live;

/// Weight that holds a vertex in place against its quadric's planes: smaller values let vertices slide along the
/// surface, which costs bits without gain.
const HOLD_WEIGHT: f64 = 0.1;
/// Smallest cosine of the angle by which a face may turn.
const MIN_COSINE: f64 = 0.25;
/// Fewest bits per axis of a grid.
const MIN_BITS: u8 = 4;
/// Most low bits that a grid leaves out.
pub(crate) const MAX_SHIFT: u8 = 15;

/// Rounding of vertices to a coarser grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rounding {
    /// Low bits of cells that are left out.
    pub(crate) shift: u8,
    pub(crate) way: Placement,
}

/// How far vertices may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placement {
    /// To the best nearby grid point.
    Best,
    /// To the nearest grid point.
    Nearest,
    /// Not at all: vertices keep their grids.
    Stay,
}

impl Rounding {
    /// The next weaker rounding to try, on no finer grid than shift `least`.
    pub(crate) fn weaker(self, least: u8) -> Option<Self> {
        match self {
            Self { shift, way: Placement::Best } if shift > least => Some(Self { shift: shift - 1, ..self }),
            Self { way: Placement::Best, .. } => Some(Self { way: Placement::Nearest, ..self }),
            Self { way: Placement::Nearest, .. } => Some(Self { way: Placement::Stay, ..self }),
            Self { way: Placement::Stay, .. } => None,
        }
    }
}

/// The shift of the next coarser grid, at least `shift`: its spacing is `share` of the median of the regions' errors,
/// in cells.
pub(crate) fn coarser(live: &Live<'_>, shift: u8, share: f64, errors: &mut [f64]) -> u8 {
    errors.sort_unstable_by(f64::total_cmp);
    let median = errors.get(errors.len() / 2).copied().unwrap_or(0.0);
    let most = live.bits().saturating_sub(MIN_BITS).min(MAX_SHIFT);
    let fits = |shift: u8| f64::from(1_u32 << shift) <= share * median;
    (shift..most).find(|&s| !fits(s + 1)).unwrap_or(most.max(shift))
}

/// A vertex's position, and its new position on the grid.
pub(crate) struct Move {
    pub(crate) from: Placed,
    pub(crate) to: Vec3,
}

/// Places a region's interior vertices that have faces on a grid, one after the other, each with the earlier ones at
/// their new positions. Nothing outside the region moves meanwhile.
pub(crate) fn place(live: &Live<'_>, vertices: &[u32], rounding: Rounding) -> Vec<Move> {
    let mut moves: Vec<Move> = Vec::new();
    let mut moved = SlotMap::with_capacity(vertices.len());
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

/// The nearest grid point or one of the 26 around it, whichever has the lowest quadric plus distance cost. `sides`
/// are the other corners of the faces at the vertex.
fn best(live: &Live<'_>, v: u32, shift: u8, sides: &[[Vec3; 2]]) -> Vec3 {
    let before = live.positions[v as usize];
    let nearest = live.on_grid(before, shift);
    let quadric = &live.quadrics[v as usize];
    let weight = HOLD_WEIGHT * quadric.weight();
    let cost = |x: Vec3| {
        let way = sub(x, before);
        quadric.evaluate(x) + weight * dot(way, way)
    };
    let (mut best, mut least) = (nearest, cost(nearest));
    for i in 0..27 {
        let step = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1].map(f64::from);
        let x = live.on_grid(add(nearest, scale(step, f64::from(1_u32 << shift))), shift);
        let c = cost(x);
        if c < least && keeps_orientation(before, x, sides) {
            (best, least) = (x, c);
        }
    }
    best
}

/// Whether no face at a vertex turns too far when the vertex moves from `p` to `x`.
fn keeps_orientation(p: Vec3, x: Vec3, sides: &[[Vec3; 2]]) -> bool {
    sides.iter().all(|&[a, b]| {
        let (before, after) = (cross(sub(a, p), sub(b, p)), cross(sub(a, x), sub(b, x)));
        dot(before, after) > MIN_COSINE * length(before) * length(after)
    })
}
