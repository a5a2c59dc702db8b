//! Heights without features or erosion: corners of patches, and what follows from them.

use super::Terrain;
use super::noise::LevelNoise;
use super::rect::Rect;
use super::refine::{Offsets, refine};
use super::window::{Buffers, descend};

impl Terrain {
    /// Heights without features or erosion of a rectangle of `level`, below 0 too.
    pub(super) fn base_window(&self, level: i8, rect: Rect, buffers: &mut Buffers<i32>, out: &mut Vec<i32>) {
        if level < 0 {
            return self.corners(rect, u32::from(level.unsigned_abs()), out);
        }
        descend(
            rect,
            0,
            level.unsigned_abs(),
            buffers,
            out,
            |rect, out| self.corners(rect, 0, out),
            |parent, level, out| {
                let noise = self.noise(level);
                if noise.is_gaussian() {
                    refine(parent, level, &Offsets::<true>(noise), out);
                } else {
                    refine(parent, level, &Offsets::<false>(noise), out);
                }
            },
        );
    }

    /// Every 2^`sparse`th corner of patches.
    fn corners(&self, rect: Rect, sparse: u32, out: &mut Vec<i32>) {
        out.clear();
        let noise = self.noise(0);
        for y in rect.y..=rect.bottom() {
            for x in rect.x..=rect.right() {
                out.push(self.parameters.base + noise.at(x << sparse, y << sparse));
            }
        }
    }

    pub(super) fn noise(&self, level: u8) -> &LevelNoise {
        &self.noise[usize::from(level)]
    }
}
