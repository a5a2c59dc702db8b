//! The sets of texture coordinates of a source mesh, and their grids.

use crate::mesh::{Corner, NONE, SourceMesh, UvGrid};
use crate::numbers::truncated;

/// A set of texture coordinates.
#[derive(Clone, Copy)]
pub(super) struct UvSet<'a> {
    uvs: &'a [[f32; 2]],
    index: fn(&Corner) -> u32,
}

impl<'a> UvSet<'a> {
    /// The first and the second set.
    pub(super) fn both(source: &'a SourceMesh) -> [Self; 2] {
        [
            Self { uvs: &source.uvs, index: |corner| corner.uv },
            Self { uvs: &source.second_uvs, index: |corner| corner.second_uv },
        ]
    }

    fn of(&self, corner: &Corner) -> Option<[f64; 2]> {
        let index = (self.index)(corner);
        (index != NONE).then(|| self.uvs[index as usize].map(f64::from))
    }

    /// The grid that holds the set at the kept faces; without bits if none of them has it.
    pub(super) fn grid(&self, source: &SourceMesh, kept: &[usize], bits: u8) -> UvGrid {
        if self.uvs.is_empty() {
            return UvGrid::NONE;
        }
        let mut min = [f64::INFINITY; 2];
        let mut max = [f64::NEG_INFINITY; 2];
        for uv in kept.iter().flat_map(|&face| &source.faces[face]).filter_map(|corner| self.of(corner)) {
            for axis in 0..2 {
                min[axis] = min[axis].min(uv[axis]);
                max[axis] = max[axis].max(uv[axis]);
            }
        }
        if min[0] > max[0] {
            return UvGrid::NONE;
        }
        let cells = f64::from((1_u32 << bits) - 1);
        UvGrid { origin: min, step: [0, 1].map(|axis| (max[axis] - min[axis]) / cells), bits }
    }

    /// A corner's point of the set's grid; 0 for one without.
    pub(super) fn snapped(&self, grid: &UvGrid, corner: &Corner) -> [i32; 2] {
        self.of(corner).map_or([0; 2], |uv| snap(grid, uv))
    }
}

fn snap(grid: &UvGrid, uv: [f64; 2]) -> [i32; 2] {
    let top = f64::from((1_u32 << grid.bits) - 1);
    [0, 1].map(|axis| {
        if grid.step[axis] == 0.0 {
            0
        } else {
            truncated(((uv[axis] - grid.origin[axis]) / grid.step[axis]).round().clamp(0.0, top))
        }
    })
}
