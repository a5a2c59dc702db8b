//! Samples of textures, a strip of rows at a time.

use super::error::TextureError;
use super::mip::Plane;

/// Rows of a strip: a tile's, so that memory is that of some rows of tiles.
pub(super) const STRIP_ROWS: u32 = 256;

/// Samples of `N` channels, from the top row on.
pub(super) trait Strips<const N: usize>: Send {
    /// Width and height.
    fn size(&self) -> [u32; 2];

    /// The next rows, at most [`STRIP_ROWS`]; none at the end.
    fn next(&mut self) -> Result<Vec<[u16; N]>, TextureError>;
}

/// A plane's rows.
pub(super) struct PlaneStrips<const N: usize> {
    plane: Plane<N>,
    read: usize,
}

impl<const N: usize> From<Plane<N>> for PlaneStrips<N> {
    fn from(plane: Plane<N>) -> Self {
        Self { plane, read: 0 }
    }
}

impl<const N: usize> PlaneStrips<N> {
    /// Goes back to the first row.
    pub(super) fn rewind(&mut self) {
        self.read = 0;
    }
}

impl<const N: usize> Strips<N> for PlaneStrips<N> {
    fn size(&self) -> [u32; 2] {
        [self.plane.width, self.plane.height]
    }

    fn next(&mut self) -> Result<Vec<[u16; N]>, TextureError> {
        let rest = &self.plane.samples[self.read..];
        let strip = &rest[..rest.len().min(self.plane.width as usize * STRIP_ROWS as usize)];
        self.read += strip.len();
        Ok(strip.to_vec())
    }
}
