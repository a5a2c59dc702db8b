//! The temple and its surroundings: dressed stones, columns, brick walls, roof, paving, plinths.
//!
//! Assets stand on y = 0 in their own space; [`super::layout`] places them. Hard edges have separate normals, and each
//! stone has its own part of the texture, so the meshes have many creases, uv seams and separate components.

use super::maths::mix;
use super::mesh::ObjMesh;
use super::noise::uniform;
use glam::{DVec2, DVec3};

/// Half width and half length of the colonnade's axes, in metres.
pub(super) const AXES: [f64; 2] = [6.0, 12.0];
/// Height of the floor above the ground.
pub(super) const FLOOR: f64 = 1.08;
/// Height of a column.
pub(super) const COLUMN: f64 = 6.0;
/// Height of the entablature.
pub(super) const ENTABLATURE: f64 = 1.75;
/// How far objects on the floor reach into it: the paving lies a little lower than the stones around it.
const SUNK: f64 = 0.02;
/// Height of a plinth.
pub(super) const PLINTH: f64 = 1.15;

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Resolution of the buildings: 1 is the full scene, larger is coarser.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pitch(pub(super) f64);

impl Pitch {
    /// Number of pieces of about `size` metres in `length`, at least one.
    fn pieces(self, length: f64, size: f64) -> usize {
        (length / (size * self.0)).round().max(1.0) as usize
    }

    /// `full` steps, fewer when coarser, at least `least`.
    fn steps(self, full: usize, least: usize) -> usize {
        ((full as f64 / self.0.sqrt()).round() as usize).max(least)
    }
}

/// Stones along the four sides of a rectangle: from `inner` to `outer` half sizes, `low` to `high`. Each is displaced
/// by a few millimetres, as in old masonry.
fn ring(
    mesh: &mut ObjMesh,
    inner: [f64; 2],
    outer: [f64; 2],
    [low, high]: [f64; 2],
    (pitch, length, seed): (Pitch, f64, u64),
) {
    let jitter = |i: usize, k: i64| 0.006 * (uniform(seed, i as i64, k, (low * 100.0) as i64) - 0.5);
    let mut index = 0;
    for side in 0..4 {
        // Sides 0 and 1 run along x over the whole length; 2 and 3 along z between them.
        let along_x = side < 2;
        let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
        let (reach, near, far) =
            if along_x { (outer[0], inner[1], outer[1]) } else { (inner[1], inner[0], outer[0]) };
        let n = pitch.pieces(2.0 * reach, length);
        for i in 0..n {
            let a = mix(-reach, reach, i as f64 / n as f64) + 0.003;
            let b = mix(-reach, reach, (i + 1) as f64 / n as f64) - 0.003;
            index += 1;
            let (far, top) = (far + jitter(index, 0), high + jitter(index, 1));
            let (s0, s1) = if sign > 0.0 { (near, far) } else { (-far, -near) };
            let (p, q) =
                if along_x { (v(a, low, s0), v(b, top, s1)) } else { (v(s0, low, a), v(s1, top, b)) };
            mesh.stone(p, q, 0.018, 2.4);
        }
    }
}

/// Three steps and a cobbled floor.
pub(super) fn stylobate(seed: u64, pitch: Pitch) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    mesh.group("steps", "stone");
    for step in 0..3 {
        let out = 1.15 + 0.42 * (2.0 - f64::from(step));
        let outer = [AXES[0] + out, AXES[1] + out];
        let inner = [outer[0] - 0.95, outer[1] - 0.95];
        let low = if step == 0 { -0.4 } else { 0.36 * f64::from(step) };
        ring(&mut mesh, inner, outer, [low, 0.36 * f64::from(step + 1)], (pitch, 1.35, seed));
    }
    mesh.group("floor", "cobble");
    let (x, z) = (AXES[0] + 0.2, AXES[1] + 0.2);
    let cells = [pitch.pieces(2.0 * x, 0.8), pitch.pieces(2.0 * z, 0.8)];
    mesh.sheet(v(-x, FLOOR - 0.012, z), v(2.0 * x, 0.0, 0.0), v(0.0, 0.0, -2.0 * z), cells, 2.2);
    mesh
}

