//! What stands and lies in the streets: lamps, benches, trees, cars, kerbs, crossings.

use glam::DVec3;

use super::materials::{Material, named};
use super::part::Part;
use crate::maths::{cos_turns, sin_turns};
use crate::noise::uniform;

/// Width of a carriageway, and of the pavement on each side.
pub(super) const CARRIAGEWAY: f64 = 9.0;
pub(super) const PAVEMENT: f64 = 4.0;
/// Height of the kerb.
pub(super) const KERB: f64 = 0.14;

/// A lamp on a fluted foot, with a lantern at 4.6 m.
pub(super) fn lamp() -> Part {
    let mut part = Part::default();
    let iron = named("iron");
    let post = [
        (0.22, 0.0),
        (0.22, 0.12),
        (0.16, 0.18),
        (0.15, 0.7),
        (0.19, 0.76),
        (0.09, 0.9),
        (0.06, 2.2),
        (0.09, 2.26),
        (0.055, 2.32),
        (0.045, 4.0),
        (0.1, 4.06),
        (0.04, 4.14),
    ];
    part.lathe(iron, DVec3::ZERO, &post, 10);
    part.lathe(named("lamp"), DVec3::Y * 4.16, &[(0.0, 0.0), (0.12, 0.02), (0.2, 0.42), (0.2, 0.44)], 6);
    let cap = [(0.24, 4.58), (0.22, 4.64), (0.1, 4.76), (0.04, 4.8), (0.05, 4.86), (0.0, 4.92)];
    part.lathe(iron, DVec3::ZERO, &cap, 6);
    for side in [-1.0, 1.0] {
        let (a, b): (f64, f64) = (side * 0.06, side * 0.5);
        part.cuboid(iron, DVec3::new(a.min(b), 3.86, -0.02), DVec3::new(a.max(b), 3.9, 0.02));
    }
    part
}

/// A bench 1.8 m long, seen from +z.
pub(super) fn bench() -> Part {
    let mut part = Part::default();
    let (wood, iron) = (named("wood"), named("iron"));
    for slat in 0..5 {
        let z = 0.1 * f64::from(slat) - 0.2;
        part.cuboid(wood, DVec3::new(-0.9, 0.43, z), DVec3::new(0.9, 0.46, z + 0.08));
    }
    for slat in 0..4 {
        let y = 0.54 + 0.1 * f64::from(slat);
        let z = -0.25 - 0.025 * f64::from(slat);
        part.cuboid(wood, DVec3::new(-0.9, y, z), DVec3::new(0.9, y + 0.08, z + 0.03));
    }
    for x in [-0.75, 0.0, 0.75] {
        let leg = [
            (-0.34, 0.94),
            (-0.26, 0.43),
            (-0.3, 0.0),
            (-0.24, 0.0),
            (-0.18, 0.38),
            (0.2, 0.38),
            (0.24, 0.0),
            (0.3, 0.0),
            (0.26, 0.43),
            (-0.2, 0.43),
            (-0.3, 0.94),
        ];
        // The outline is not seen whole from a point, so it is cut in three.
        for cut in [[0, 1, 9, 10], [1, 2, 3, 4], [5, 6, 7, 8]] {
            let outline = cut.map(|i| leg[i]);
            part.slab(iron, &outline, [x - 0.03, x + 0.03]);
        }
        part.cuboid(iron, DVec3::new(x - 0.03, 0.38, -0.22), DVec3::new(x + 0.03, 0.43, 0.26));
    }
    part
}

/// A tree about 8 m high: trunk, branches, a crown of lumps with `rows` cells from pole to pole each.
pub(super) fn tree(seed: u64, leaves: Material, rows: usize) -> Part {
    let mut part = Part::default();
    let r = |k: i64| uniform(seed, k, 0, 0);
    let bark = named("bark");
    let trunk = [(0.24, -0.1), (0.17, 0.3), (0.14, 1.4), (0.13, 2.6), (0.09, 3.8), (0.03, 5.6)];
    part.lathe(bark, DVec3::ZERO, &trunk, 9);
    part.lump(leaves, seed, DVec3::new(0.0, 5.7, 0.0), DVec3::new(1.5, 1.8, 1.5), rows);
    for lump in 0..11 {
        let turns = f64::from(lump) * 0.381_966 + 0.1 * r(i64::from(lump));
        let level = f64::from(lump) / 10.0;
        let way = DVec3::new(sin_turns(turns), 0.0, cos_turns(turns));
        let size = 0.75 + 0.35 * r(20 + i64::from(lump));
        let reach = 1.75 - 0.9 * level + 0.3 * r(30 + i64::from(lump));
        let centre = way * reach + DVec3::Y * (3.9 + 2.9 * level);
        let radii = DVec3::new(size * 1.15, size * 0.85, size * 1.15);
        part.lump(leaves, seed ^ (40 + lump as u64), centre, radii, rows * 3 / 4);
    }
    part
}

