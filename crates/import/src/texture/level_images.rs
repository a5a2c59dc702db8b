//! The images of a level, as its rows arrive: itself, or its tiles.

use lodestream_scene::asset::{TILE_BORDER, TILE_SIDE, TextureKind, is_tiled, tile_grid, tile_size};

use super::mip::Plane;

/// Rows at the top that the lowest tiles' borders repeat, and of which the topmost tiles are made.
const TOP_ROWS: u32 = TILE_SIDE + TILE_BORDER;

/// Rows of a level of which images are still to be made.
pub(super) struct LevelImages<const N: usize> {
    size: [u32; 2],
    is_tiled: bool,
    /// The first [`TOP_ROWS`] of a tiled level.
    top: Vec<[u16; N]>,
    /// Rows of a whole level, or those that the next row of tiles needs; and the number of the first.
    held: Vec<[u16; N]>,
    first: u32,
    /// The next row of tiles. The topmost comes last: its borders continue at the bottom.
    next: u32,
}

impl<const N: usize> LevelImages<N> {
    pub(super) fn new(size: [u32; 2], kind: TextureKind) -> Self {
        let (top, held) = Default::default();
        Self { size, is_tiled: is_tiled(kind, size), top, held, first: 0, next: 1 }
    }

    /// Number of images.
    pub(super) fn count(&self) -> usize {
        if self.is_tiled { tile_grid(self.size).into_iter().product::<u32>() as usize } else { 1 }
    }

    /// The images that become complete with the next rows, and their numbers.
    pub(super) fn push(&mut self, rows: &[[u16; N]]) -> Vec<(usize, Plane<N>)> {
        let [width, height] = self.size;
        self.held.extend_from_slice(rows);
        let end = self.first + (self.held.len() / width as usize) as u32;
        if !self.is_tiled {
            let complete = end == height && !rows.is_empty();
            return complete
                .then(|| (0, Plane { width, height, samples: std::mem::take(&mut self.held) }))
                .into_iter()
                .collect();
        }
        let missing = (TOP_ROWS as usize * width as usize).saturating_sub(self.top.len());
        self.top.extend_from_slice(&rows[..rows.len().min(missing)]);
        let [_, tile_rows] = tile_grid(self.size);
        let mut images = Vec::new();
        while self.next < tile_rows {
            let below = ((self.next + 1) * TILE_SIDE).min(height) + TILE_BORDER;
            if end < below.min(height) {
                break;
            }
            images.extend(self.tiles(self.next));
            self.next += 1;
            let needed = (self.next * TILE_SIDE - TILE_BORDER).min(height.saturating_sub(TILE_BORDER));
            let needed = needed.clamp(self.first, end);
            self.held.drain(..(needed - self.first) as usize * width as usize);
            self.first = needed;
        }
        if end == height && !rows.is_empty() {
            images.extend(self.tiles(0));
        }
        images
    }

    /// A row of tiles with their borders, which continue at the opposite edge.
    fn tiles(&self, row: u32) -> Vec<(usize, Plane<N>)> {
        let [columns, _] = tile_grid(self.size);
        let tile = |column| ((row * columns + column) as usize, self.tile([column, row]));
        (0..columns).map(tile).collect()
    }

    fn tile(&self, place: [u32; 2]) -> Plane<N> {
        let [width, height] = tile_size(self.size, place[0], place[1]);
        let [left, top] = place.map(|at| at * TILE_SIDE);
        let wrapped = |at: u32, side: u32| ((at + side * TILE_BORDER) - TILE_BORDER) % side;
        let columns = left..left + width;
        let mut samples = Vec::with_capacity(width as usize * height as usize);
        for y in top..top + height {
            let row = self.row(wrapped(y, self.size[1]));
            samples.extend(columns.clone().map(|x| row[wrapped(x, self.size[0]) as usize]));
        }
        Plane { width, height, samples }
    }

    fn row(&self, y: u32) -> &[[u16; N]] {
        let width = self.size[0] as usize;
        let (rows, first) = if y < TOP_ROWS { (&self.top, 0) } else { (&self.held, self.first) };
        &rows[(y - first) as usize * width..][..width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_the_same_from_strips_of_any_height() {
        for [width, height] in [[300, 1], [1, 700], [700, 257], [20, 1030], [513, 512], [260, 515]] {
            let at = |x: u32, y: u32| [(y * width + x) as u16, y as u16];
            let samples: Vec<_> = (0..height).flat_map(|y| (0..width).map(move |x| at(x, y))).collect();
            for strip in [1, 2, 255, 256, 300, 2000] {
                let mut level = LevelImages::<2>::new([width, height], TextureKind::Color);
                let strips = samples.chunks(width as usize * strip);
                let mut images: Vec<_> = strips.flat_map(|rows| level.push(rows)).collect();
                images.sort_by_key(|(number, _)| *number);
                let [columns, rows] = tile_grid([width, height]);
                assert_eq!((images.len(), level.count()), ((columns * rows) as usize, images.len()));
                for (i, (number, image)) in images.iter().enumerate() {
                    assert_eq!(i, *number);
                    let (column, row) = (i as u32 % columns, i as u32 / columns);
                    assert_eq!([image.width, image.height], tile_size([width, height], column, row));
                    let opposite = |at: u32, tile: u32, side: u32| {
                        (i64::from(at + tile * TILE_SIDE) - i64::from(TILE_BORDER)).rem_euclid(side.into())
                            as u32
                    };
                    for (j, sample) in (0..).zip(&image.samples) {
                        let (x, y) = (j % image.width, j / image.width);
                        let wanted = at(opposite(x, column, width), opposite(y, row, height));
                        assert_eq!(*sample, wanted, "tile {i}, {x} {y}; strips of {strip}");
                    }
                }
            }
        }
    }

    #[test]
    fn small_levels_and_heights_are_one_image() {
        for (size, kind) in [([256, 3], TextureKind::Color), ([300, 300], TextureKind::Height)] {
            let mut level = LevelImages::<1>::new(size, kind);
            let row = vec![[7]; size[0] as usize];
            let images: Vec<_> = (0..size[1]).flat_map(|_| level.push(&row)).collect();
            assert_eq!((images.len(), level.count()), (1, 1));
            assert_eq!([images[0].1.width, images[0].1.height], size);
        }
    }
}
