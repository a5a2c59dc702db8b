//! Procedural ground textures: sand, grass, hill rock, snow, and turf seen from near; each with a height map, all
//! seamless.
//!
//! Each is a few octaves of gradientless value noise (a lattice of hashed values, interpolated smoothly, periodic in the
//! texture) shaped to its material: ripples for sand, cracks for rock, drifts for snow; and, for grass, to tufts
//! with strokes over them, a blade each. Computed once per
//! process in integers and f32 without transcendental functions but the sRGB curve.

use std::sync::OnceLock;

use lodestream_geometry::pool::Pool;
use lodestream_threads::Threads;

/// Layers, in the order of the shader's weights.
pub(crate) const LAYERS: u32 = 5;
/// Texels along a side.
pub(crate) const SIDE: u32 = 256;
/// Mip levels, down to one texel.
pub(crate) const LEVELS: u32 = SIDE.ilog2() + 1;

/// Bytes of all mip levels of all layers.
pub(crate) const BYTES: u64 = {
    let (mut texels, mut side) = (0, SIDE as u64);
    while side > 0 {
        texels += side * side;
        side /= 2;
    }
    texels * LAYERS as u64 * 4
};

/// Texels of one layer: sRGB colour, and height as alpha.
type Layer = Vec<[f32; 4]>;

/// All mip levels of all layers in upload order: all levels of the first layer, then the next layer. RGBA: sRGB
/// colour, and height as alpha (1 is the surface). Computed on first use, each layer on its own thread.
pub(crate) fn texels() -> &'static [u8] {
    static TEXELS: OnceLock<Vec<u8>> = OnceLock::new();
    TEXELS.get_or_init(computed_texels)
}

fn computed_texels() -> Vec<u8> {
    let layers: Vec<OnceLock<Vec<u8>>> = (0..LAYERS).map(|_| OnceLock::new()).collect();
    Threads::each_task().run(layers.len(), &|layer| {
        layers[layer].get_or_init(|| mip_levels(layer as u32));
    });
    layers.into_iter().flat_map(|layer| layer.into_inner().unwrap_or_default()).collect()
}

/// All mip levels of a layer as bytes.
fn mip_levels(layer: u32) -> Vec<u8> {
    let mut bytes = Vec::with_capacity((BYTES / u64::from(LAYERS)) as usize);
    let mut texels = paint(layer);
    let mut side = SIDE;
    loop {
        for [r, g, b, h] in &texels {
            let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            bytes.extend([byte(srgb(*r)), byte(srgb(*g)), byte(srgb(*b)), byte(*h)]);
        }
        if side == 1 {
            return bytes;
        }
        texels = halved(&texels, side);
        side /= 2;
    }
}

/// Mean of two by two texels, in linear light.
fn halved(texels: &Layer, side: u32) -> Layer {
    let half = side / 2;
    let at = |x: u32, y: u32| texels[(y * side + x) as usize];
    (0..half * half)
        .map(|i| {
            let (x, y) = (2 * (i % half), 2 * (i / half));
            let four = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            [0, 1, 2, 3].map(|c| four.iter().map(|t| t[c]).sum::<f32>() * 0.25)
        })
        .collect()
}