/// A fluted column on a moulded base, under a round cushion and a square slab.
pub(super) fn column(pitch: Pitch) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    mesh.group("column", "stone");
    mesh.stone(v(-0.62, -SUNK, -0.62), v(0.62, 0.17, 0.62), 0.02, 2.4);
    let around = pitch.steps(64, 16);
    let moulding = |rows: &[(f64, f64)], steps: usize| -> Vec<(f64, f64)> {
        // A quadratic curve through each triple: end, control, end.
        let mut out = Vec::new();
        for triple in rows.windows(3).step_by(2) {
            for i in 0..=steps {
                let t = i as f64 / steps as f64;
                let at = |a: f64, b: f64, c: f64| mix(mix(a, b, t), mix(b, c, t), t);
                let row =
                    (at(triple[0].0, triple[1].0, triple[2].0), at(triple[0].1, triple[1].1, triple[2].1));
                if out.last() != Some(&row) {
                    out.push(row);
                }
            }
        }
        out
    };
    let fine = pitch.steps(6, 2);
    let base =
        [(0.56, 0.17), (0.68, 0.25), (0.54, 0.33), (0.47, 0.36), (0.53, 0.40), (0.60, 0.44), (0.505, 0.485)];
    mesh.lathe(&moulding(&base, fine), around, true, 2.4);
    // Entasis: the shaft swells a little below the middle.
    let shaft_rows = pitch.steps(24, 5);
    let shaft: Vec<(f64, f64)> = (0..=shaft_rows)
        .map(|i| {
            let t = i as f64 / shaft_rows as f64;
            (0.49 - 0.085 * t * t - 0.015 * t, mix(0.47, 5.35, t))
        })
        .collect();
    let per_flute = pitch.steps(8, 2);
    mesh.lathe_fluted(&shaft, 20 * per_flute, 20, 0.085, true, 2.4);
    let capital =
        [(0.40, 5.33), (0.44, 5.36), (0.41, 5.41), (0.43, 5.56), (0.62, 5.66), (0.68, 5.70), (0.62, 5.76)];
    mesh.lathe(&moulding(&capital, fine), around, true, 2.4);
    mesh.stone(v(-0.66, 5.76, -0.66), v(0.66, COLUMN, 0.66), 0.02, 2.4);
    mesh
}

/// Architrave, frieze with triglyphs, dentils and cornice.
pub(super) fn entablature(seed: u64, pitch: Pitch) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    mesh.group("entablature", "stone");
    let half = |out: f64| [AXES[0] + out, AXES[1] + out];
    ring(&mut mesh, half(-0.5), half(0.5), [0.0, 0.38], (pitch, 2.4, seed ^ 1));
    ring(&mut mesh, half(-0.5), half(0.56), [0.38, 0.66], (pitch, 2.4, seed ^ 2));
    ring(&mut mesh, half(-0.5), half(0.64), [0.66, 0.74], (pitch, 4.8, seed ^ 3));
    ring(&mut mesh, half(-0.5), half(0.50), [0.74, 1.26], (pitch, 2.4, seed ^ 4));
    // Blocks that repeat along the four sides.
    let mut repeat = |spacing: f64, width: f64, depth: [f64; 2], height: [f64; 2]| {
        for side in 0..4 {
            let along_x = side < 2;
            let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
            let (reach, axis) = if along_x { (AXES[0], AXES[1]) } else { (AXES[1], AXES[0]) };
            let n = pitch.pieces(2.0 * reach, spacing);
            for i in 0..=n {
                let c = mix(-reach, reach, i as f64 / n as f64);
                let (near, far) = (axis + depth[0], axis + depth[1]);
                let (s0, s1) = if sign > 0.0 { (near, far) } else { (-far, -near) };
                let (a, b) = (c - width * 0.5, c + width * 0.5);
                let (p, q) = if along_x {
                    (v(a, height[0], s0), v(b, height[1], s1))
                } else {
                    (v(s0, height[0], a), v(s1, height[1], b))
                };
                mesh.stone(p, q, 0.012, 2.4);
            }
        }
    };
    repeat(1.2, 0.50, [0.45, 0.555], [0.74, 1.24]);
    repeat(1.2, 0.11, [0.50, 0.60], [0.74, 1.20]);
    repeat(1.2, 0.56, [0.50, 0.63], [0.585, 0.655]);
    repeat(0.30, 0.15, [0.45, 0.72], [1.27, 1.40]);
    ring(&mut mesh, half(-0.5), half(0.58), [1.26, 1.405], (pitch, 4.8, seed ^ 5));
    ring(&mut mesh, half(-0.5), half(0.95), [1.405, 1.60], (pitch, 2.4, seed ^ 6));
    ring(&mut mesh, half(-0.5), half(1.05), [1.60, ENTABLATURE], (pitch, 2.4, seed ^ 7));
    mesh
}

