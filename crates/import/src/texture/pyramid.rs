//! Mip levels and their images, from fine to coarse, as rows arrive (Williams, "Pyramidal parametrics", 1983).

use lodestream_scene::asset::TextureKind;

use super::level_images::LevelImages;
use super::mip::{Average, Halving, Plane, half};

/// Halving stops at a level whose longer side is at most this: smaller levels cost a message each
/// and save nothing, since an 8 × 8 level is about 200 bytes.
const COARSEST_SIDE_PX: u32 = 8;

/// Width and height of each level, fine first.
pub(super) fn level_sizes(size: [u32; 2]) -> impl Iterator<Item = [u32; 2]> {
    std::iter::successors(Some(size), |&[width, height]| {
        (width.max(height) > COARSEST_SIDE_PX).then(|| half([width, height]))
    })
}

/// A level of which rows arrive.
pub(super) struct LevelRows<const N: usize> {
    pub(super) images: LevelImages<N>,
    halving: Halving<N>,
}

/// All levels, fine first.
pub(super) struct Pyramid<const N: usize> {
    pub(super) levels: Vec<LevelRows<N>>,
}

/// An image to encode.
pub(super) struct Image<const N: usize> {
    /// Its level, from the finest.
    pub(super) level: usize,
    /// Its number within the level.
    pub(super) number: usize,
    pub(super) plane: Plane<N>,
}

impl<const N: usize> Pyramid<N> {
    pub(super) fn new(size: [u32; 2], kind: TextureKind) -> Self {
        let level = |size| LevelRows { images: LevelImages::new(size, kind), halving: Halving::new(size) };
        Self { levels: level_sizes(size).map(level).collect() }
    }

    /// The images that become complete with the next rows of the finest level.
    pub(super) fn push<A: Average<N>>(&mut self, rows: &[[u16; N]]) -> Vec<Image<N>> {
        let mut images = Vec::new();
        let mut rows = rows.to_vec();
        for (level, of) in self.levels.iter_mut().enumerate() {
            let complete = of.images.push(&rows).into_iter();
            images.extend(complete.map(|(number, plane)| Image { level, number, plane }));
            rows = of.halving.push::<A>(&rows);
        }
        images
    }
}