/// Encoding curve of sRGB (IEC 61966-2-1).
fn srgb(x: f32) -> f32 {
    if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

fn paint(layer: u32) -> Layer {
    match layer {
        1 => return grass(),
        4 => return turf(),
        _ => {}
    }
    let mut texels: Layer = (0..SIDE * SIDE)
        .map(|i| {
            let (u, v) = ((i % SIDE) as f32 / SIDE as f32, (i / SIDE) as f32 / SIDE as f32);
            match layer {
                0 => sand(u, v),
                2 => rock(u, v),
                _ => snow(u, v),
            }
        })
        .collect();
    stretch(&mut texels);
    texels
}

/// Stretches heights to the whole of 0 to 1.
fn stretch(texels: &mut Layer) {
    let low = texels.iter().map(|t| t[3]).fold(f32::INFINITY, f32::min);
    let high = texels.iter().map(|t| t[3]).fold(f32::NEG_INFINITY, f32::max);
    for texel in texels {
        texel[3] = (texel[3] - low) / (high - low).max(1e-6);
    }
}

fn mix(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    [0, 1, 2].map(|i| a[i] + (b[i] - a[i]) * t.clamp(0.0, 1.0))
}

fn with_height([r, g, b]: [f32; 3], height: f32) -> [f32; 4] {
    [r, g, b, height]
}

/// Ripples that bend, with grains.
fn sand(u: f32, v: f32) -> [f32; 4] {
    let bend = octaves(u, v, 4, 3, 11) - 0.5;
    // A triangle wave across, rounded.
    let phase = (v * 14.0 + bend * 5.0).rem_euclid(1.0);
    let wave = smooth((phase * 2.0 - 1.0).abs());
    let grain = value(u, v, 128, 12);
    let tone = octaves(u, v, 3, 4, 13);
    let colour = mix([0.46, 0.37, 0.24], [0.62, 0.52, 0.36], 0.55 * tone + 0.2 * wave + 0.25 * grain);
    with_height(colour, 0.6 * wave + 0.25 * tone + 0.15 * grain)
}

/// Long blades over tufts, some dry.
fn grass() -> Layer {
    let places = (0..SIDE * SIDE).map(|i| ((i % SIDE) as f32 / SIDE as f32, (i / SIDE) as f32 / SIDE as f32));
    let mut texels: Layer =
        places.map(|(u, v)| with_height([0.055, 0.075, 0.025], 0.3 * octaves(u, v, 24, 3, 21))).collect();
    blades(&mut texels, 9000, [5.0, 12.0], [0.4, 0.8], 71, |u, v, chance| {
        let tuft = octaves(u, v, 24, 2, 21);
        let green = mix([0.065, 0.125, 0.028], [0.16, 0.245, 0.06], 0.6 * tuft + 0.5 * chance);
        mix(green, [0.24, 0.22, 0.09], (octaves(u, v, 5, 3, 23) - 0.55) * 0.9)
    });
    texels
}

/// Grass from near, blades of centimetres over their roots.
fn turf() -> Layer {
    let mut texels: Layer = vec![[0.05, 0.06, 0.022, 0.0]; (SIDE * SIDE) as usize];
    let tone = |_: f32, _: f32, chance: f32| mix([0.075, 0.125, 0.03], [0.17, 0.225, 0.06], chance);
    blades(&mut texels, 3000, [18.0, 44.0], [1.0, 1.9], 51, tone);
    texels
}

/// Strokes over what is there, the later the higher: blades that bend, widen a little and end in a point. Lengths and
/// half widths from and to, in texels; `tone` gives a blade's colour by where it stands and by chance.
fn blades(
    texels: &mut Layer,
    count: i32,
    lengths: [f32; 2],
    widths: [f32; 2],
    seed: u32,
    tone: impl Fn(f32, f32, f32) -> [f32; 3],
) {
    let side = SIDE as f32;
    for blade in 0..count {
        let chance = |which: u32| hashed(blade, 0, seed + which);
        let between = |[low, high]: [f32; 2], which| low + (high - low) * chance(which);
        let layer = blade as f32 / count as f32;
        let (mut x, mut y) = (chance(0) * side, chance(1) * side);
        // A direction without sines: a point of a square, moved to the unit circle.
        let (mut dx, mut dy) = unit(2.0 * chance(2) - 1.0, 2.0 * chance(3) - 1.0);
        let bend = (chance(4) - 0.5) * 2.0 / lengths[1];
        let (steps, width) = (between(lengths, 5), between(widths, 6));
        let tone = if chance(8) > 0.96 { [0.27, 0.24, 0.11] } else { tone(x / side, y / side, chance(7)) };
        for step in 0..steps as u32 {
            let along = step as f32 / steps;
            let half = width * (0.6 + 0.8 * along * (1.0 - along)) * (1.0 - along * along * along);
            // Darker at the root and at the sides, and where more lies above: that tells blades apart.
            let light = (0.45 + 0.65 * along) * (0.75 + 0.35 * layer);
            for k in -3..=3 {
                let off = k as f32 * 0.5;
                if off.abs() > half {
                    continue;
                }
                let shade = light * (1.1 - 0.3 * (off / half.max(0.5)).abs());
                let texel = |at: f32| at.rem_euclid(side) as u32 % SIDE;
                let at = texel(y + off * dx) * SIDE + texel(x - off * dy);
                let height = 0.25 + 0.75 * layer * (0.4 + 0.6 * along);
                texels[at as usize] = with_height(tone.map(|c| c * shade), height);
            }
            (x, y) = (x + dx, y + dy);
            (dx, dy) = unit(dx - bend * dy, dy + bend * dx);
        }
    }
    stretch(texels);
}

fn unit(x: f32, y: f32) -> (f32, f32) {
    let length = (x * x + y * y).sqrt().max(1e-3);
    (x / length, y / length)
}

/// Blocks with cracks between: the distance to the nearest and second nearest of scattered points (Worley 1996).
fn rock(u: f32, v: f32) -> [f32; 4] {
    let bend = (octaves(u, v, 6, 3, 31) - 0.5) * 0.07;
    let (near, second, cell) = worley(u + bend, v - bend, 9, 32);
    let crack = smooth(((second - near) * 3.2).min(1.0));
    let grain = octaves(u, v, 20, 4, 33);
    let height = crack * (0.45 + 0.35 * cell) + 0.3 * grain;
    let colour =
        mix([0.10, 0.095, 0.085], [0.34, 0.315, 0.28], 0.55 * grain + 0.3 * crack + 0.25 * cell - 0.1);
    with_height(colour, height)
}

/// Drifts.
fn snow(u: f32, v: f32) -> [f32; 4] {
    let drift = octaves(u, v, 4, 5, 41);
    let grain = value(u, v, 128, 42);
    with_height(
        mix([0.68, 0.73, 0.80], [0.88, 0.90, 0.92], 0.8 * drift + 0.2 * grain),
        0.9 * drift + 0.1 * grain,
    )
}

fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

/// Hash of a lattice point (the finaliser of MurmurHash3, 32 bits) as 0 to 1.
fn hashed(x: i32, y: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA77)
        ^ seed.wrapping_mul(0xC2B2_AE3D);
    h = (h ^ (h >> 16)).wrapping_mul(0x85EB_CA6B);
    h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
    (h ^ (h >> 16)) as f32 / u32::MAX as f32
}

