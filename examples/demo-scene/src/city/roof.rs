//! Roofs: pitched with dormers and chimneys, or flat with a parapet. A roof's origin is the middle of the building at
//! the height of the eaves, with the street towards +z.

use glam::{DVec2, DVec3};

use super::facade::{REVEAL, Style};
use super::materials::{Material, named};
use super::part::Part;

/// How far a pitched roof reaches over the walls.
const EAVES: f64 = 0.5;

/// Height above the eaves of a roof that rises by `pitch`, at depth z of a building `depth` deep.
fn height_at(z: f64, depth: f64, pitch: f64) -> f64 {
    (depth * 0.5 - z.abs()) * pitch
}

/// Two slopes with a ridge along the street; between neighbours, so it ends flush with the walls.
pub(super) fn pitched(style: &Style, width: f64, depth: f64, pitch: f64) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    let reach = depth * 0.5 + EAVES;
    let (eave, ridge) = (height_at(reach, depth, pitch), height_at(0.0, depth, pitch));
    let lift = 0.12;
    for side in [1.0, -1.0] {
        let at = |x: f64, y: f64, z: f64| DVec3::new(side * x, y, side * z);
        let (low, high) = (eave + lift, ridge + lift);
        part.polygon(
            style.roof,
            &[at(-half, low, reach), at(half, low, reach), at(half, high, 0.0), at(-half, high, 0.0)],
        );
        // The edge and underside of the eaves.
        let edge =
            [at(-half, eave, reach), at(half, eave, reach), at(half, low, reach), at(-half, low, reach)];
        part.polygon(style.trim, &edge);
        let wall = depth * 0.5;
        let under =
            [at(half, eave, reach), at(-half, eave, reach), at(-half, 0.0, wall), at(half, 0.0, wall)];
        part.polygon(style.trim, &under);
    }
    // A gutter along the street, and the ridge's capping.
    let gutter = [(0.0, -0.02), (0.1, -0.02), (0.15, 0.03), (0.15, 0.1), (0.0, 0.1)];
    let ends = |y: f64, z: f64| [DVec3::new(-half, y, z), DVec3::new(half, y, z)];
    part.moulding(named("zinc"), ends(eave, reach), DVec3::Z, &gutter);
    let cap = [(0.16, -0.06), (0.1, 0.08), (-0.1, 0.08), (-0.16, -0.06)];
    part.moulding(style.roof, ends(ridge + lift, 0.0), DVec3::Z, &cap);
    part
}

/// The gable that closes a pitched roof over a wall, at x = 0, facing +x.
pub(super) fn gable(material: Material, depth: f64, pitch: f64) -> Part {
    let mut part = Part::default();
    let half = depth * 0.5;
    let at = |y: f64, z: f64| DVec3::new(0.0, y, z);
    part.polygon(material, &[at(0.0, half), at(0.0, -half), at(height_at(0.0, depth, pitch) + 0.1, 0.0)]);
    part
}

/// A flat roof with a parapet and its coping.
pub(super) fn flat(style: &Style, width: f64, depth: f64) -> Part {
    let mut part = Part::default();
    let (x, z, y) = (width * 0.5, depth * 0.5, 0.9);
    let at = |x: f64, z: f64| DVec3::new(x, 0.08, z);
    part.polygon(named("gravel"), &[at(-x, z), at(x, z), at(x, -z), at(-x, -z)]);
    let t = 0.25;
    let walls =
        [[-x, -z, x, -z + t], [-x, z - t, x, z], [-x, -z + t, -x + t, z - t], [x - t, -z + t, x, z - t]];
    for [x0, z0, x1, z1] in walls {
        part.cuboid(style.wall, DVec3::new(x0, 0.0, z0), DVec3::new(x1, y, z1));
        let (low, high) = (DVec3::new(x0 - 0.06, y, z0 - 0.06), DVec3::new(x1 + 0.06, y + 0.08, z1 + 0.06));
        part.cuboid(style.trim, low, high);
    }
    part
}

