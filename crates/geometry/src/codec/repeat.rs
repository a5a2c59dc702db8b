//! Codes that a coordinate of a new vertex equals a neighbour's, with
//! [`Codec::AxisAligned`](crate::entropy::Codec::AxisAligned). Geometry along the axes has many such vertices, on
//! flat parts and sharp edges, which a ring's shape does not predict.

use crate::codec::chunk_coder::ChunkCoder;
use crate::codec::fan::StarFace;
use crate::codec::model::{
    BEFORE, GAPS, MAX_REPEATED, MIX_REPEATS, MIX_WHICH, NOT_SHARERS, REPEATS_NEAR, REPEATS_SO_FAR,
    REPEATS_TILT, SHARERS, WHICH_GAPS, WHICH_REST, WHICH_SHARERS,
};
use crate::entropy::range_coder::Coder;
use crate::numbers::truncated;

/// Most distinct coordinates of neighbours considered: the first ones.
const MAX_SEEN: usize = 16;
/// One coordinate of a new vertex.
pub(crate) struct Coordinate {
    /// 0 to 2, in coding order.
    pub(crate) step: usize,
    pub(crate) axis: usize,
    /// Low bits that its grid leaves out.
    pub(crate) shift: u8,
    /// In cells of that grid.
    pub(crate) guess: i32,
    /// Root of the mean square distance of the ring from its mean, in cells of the finest grid; not zero.
    pub(crate) radius: f64,
    /// Absolute component of the ring's unit normal along the axis.
    pub(crate) normal_component: f64,
}

/// A coordinate shared by neighbours: their number, and the coordinate in cells.
type Shared = (usize, i32);

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes whether a coordinate is one of the four neighbours' coordinates nearest to the prediction, and which.
    /// `target` is the vertex that splits, `before` a bit per earlier coordinate that was repeated, `want` the
    /// coordinate to encode.
    pub(crate) fn repeated(
        &mut self,
        star: &[StarFace],
        target: u32,
        of: &Coordinate,
        before: &mut usize,
        want: Option<i32>,
    ) -> Option<i32> {
        let Coordinate { step, axis, shift, guess, .. } = *of;
        let mut seen: [Shared; MAX_SEEN] = [(0, 0); MAX_SEEN];
        let mut count = 0;
        let cell = |v: u32| truncated(self.local.position(v)[axis]) >> shift;
        for cell in star.iter().map(|star_face| cell(star_face.a)).chain([cell(target)]) {
            match seen[..count].iter_mut().find(|known| known.1 == cell) {
                Some(known) => known.0 += 1,
                None if count < MAX_SEEN => {
                    seen[count] = (1, cell);
                    count += 1;
                }
                None => {}
            }
        }
        let near = &mut seen[..count];
        near.sort_unstable_by_key(|&(_, cell)| (cell.abs_diff(guess), cell));
        let near = &near[..count.min(MAX_REPEATED)];
        let target = near.iter().position(|known| known.1 == cell(target)).unwrap_or(MAX_REPEATED);

        let gap = |(_, cell): Shared| {
            let distance = f64::from(cell.abs_diff(guess)) * f64::from(1_u32 << shift);
            // Nothing here is negative, so truncation rounds down.
            truncated((4.0 * distance / of.radius).min(8.0)).unsigned_abs() as usize
        };
        let second = near.get(1).copied();
        let (gap, next_gap) = (gap(near[0]), second.map_or(GAPS, gap));
        let (sharers, next_sharers) = (near[0].0.min(SHARERS), second.map_or(0, |s| s.0.min(SHARERS - 1)));
        let others = (star.len() + 1 - near[0].0.min(star.len() + 1)).min(NOT_SHARERS - 1);
        let tilt = truncated((of.normal_component * 8.0).min(7.0)).unsigned_abs() as usize;

        let at = want.and_then(|want| near.iter().position(|known| known.1 == want));
        let repeats = [
            REPEATS_SO_FAR + (step * BEFORE + *before) * 2 + usize::from(target == 0),
            REPEATS_TILT + tilt * NOT_SHARERS + others,
            REPEATS_NEAR + (gap * SHARERS + sharers - 1) * MAX_REPEATED + near.len() - 1,
        ];
        let which = [
            WHICH_SHARERS + ((sharers - 1) * SHARERS + next_sharers) * (MAX_REPEATED + 1) + target,
            WHICH_GAPS + gap * (GAPS + 1) + next_gap,
            WHICH_REST + others * BEFORE + *before,
        ];
        let repeats = self.coder.mix(repeats, MIX_REPEATS + step, at.is_some());
        *before = (*before * 2 + usize::from(repeats)) % BEFORE;
        if !repeats {
            return None;
        }
        let sizes = [SHARERS * SHARERS * (MAX_REPEATED + 1), GAPS * (GAPS + 1), NOT_SHARERS * BEFORE];
        let at = at.unwrap_or(0);
        let mut found = 0;
        while found + 1 < near.len() {
            let contexts = std::array::from_fn::<_, 3, _>(|i| which[i] + found * sizes[i]);
            if !self.coder.mix(contexts, MIX_WHICH + step, at > found) {
                break;
            }
            found += 1;
        }
        Some(near[found].1)
    }
}
