//! The scene's textures: colours and the height maps that relief mapping reads. All of them tile.

use super::maths::{mix, smoothstep};
use super::noise::{cells2_tiling, fractal2_tiling, uniform};
use std::io::{self, BufWriter};
use std::path::Path;

/// A picture of one or three 8-bit channels.
pub(super) struct Picture {
    pub(super) size: u32,
    pub(super) channels: usize,
    pub(super) pixels: Vec<u8>,
}

/// Height and colour at a point of the unit square.
pub(super) struct Texel {
    pub(super) height: f64,
    pub(super) colour: [f64; 3],
}

fn byte(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5).floor() as u8
}

/// Renders colour and height over `size`² texels; row 0 is the top, v = 1, as OBJ has it.
pub(super) fn render(size: u32, texel: impl Fn(f64, f64) -> Texel) -> (Picture, Picture) {
    let area = size as usize * size as usize;
    let mut colour = Picture { size, channels: 3, pixels: Vec::with_capacity(area * 3) };
    let mut height = Picture { size, channels: 1, pixels: Vec::with_capacity(area) };
    for y in 0..size {
        for x in 0..size {
            let u = (f64::from(x) + 0.5) / f64::from(size);
            let v = 1.0 - (f64::from(y) + 0.5) / f64::from(size);
            let texel = texel(u, v);
            colour.pixels.extend(texel.colour.map(byte));
            height.pixels.push(byte(texel.height));
        }
    }
    (colour, height)
}

pub(super) fn tint(colour: [f64; 3], light: f64) -> [f64; 3] {
    colour.map(|c| c * light)
}

pub(super) fn blend(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    [mix(a[0], b[0], t), mix(a[1], b[1], t), mix(a[2], b[2], t)]
}

/// Courses of weathered bricks in running bond, 4 × 8 per repeat.
fn brick(seed: u64, u: f64, v: f64) -> Texel {
    let wobble = 0.012 * fractal2_tiling(seed, u, v, 8, 2);
    let y = (v + wobble) * 8.0;
    let row = y.floor();
    let odd = row.rem_euclid(2.0) * 0.5;
    let x = (u + 0.5 * wobble) * 4.0 + odd;
    let column = x.floor();
    let (fx, fy) = (x - column, y - row);
    // Distance to the joint, in units of a course's height; a brick is twice as wide as high.
    let joint = (fx.min(1.0 - fx) * 2.0).min(fy.min(1.0 - fy));
    let id = |k| uniform(seed, (column as i64).rem_euclid(4), (row as i64).rem_euclid(8), k);
    let face = smoothstep(0.035, 0.15, joint);
    let rough = fractal2_tiling(seed ^ 21, u, v, 32, 3);
    let height = face * (0.72 + 0.2 * id(1)) + 0.08 * rough + 0.1;
    let clay = blend([0.60, 0.40, 0.29], [0.74, 0.58, 0.42], id(2));
    let clay = tint(clay, 0.9 + 0.22 * id(3) + 0.25 * rough);
    let mortar = tint([0.63, 0.60, 0.54], 0.9 + 0.3 * rough);
    Texel { height, colour: blend(mortar, clay, smoothstep(0.03, 0.08, joint)) }
}

/// Rounded field stones with sandy joints, 7 × 7 per repeat.
fn cobble(seed: u64, u: f64, v: f64) -> Texel {
    let cell = cells2_tiling(seed, u, v, 7, 0.62);
    let edge = cell.second - cell.nearest;
    let rough = fractal2_tiling(seed ^ 22, u, v, 28, 4);
    let dome = smoothstep(0.02, 0.42, edge);
    let id = (cell.id >> 40) as f64 / f64::from(1 << 24);
    let warm = (cell.id >> 12 & 0xFFF) as f64 / 4096.0;
    let height = 0.06 + dome.sqrt() * (0.66 + 0.2 * id) + 0.08 * rough;
    let stone = blend([0.47, 0.46, 0.45], [0.62, 0.55, 0.46], warm);
    let stone = tint(stone, 0.78 + 0.34 * id + 0.3 * rough);
    let sand = tint([0.40, 0.34, 0.26], 0.9 + 0.4 * rough);
    Texel { height, colour: blend(sand, stone, smoothstep(0.02, 0.1, edge)) }
}

/// Pale limestone with faint veins.
fn stone(seed: u64, u: f64, v: f64) -> Texel {
    let warp = 0.11 * fractal2_tiling(seed ^ 23, u, v, 3, 3);
    let vein = fractal2_tiling(seed ^ 24, u + warp, v - warp, 4, 3).abs();
    let grain = fractal2_tiling(seed ^ 25, u, v, 48, 3);
    let cloud = fractal2_tiling(seed ^ 26, u, v, 3, 4);
    let base = blend([0.74, 0.70, 0.62], [0.86, 0.83, 0.76], 0.5 + 0.7 * cloud);
    let colour = tint(base, 0.86 + 0.14 * smoothstep(0.0, 0.06, vein) + 0.10 * grain);
    Texel { height: 0.5 + 0.5 * grain, colour }
}

/// The scene's pictures by file name. Brick and cobble have `size` / 2 texels per side, plain stone `size` / 4.
pub(super) fn all(seed: u64, size: u32) -> Vec<(&'static str, Picture)> {
    let half = (size / 2).max(8);
    let (brick_colour, brick_height) = render(half, |u, v| brick(seed ^ 0xB1, u, v));
    let (cobble_colour, cobble_height) = render(half, |u, v| cobble(seed ^ 0xC0, u, v));
    let (stone_colour, _) = render((size / 4).max(8), |u, v| stone(seed ^ 0x57, u, v));
    vec![
        ("brick.png", brick_colour),
        ("brick_height.png", brick_height),
        ("cobble.png", cobble_colour),
        ("cobble_height.png", cobble_height),
        ("stone.png", stone_colour),
    ]
}

/// Writes `picture` as PNG.
pub(super) fn write(path: &Path, picture: &Picture) -> io::Result<()> {
    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    use image::{ExtendedColorType, ImageEncoder};
    let out = BufWriter::new(std::fs::File::create(path)?);
    let colour = if picture.channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
    PngEncoder::new_with_quality(out, CompressionType::Default, FilterType::Adaptive)
        .write_image(&picture.pixels, picture.size, picture.size, colour)
        .map_err(io::Error::other)
}
