//! Textures of the city: plaster, facing bricks, ashlar, roof tiles, asphalt, paving. All of them tile, and are pale, since
//! materials tint them.

use crate::images::{Picture, Texel, blend, render, tint};
use crate::maths::smoothstep;
use crate::noise::{fractal2_tiling, uniform};

/// Texels per side.
const SIZE: u32 = 256;

fn texel(colour: [f64; 3]) -> Texel {
    Texel { height: 0.5, colour }
}

/// Plaster with faint stains.
fn plaster(seed: u64, u: f64, v: f64) -> Texel {
    let cloud = fractal2_tiling(seed, u, v, 4, 4);
    let grain = fractal2_tiling(seed ^ 1, u, v, 64, 2);
    texel(tint([0.96, 0.95, 0.93], 0.94 + 0.10 * cloud + 0.06 * grain))
}

/// Courses of stones or tiles in running bond. `counts` are stones along u and v, `joint` the joint's half width in
/// courses; stones have shades from `dark` to `light`.
fn courses(
    seed: u64,
    [u, v]: [f64; 2],
    counts: [f64; 2],
    joint: f64,
    [dark, light]: [[f64; 3]; 2],
    mortar: [f64; 3],
) -> Texel {
    let y = v * counts[1];
    let row = y.floor();
    let x = u * counts[0] + row.rem_euclid(2.0) * 0.5;
    let column = x.floor();
    let (fx, fy) = (x - column, y - row);
    let long = counts[1] / counts[0];
    let edge = (fx.min(1.0 - fx) * long).min(fy.min(1.0 - fy));
    let id = |k: i64| {
        let [columns, rows] = counts.map(|count| count as i64);
        uniform(seed, (column as i64).rem_euclid(columns), (row as i64).rem_euclid(rows), k)
    };
    let rough = fractal2_tiling(seed ^ 3, u, v, 32, 3);
    let stone = tint(blend(dark, light, id(1)), 0.93 + 0.12 * id(2) + 0.16 * rough);
    texel(blend(mortar, stone, smoothstep(joint * 0.6, joint * 1.4, edge)))
}

/// Overlapping tiles: each row shades the one below it.
fn tiles(seed: u64, u: f64, v: f64) -> Texel {
    let flat = courses(seed, [u, v], [8.0, 8.0], 0.03, [[0.72; 3], [0.96; 3]], [0.4; 3]);
    let (x, y) = (u * 8.0, v * 8.0);
    let along = y - y.floor();
    let across = (x + y.floor().rem_euclid(2.0) * 0.5) * 1.0;
    let round = across - across.floor() - 0.5;
    let light = (0.72 + 0.28 * smoothstep(0.0, 0.35, 1.0 - along)) * (1.0 - 0.7 * round * round);
    texel(tint(flat.colour, light))
}

fn asphalt(seed: u64, u: f64, v: f64) -> Texel {
    let patches = fractal2_tiling(seed, u, v, 3, 3);
    let grain = fractal2_tiling(seed ^ 5, u, v, 96, 1);
    texel(tint([0.86; 3], 0.9 + 0.16 * patches + 0.24 * grain))
}

/// The pictures by file name.
pub(super) fn all(seed: u64) -> Vec<(&'static str, Picture)> {
    let picture = |size: u32, texel: &dyn Fn(f64, f64) -> Texel| render(size, texel).0;
    let brick = |u: f64, v: f64| {
        courses(seed ^ 0xB, [u, v], [6.0, 20.0], 0.11, [[0.72, 0.66, 0.62], [1.0, 0.94, 0.88]], [0.88; 3])
    };
    let ashlar = |u: f64, v: f64| {
        courses(seed ^ 0xA, [u, v], [3.0, 6.0], 0.035, [[0.86, 0.84, 0.80], [0.98, 0.97, 0.94]], [0.62; 3])
    };
    let paving =
        |u: f64, v: f64| courses(seed ^ 0xF, [u, v], [4.0, 4.0], 0.03, [[0.80; 3], [0.96; 3]], [0.55; 3]);
    vec![
        ("plaster.png", picture(SIZE, &|u, v| plaster(seed ^ 0x1, u, v))),
        ("facing-brick.png", picture(SIZE, &brick)),
        ("ashlar.png", picture(SIZE, &ashlar)),
        ("roof-tiles.png", picture(SIZE, &|u, v| tiles(seed ^ 0x7, u, v))),
        ("asphalt.png", picture(SIZE, &|u, v| asphalt(seed ^ 0x5, u, v))),
        ("paving.png", picture(SIZE, &paving)),
    ]
}