/// Gabled roof: tiled slopes with cover tiles, and the triangular walls at both ends.
pub(super) fn roof(pitch: Pitch) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    let (eave, rise, reach) = (AXES[0] + 1.25, 2.5, AXES[1] + 1.15);
    mesh.group("gable", "stone");
    // Solid prism under the tiles, its ends recessed behind the raking cornice.
    let wall = AXES[1] + 0.35;
    let prism = |mesh: &mut ObjMesh, half: f64, length: f64, low: f64, high: f64| {
        let ids: Vec<u32> = [
            v(-half, low, length),
            v(half, low, length),
            v(0.0, high, length),
            v(-half, low, -length),
            v(half, low, -length),
            v(0.0, high, -length),
        ]
        .into_iter()
        .map(|p| mesh.position(p))
        .collect();
        let map = |p: DVec3, n: DVec3| super::mesh::box_map(p, n) / 2.4;
        for face in [&[0, 1, 2][..], &[4, 3, 5], &[0, 3, 4, 1], &[1, 4, 5, 2], &[3, 0, 2, 5]] {
            mesh.flat(&face.iter().map(|&i| ids[i]).collect::<Vec<u32>>(), map);
        }
    };
    prism(&mut mesh, eave - 0.5, wall, 0.0, rise - 0.16);
    // Slabs that carry the tiles: one sheared box per side, since two per side would meet at the ridge.
    let slope = DVec2::new(eave, -rise);
    let along = v(slope.x, slope.y, 0.0);
    let across = v(-slope.y, slope.x, 0.0).normalize_or(DVec3::Y);
    let slab = |mesh: &mut ObjMesh, sign: f64, [from, to]: [f64; 2], thick: [f64; 2], z: [f64; 2]| {
        let flip = v(sign, 1.0, 1.0);
        let corner = |t: f64, h: f64, z: f64| (v(0.0, rise, z) + along * t + across * h) * flip;
        let points = [
            corner(from, thick[0], z[0]),
            corner(to, thick[0], z[0]),
            corner(to, thick[1], z[0]),
            corner(from, thick[1], z[0]),
            corner(from, thick[0], z[1]),
            corner(to, thick[0], z[1]),
            corner(to, thick[1], z[1]),
            corner(from, thick[1], z[1]),
        ];
        let ids = points.map(|p| mesh.position(p));
        let map = |p: DVec3, n: DVec3| super::mesh::box_map(p, n) / 2.4;
        for face in [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [3, 7, 6, 2], [0, 4, 7, 3], [1, 2, 6, 5]] {
            let mut face = face.map(|i: usize| ids[i]);
            if sign < 0.0 {
                face.reverse();
            }
            mesh.flat(&face, map);
        }
    };
    for sign in [1.0, -1.0] {
        for end in [1.0, -1.0] {
            let z = [end * (reach - 0.5), end * (reach + 0.04)];
            let z = if end > 0.0 { z } else { [z[1], z[0]] };
            slab(&mut mesh, sign, [0.0, 1.02], [-0.16, 0.16], z);
        }
    }
    mesh.group("tiles", "tile");
    // Of the same material as the tiles, since it is visible between them.
    for sign in [1.0, -1.0] {
        slab(&mut mesh, sign, [0.0, 1.0], [-0.12, 0.0], [-reach, reach]);
    }
    let rows = pitch.pieces(2.0 * (reach - 0.6), 0.52);
    let courses = pitch.steps(10, 3);
    let sides = pitch.steps(6, 3);
    for sign in [1.0, -1.0] {
        for row in 0..=rows {
            let z = mix(-(reach - 0.62), reach - 0.62, row as f64 / rows as f64);
            for course in 0..courses {
                let a = course as f64 / courses as f64;
                let b = (course + 1) as f64 / courses as f64;
                let ends = [
                    (v(0.0, rise, z) + along * a) * v(sign, 1.0, 1.0),
                    (v(0.0, rise, z) + along * (b + 0.012)) * v(sign, 1.0, 1.0),
                ];
                cover_tile(&mut mesh, ends, across * v(sign, 1.0, 1.0), [0.10, 0.13], sides);
            }
        }
    }
    // Ridge.
    let pieces = pitch.pieces(2.0 * reach, 0.8);
    for i in 0..pieces {
        let z = |i: usize| mix(-reach, reach, i as f64 / pieces as f64);
        cover_tile(
            &mut mesh,
            [v(0.0, rise, z(i)), v(0.0, rise, z(i + 1) + 0.02)],
            DVec3::Y,
            [0.18, 0.21],
            sides,
        );
    }
    mesh
}