/// Value noise of `cells` cells to a texture's width, 0 to 1.
fn value(u: f32, v: f32, cells: i32, seed: u32) -> f32 {
    let (x, y) = (u * cells as f32, v * cells as f32);
    let (fx, fy) = (smooth(x - x.floor()), smooth(y - y.floor()));
    let (x, y) = (x.floor() as i32, y.floor() as i32);
    let at = |dx: i32, dy: i32| hashed((x + dx).rem_euclid(cells), (y + dy).rem_euclid(cells), seed);
    let row = |dy: i32| at(0, dy) + (at(1, dy) - at(0, dy)) * fx;
    row(0) + (row(1) - row(0)) * fy
}

/// Octaves of value noise, each half as strong and twice as fine, 0 to 1.
fn octaves(u: f32, v: f32, cells: i32, count: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for octave in 0..count {
        sum += weight * value(u, v, cells << octave, seed.wrapping_add(octave * 101));
        total += weight;
        weight *= 0.5;
    }
    sum / total
}

/// Distances to the nearest and second nearest of one scattered point per cell, in cells, and a value of the nearest.
fn worley(u: f32, v: f32, cells: i32, seed: u32) -> (f32, f32, f32) {
    let (x, y) = (u * cells as f32, v * cells as f32);
    let (cx, cy) = (x.floor() as i32, y.floor() as i32);
    let (mut near, mut second, mut cell) = (f32::INFINITY, f32::INFINITY, 0.0);
    for dy in -1..=1 {
        for dx in -1..=1 {
            let (px, py) = ((cx + dx).rem_euclid(cells), (cy + dy).rem_euclid(cells));
            let sx = (cx + dx) as f32 + hashed(px, py, seed);
            let sy = (cy + dy) as f32 + hashed(px, py, seed + 1);
            let distance = ((sx - x) * (sx - x) + (sy - y) * (sy - y)).sqrt();
            if distance < near {
                (second, near, cell) = (near, distance, hashed(px, py, seed + 2));
            } else {
                second = second.min(distance);
            }
        }
    }
    (near, second, cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_seamless_and_fill_their_heights() {
        for layer in 0..LAYERS {
            let texels = paint(layer);
            let at = |x: u32, y: u32| texels[(y % SIDE * SIDE + x % SIDE) as usize];
            // Steps across the seam are no larger than those elsewhere.
            let step = |x: u32, y: u32, dx: u32, dy: u32| (at(x, y)[3] - at(x + dx, y + dy)[3]).abs();
            let largest = (0..SIDE * SIDE)
                .filter(|i| i % SIDE < SIDE - 1)
                .map(|i| step(i % SIDE, i / SIDE, 1, 0))
                .fold(0.0, f32::max);
            for i in 0..SIDE {
                assert!(step(SIDE - 1, i, 1, 0) <= largest && step(i, SIDE - 1, 0, 1) <= largest.max(0.6));
            }
            let heights: Vec<f32> = texels.iter().map(|t| t[3]).collect();
            assert!(heights.iter().all(|h| (0.0..=1.0).contains(h)));
            assert!(heights.iter().any(|&h| h > 0.999) && heights.iter().any(|&h| h < 0.001));
        }
    }

    #[test]
    fn mip_levels_are_all_there() {
        let texels: u32 = (0..LEVELS).map(|level| (SIDE >> level).pow(2)).sum();
        assert_eq!(BYTES, u64::from(LAYERS * texels * 4));
        assert_eq!(super::texels().len() as u64, BYTES);
    }
}
