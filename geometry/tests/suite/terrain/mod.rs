//! Terrain: the same bits wherever, in whatever order and piece they are made.

mod agreement;

use lodestream_geometry::terrain::{Parameters, Scratch, Terrain};

/// A window's heights.
fn window(terrain: &Terrain, level: i8, x: i64, y: i64, width: usize, height: usize) -> Vec<i32> {
    let mut out = Vec::new();
    terrain.window(level, x, y, width, height, &mut Scratch::new(), &mut out).unwrap();
    out
}

/// A terrain of `finest_level` in a world of 2^10 patches each way.
fn parameters(seed: u64, finest_level: u8) -> Parameters {
    Parameters { seed, finest_level, extent_log2: 10, amplitude: 100_000, ..Parameters::default() }
}