/// A parked car of about 4.2 m, along x.
pub(super) fn car(paint: Material, is_estate: bool) -> Part {
    let mut part = Part::default();
    let glass = named("glass");
    let half = 0.84;
    // The body from the side: heights of sill, shoulder and roof along x.
    let shoulder =
        [(-2.1, 0.62), (-2.0, 0.86), (-1.5, 0.94), (-0.6, 0.96), (1.0, 0.96), (1.9, 0.84), (2.1, 0.6)];
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
    for pair in shoulder.windows(2) {
        let ((a, ya), (b, yb)) = (pair[0], pair[1]);
        part.polygon(paint, &[at(a, 0.3, half), at(b, 0.3, half), at(b, yb, half), at(a, ya, half)]);
        part.polygon(paint, &[at(b, 0.3, -half), at(a, 0.3, -half), at(a, ya, -half), at(b, yb, -half)]);
        part.polygon(paint, &[at(a, ya, half), at(b, yb, half), at(b, yb, -half), at(a, ya, -half)]);
    }
    part.polygon(paint, &[at(2.1, 0.3, half), at(2.1, 0.3, -half), at(2.1, 0.6, -half), at(2.1, 0.6, half)]);
    part.polygon(
        paint,
        &[at(-2.1, 0.3, -half), at(-2.1, 0.3, half), at(-2.1, 0.62, half), at(-2.1, 0.62, -half)],
    );
    part.polygon(
        named("tyre"),
        &[at(-2.1, 0.3, half), at(-2.1, 0.3, -half), at(2.1, 0.3, -half), at(2.1, 0.3, half)],
    );
    // The cabin: rear, roof's ends, windscreen; narrower at the roof.
    let rear = if is_estate { [-1.95, -1.8] } else { [-1.6, -1.0] };
    let (roof, top, low) = (0.62, 1.42, 0.94);
    let [a, b, c, d] = [[rear[0], low, 0.8], [rear[1], top, roof], [0.2, top, roof], [1.05, low, 0.8]];
    let both = |p: [f64; 3]| [at(p[0], p[1], p[2]), at(p[0], p[1], -p[2])];
    let [[a1, a2], [b1, b2], [c1, c2], [d1, d2]] = [both(a), both(b), both(c), both(d)];
    part.polygon(glass, &[a1, d1, c1, b1]);
    part.polygon(glass, &[d2, a2, b2, c2]);
    part.polygon(glass, &[d1, d2, c2, c1]);
    part.polygon(glass, &[a2, a1, b1, b2]);
    part.polygon(paint, &[b1, c1, c2, b2]);
    let post = at(-0.35, low, 0.805);
    for (side, z) in [(1.0, post.z), (-1.0, -post.z)] {
        let (x0, x1) = (post.x - 0.05, post.x + 0.05);
        let corners = [
            at(x0, low, z),
            at(x1, low, z),
            at(x1, top, side * (roof + 0.005)),
            at(x0, top, side * (roof + 0.005)),
        ];
        let corners = if side > 0.0 { corners } else { [corners[1], corners[0], corners[3], corners[2]] };
        part.polygon(paint, &corners);
    }
    for x in [-1.35, 1.3] {
        for side in [-1.0, 1.0] {
            wheel(&mut part, at(x, 0.32, side * 0.78), side);
        }
    }
    for z in [-0.6, 0.6] {
        part.cuboid(named("lamp"), at(2.04, 0.62, z - 0.16), at(2.13, 0.74, z + 0.16));
        part.cuboid(named("car red"), at(-2.13, 0.64, z - 0.14), at(-2.06, 0.78, z + 0.14));
    }
    for x in [-2.16, 2.08] {
        part.cuboid(named("paint grey"), at(x, 0.34, -0.82), at(x + 0.08, 0.5, 0.82));
    }
    part
}