/// Half of a slightly conical tube from end to end, open below, round side towards `up`; closed by a
/// half disc at the far, wider end.
fn cover_tile(mesh: &mut ObjMesh, ends: [DVec3; 2], up: DVec3, radii: [f64; 2], sides: usize) {
    let axis = (ends[1] - ends[0]).normalize_or(DVec3::Z);
    let right = axis.cross(up);
    let mut rims = [Vec::new(), Vec::new()];
    let mut normals = Vec::new();
    for i in 0..=sides {
        let turns = 0.5 * i as f64 / sides as f64;
        let out = right * super::maths::cos_turns(turns) + up * super::maths::sin_turns(turns);
        normals.push(mesh.normal(out));
        for end in 0..2 {
            rims[end].push(mesh.position(ends[end] + out * radii[end]));
        }
    }
    let mut uvs = Vec::new();
    for i in 0..=sides {
        let u = 0.25 * i as f64 / sides as f64;
        uvs.push([mesh.uv(u, 0.0), mesh.uv(u, 0.25)]);
    }
    for i in 0..sides {
        let corner = |end: usize, i: usize| super::mesh::Corner {
            position: rims[end][i],
            uv: uvs[i][end],
            normal: normals[i],
        };
        mesh.face([corner(0, i), corner(1, i), corner(1, i + 1)]);
        mesh.face([corner(0, i), corner(1, i + 1), corner(0, i + 1)]);
    }
    let fan = rims[1].clone();
    mesh.flat(&fan, |p, n| super::mesh::box_map(p, n) / 2.4);
}

