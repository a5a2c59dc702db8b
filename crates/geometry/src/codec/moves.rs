//! Moves of older vertices of a region: refinement of their positions to a finer grid.
//!
//! Coarse levels have coarse grids ([`crate::asset::base::Base::shifts`]): a vertex lies on the grid point near its
//! final position. The chunk that refines it to a finer grid codes the offsets before any split. Usually a vertex
//! moves to the level's own grid; one on the outline of all finer chunks moves to its final grid. Rounding moved it
//! along the surface more than across it, so the axis nearest the normal is coded last, predicted to keep the vertex
//! in the tangent plane.

use crate::codec::chunk_coder::{ChunkCoder, Resolution};
use crate::codec::fan::StarFace;
use crate::codec::local::Local;
use crate::codec::model::{MOVE_ACROSS, MOVE_ALONG, MOVE_REST, MOVE_STEPS, SHIFT, SHIFT_STEPS};
use crate::codec::position::axes;
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::{integer, tree, tree_contexts, unzigzag, zigzag};
use crate::error::DecodeError;
use crate::mesh::vec3::{Vec3, add, cross, sub};
use crate::numbers::{id32, truncated};

/// The vertex whose grid is coded.
#[derive(Clone, Copy)]
pub(crate) enum GridOwner {
    /// A new vertex.
    New,
    /// A vertex that moves.
    Moving,
}

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes the number of low bits of a vertex's cell that are zero, at most `most`.
    pub(crate) fn shift(&mut self, owner: GridOwner, most: u8, want: u8) -> u8 {
        for shift in (1..=most).rev() {
            let step = usize::from(most - shift).min(SHIFT_STEPS - 1);
            if !self.coder.bit(SHIFT + owner as usize * SHIFT_STEPS + step, want < shift) {
                return shift;
            }
        }
        0
    }

    /// Moves the region's existing vertices to their grids.
    pub(crate) fn moves(&mut self) -> Result<(), DecodeError> {
        let Resolution { bits, shift } = self.resolution;
        let mut star: Vec<StarFace> = Vec::new();
        // Vertices without faces come first, and are at their final positions.
        for v in self.local.added().vertices..id32(self.local.vertices.len()) {
            let vertex = &self.local.vertices[v as usize];
            let now = vertex.shift;
            if !vertex.interior || now == 0 {
                continue;
            }
            let want = self.guide.as_ref().and_then(|g| g.moving(v));
            let to = self.shift(GridOwner::Moving, now.min(shift), want.map_or(0, |m| m.shift));
            self.local.star(v, &mut star);
            let before = self.local.position(v).map(truncated);
            let normal = normal(&self.local, v, &star);
            let [a, b, c] = axes(normal);
            let steps = usize::from(now - to).min(MOVE_STEPS) * tree_contexts(4);
            let mut position = before;
            let mut guess = 0;
            for axis in [a, b, c] {
                let offset = want.map_or(0, |m| (m.cell[axis] - before[axis]) >> to);
                if axis == c && normal[c] != 0.0 {
                    let went = |k: usize| f64::from((position[k] - before[k]) >> to);
                    let third = -(normal[a] * went(a) + normal[b] * went(b)) / normal[c];
                    guess = truncated(third + if third < 0.0 { -0.5 } else { 0.5 });
                }
                let at = if axis == c { MOVE_ACROSS } else { MOVE_ALONG } + steps;
                let got = guess.wrapping_add(code_offset(self.coder, at, offset.wrapping_sub(guess)));
                position[axis] = before[axis].wrapping_add(got.wrapping_shl(to.into()));
                if position[axis] < 0 || position[axis] >= 1 << bits {
                    return Err(DecodeError::new("chunk", "a vertex moves off the grid"));
                }
            }
            self.coder.check()?;
            if to != now || position != before {
                self.local.move_vertex(v, &star, position, to);
            }
        }
        Ok(())
    }
}

/// Sum of the normals of a vertex's faces, weighted by area.
fn normal(local: &Local<'_>, v: u32, star: &[StarFace]) -> Vec3 {
    let at = local.position(v);
    star.iter()
        .fold([0.0; 3], |sum, s| add(sum, cross(sub(local.position(s.a), at), sub(local.position(s.b), at))))
}

/// Codes a number near zero; |value| < 2^30.
fn code_offset<C: Coder>(coder: &mut C, at: usize, value: i32) -> i32 {
    let offset = zigzag(value);
    if let Some(got) = coder.integer(at, 31, offset) {
        return unzigzag(got);
    }
    let low = tree(coder, at, 4, offset.min(15));
    let more = if low < 15 { 0 } else { integer(coder, MOVE_REST, offset.wrapping_sub(15) & 0x3fff_ffff) };
    unzigzag(low.wrapping_add(more))
}