/// A wheel about the z axis, facing `side`: a tyre of 20 steps and a hub.
fn wheel(part: &mut Part, centre: DVec3, side: f64) {
    const STEPS: usize = 20;
    let ring = |radius: f64, z: f64| -> Vec<DVec3> {
        let way = |i: usize| {
            let turns = i as f64 / STEPS as f64;
            DVec3::new(cos_turns(turns), sin_turns(turns), 0.0)
        };
        (0..STEPS).map(|i| centre + way(i) * radius + DVec3::Z * (side * z)).collect()
    };
    let rows = [(0.32, -0.1, "tyre"), (0.32, 0.08, "tyre"), (0.22, 0.1, "steel"), (0.07, 0.06, "steel")];
    for pair in rows.windows(2) {
        let (a, b) = (ring(pair[0].0, pair[0].1), ring(pair[1].0, pair[1].1));
        for i in 0..STEPS {
            let next = (i + 1) % STEPS;
            let quad = [a[i], a[next], b[next], b[i]];
            let quad = if side > 0.0 { quad } else { [quad[3], quad[2], quad[1], quad[0]] };
            part.polygon(named(pair[0].2), &quad);
        }
    }
    let mut hub = ring(0.07, 0.06);
    if side < 0.0 {
        hub.reverse();
    }
    part.polygon(named("iron"), &hub);
}

/// A rectangle of a surface at height 0 around the origin, cut into cells of at most `cell` metres.
pub(super) fn ground(material: Material, size: [f64; 2], cell: f64) -> Part {
    let mut part = Part::default();
    let count = size.map(|length| (length / cell).ceil().max(1.0) as usize);
    for i in 0..count[0] {
        for j in 0..count[1] {
            let x = [i, i + 1].map(|k| size[0] * (k as f64 / count[0] as f64 - 0.5));
            let z = [j, j + 1].map(|k| size[1] * (k as f64 / count[1] as f64 - 0.5));
            let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
            part.polygon(material, &[at(x[0], z[1]), at(x[1], z[1]), at(x[1], z[0]), at(x[0], z[0])]);
        }
    }
    part
}

/// A straight pavement around the origin, `length` along x, with kerb stones towards +z.
pub(super) fn pavement(length: f64) -> Part {
    let mut part = ground(named("paving"), [length, PAVEMENT - 0.3], 24.0);
    for surface in part.surfaces.values_mut() {
        surface.positions.iter_mut().for_each(|at| *at += DVec3::new(0.0, KERB, -0.15));
    }
    let stones = (length / 1.2).floor().max(1.0) as usize;
    let z = PAVEMENT * 0.5;
    for stone in 0..stones {
        let x = [stone, stone + 1].map(|k| length * (k as f64 / stones as f64 - 0.5));
        let (low, high) = (DVec3::new(x[0] + 0.006, -0.1, z - 0.3), DVec3::new(x[1] - 0.006, KERB, z));
        part.on_wall(named("trim pale"), low, high);
    }
    part
}

/// The pavement at the corner of a block, around the origin.
pub(super) fn corner() -> Part {
    let mut part = Part::default();
    let half = PAVEMENT * 0.5;
    part.cuboid(named("paving"), DVec3::new(-half, -0.1, -half), DVec3::new(half, KERB, half));
    part
}

/// The stripes of a crossing over a carriageway that runs along z.
pub(super) fn crossing() -> Part {
    let mut part = Part::default();
    let stripes = 8;
    let step = CARRIAGEWAY / f64::from(stripes);
    for stripe in 0..stripes {
        let x = (f64::from(stripe) + 0.5) * step - CARRIAGEWAY * 0.5;
        let at = |x: f64, z: f64| DVec3::new(x, 0.012, z);
        let (l, h) = (x - 0.27, x + 0.27);
        part.polygon(named("marking"), &[at(l, 1.5), at(h, 1.5), at(h, -1.5), at(l, -1.5)]);
    }
    part
}

/// Dashes along the middle of a carriageway of a length along z.
pub(super) fn dashes(length: f64) -> Part {
    let mut part = Part::default();
    let count = (length / 6.0).floor().max(1.0) as usize;
    for dash in 0..count {
        let z = length * ((dash as f64 + 0.5) / count as f64 - 0.5);
        let at = |x: f64, z: f64| DVec3::new(x, 0.012, z);
        part.polygon(
            named("marking"),
            &[at(-0.07, z + 1.5), at(0.07, z + 1.5), at(0.07, z - 1.5), at(-0.07, z - 1.5)],
        );
    }
    part
}