/// Brick walls with stone quoins, a stone door frame and a cornice.
pub(super) fn cella(pitch: Pitch) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    let (x, z, top, thick) = (3.7, 8.7, 6.0, 0.6);
    let (door, lintel) = (1.2, 4.3);
    mesh.group("walls", "brick");
    let tile = 1.5;
    let mut wall = |low: DVec3, high: DVec3| mesh.stone(low, high, 0.01, tile);
    wall(v(-x, -SUNK, -z), v(x, top, -z + thick));
    wall(v(-x, -SUNK, -z + thick), v(-x + thick, top, z - thick));
    wall(v(x - thick, -SUNK, -z + thick), v(x, top, z - thick));
    wall(v(-x, -SUNK, z - thick), v(-door, top, z));
    wall(v(door, -SUNK, z - thick), v(x, top, z));
    wall(v(-door, lintel, z - thick), v(door, top, z));
    mesh.group("dressings", "stone");
    let courses = pitch.pieces(top, 0.5);
    for (sx, sz) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
        for i in 0..courses {
            let (low, high) = (top * i as f64 / courses as f64, top * (i + 1) as f64 / courses as f64);
            let low = if i == 0 { -SUNK } else { low };
            // Quoins: long and short in turn.
            let (lx, lz) = if i % 2 == 0 { (0.9, 0.5) } else { (0.5, 0.9) };
            let (a, b) = (
                v(sx * (x + 0.04), low + 0.004, sz * (z + 0.04)),
                v(sx * (x - lx), high - 0.004, sz * (z - lz)),
            );
            mesh.stone(a.min(b), a.max(b), 0.015, 2.4);
        }
    }
    for sign in [1.0, -1.0] {
        let (a, b) = (sign * door, sign * (door + 0.35));
        let jambs = pitch.pieces(lintel, 1.0);
        for i in 0..jambs {
            let y = |i: usize| lintel * i as f64 / jambs as f64;
            mesh.stone(
                v(a.min(b) - 0.02, if i == 0 { -SUNK } else { y(i) + 0.003 }, z - thick - 0.04),
                v(a.max(b) + 0.02, y(i + 1) - 0.003, z + 0.07),
                0.015,
                2.4,
            );
        }
    }
    mesh.stone(v(-1.75, lintel, z - thick - 0.05), v(1.75, lintel + 0.42, z + 0.10), 0.02, 2.4);
    mesh.stone(v(-1.95, lintel + 0.42, z - thick - 0.05), v(1.95, lintel + 0.56, z + 0.22), 0.02, 2.4);
    let out = 0.12;
    mesh.stone(v(-x - out, top, z - thick), v(x + out, top + 0.3, z + out), 0.02, 2.4);
    mesh.stone(v(-x - out, top, -z - out), v(x + out, top + 0.3, -z + thick), 0.02, 2.4);
    mesh.stone(v(-x - out, top, -z + thick), v(-x + thick, top + 0.3, z - thick), 0.02, 2.4);
    mesh.stone(v(x - thick, top, -z + thick), v(x + out, top + 0.3, z - thick), 0.02, 2.4);
    mesh
}

/// A pedestal: moulded foot and cap of stone around a brick die.
pub(super) fn plinth() -> ObjMesh {
    let mut mesh = ObjMesh::new();
    mesh.group("mouldings", "stone");
    let mut slab = |half: f64, low: f64, high: f64, chamfer: f64| {
        mesh.stone(v(-half, low, -half * 1.25), v(half, high, half * 1.25), chamfer, 2.4);
    };
    slab(1.00, -0.25, 0.14, 0.02);
    slab(0.92, 0.14, 0.24, 0.04);
    slab(0.90, 0.90, 0.98, 0.025);
    slab(0.97, 0.98, PLINTH, 0.03);
    mesh.group("die", "brick");
    mesh.stone(v(-0.82, 0.24, -1.05), v(0.82, 0.90, 1.05), 0.012, 1.2);
    mesh
}

/// The paved avenue from `near` to `far` along z, between kerbs.
pub(super) fn avenue(seed: u64, pitch: Pitch, [near, far]: [f64; 2]) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    mesh.group("paving", "cobble");
    let half = 3.0;
    let cells = [pitch.pieces(2.0 * half, 0.75), pitch.pieces(far - near, 0.75)];
    mesh.sheet(v(-half, 0.06, far), v(2.0 * half, 0.0, 0.0), v(0.0, 0.0, near - far), cells, 2.0);
    mesh.group("kerbs", "stone");
    for sign in [1.0, -1.0] {
        let n = pitch.pieces(far - near, 0.9);
        for i in 0..n {
            let z = |i: usize| mix(near, far, i as f64 / n as f64);
            let top = 0.13 + 0.02 * uniform(seed, i as i64, sign as i64, 5);
            let (a, b) = (sign * half, sign * (half + 0.28));
            mesh.stone(v(a.min(b), -0.25, z(i) + 0.006), v(a.max(b), top, z(i + 1) - 0.006), 0.025, 2.4);
        }
    }
    mesh
}