/// A dormer on a roof that rises by `pitch`: cheeks, a gabled roof, a window. Its origin is the middle of the foot of its
/// front. It has four materials, as many as a mesh of a batch may have.
pub(super) fn dormer(style: &Style, pitch: f64) -> Part {
    let mut part = Part::default();
    let (half, wall, peak) = (0.75, 1.45, 2.05);
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    let back = |y: f64| -y / pitch;
    let glass = [DVec2::new(-0.48, 0.25), DVec2::new(0.48, 1.4)];
    // The front around the window.
    part.panel(style.wall, DVec2::new(-half, 0.0), DVec2::new(half, glass[0].y), 0.0);
    part.panel(style.wall, DVec2::new(-half, glass[0].y), DVec2::new(glass[0].x, wall), 0.0);
    part.panel(style.wall, DVec2::new(glass[1].x, glass[0].y), DVec2::new(half, wall), 0.0);
    part.polygon(style.wall, &[at(-half, wall, 0.0), at(half, wall, 0.0), at(0.0, peak, 0.0)]);
    part.panel(named("glass"), glass[0], glass[1], -0.05);
    for [l, h] in [
        [[-0.48, 0.25], [-0.42, 1.45]],
        [[0.42, 0.25], [0.48, 1.45]],
        [[-0.42, 0.25], [0.42, 0.31]],
        [[-0.42, 1.39], [0.42, 1.45]],
        [[-0.025, 0.31], [0.025, 1.39]],
        [[-0.42, 0.95], [0.42, 0.99]],
    ] {
        part.on_wall(style.frame, at(l[0], l[1], -0.05), at(h[0], h[1], 0.03));
    }
    for side in [-1.0, 1.0] {
        let x = side * half;
        let cheek = [at(x, 0.0, 0.0), at(x, wall, back(wall)), at(x, wall, 0.0)];
        let cheek = if side > 0.0 { cheek } else { [cheek[0], cheek[2], cheek[1]] };
        part.polygon(style.roof, &cheek);
        // Roof slopes with a little overhang.
        let (out, low, front) = (side * (half + 0.16), wall - 0.12, 0.22);
        let slope = [
            at(out, low, front),
            at(out, low, back(low)),
            at(0.0, peak + 0.06, back(peak + 0.06)),
            at(0.0, peak + 0.06, front),
        ];
        let slope = if side > 0.0 { slope } else { [slope[3], slope[2], slope[1], slope[0]] };
        part.polygon(style.roof, &slope);
        let board = [
            at(0.0, peak - 0.08, front),
            at(out, low - 0.1, front),
            at(out, low, front),
            at(0.0, peak + 0.06, front),
        ];
        let board = if side > 0.0 { board } else { [board[3], board[2], board[1], board[0]] };
        part.polygon(style.frame, &board);
    }
    part.moulding(
        style.frame,
        [at(-0.6, 0.14, 0.0), at(0.6, 0.14, 0.0)],
        DVec3::Z,
        &[(0.0, 0.0), (0.1, 0.03), (0.14, 0.06), (0.14, 0.1), (0.0, 0.12)],
    );
    part
}

/// A chimney of bricks with `pots` pots. Its origin is on the roof; it reaches 1.5 m below.
pub(super) fn chimney(pots: usize) -> Part {
    let mut part = Part::default();
    let half = 0.3 * pots as f64 + 0.1;
    let brick = named("brick brown");
    part.cuboid(brick, DVec3::new(-half, -1.5, -0.35), DVec3::new(half, 1.5, 0.35));
    for (reach, y) in [(0.06, [1.12, 1.2]), (0.1, [1.34, 1.44]), (0.05, [1.44, 1.54])] {
        let (low, high) =
            (DVec3::new(-half - reach, y[0], -0.35 - reach), DVec3::new(half + reach, y[1], 0.35 + reach));
        part.cuboid(brick, low, high);
    }
    for pot in 0..pots {
        let foot = DVec3::new((pot as f64 + 0.5) * 0.6 - 0.3 * pots as f64, 1.54, 0.0);
        let rows = [
            (0.17, 0.0),
            (0.17, 0.06),
            (0.13, 0.1),
            (0.12, 0.42),
            (0.16, 0.5),
            (0.16, 0.56),
            (0.1, 0.56),
            (0.1, 0.4),
        ];
        part.lathe(named("clay"), foot, &rows, 12);
    }
    part
}

/// Machines on a flat roof: a box with louvres, fans, pipes.
pub(super) fn plant() -> Part {
    let mut part = Part::default();
    part.cuboid(named("zinc"), DVec3::new(-1.6, 0.0, -1.0), DVec3::new(1.6, 1.7, 1.0));
    for i in 0..9 {
        let y = 0.2 + 0.15 * f64::from(i);
        part.on_wall(named("steel"), DVec3::new(-1.4, y, 1.0), DVec3::new(1.4, y + 0.05, 1.0 + 0.5 * REVEAL));
    }
    for x in [-0.8, 0.8] {
        part.lathe(
            named("steel"),
            DVec3::new(x, 1.7, 0.0),
            &[(0.6, 0.0), (0.6, 0.3), (0.5, 0.3), (0.45, 0.1), (0.0, 0.1)],
            16,
        );
    }
    part
}
