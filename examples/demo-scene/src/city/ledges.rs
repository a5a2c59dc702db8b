//! Parts that project from a facade: balconies, railings, bay windows, drainpipes.

use glam::{DVec2, DVec3};

use super::facade::{Style, bracket};
use super::materials::{Material, named};
use super::part::Part;

/// A balcony: a slab on brackets and a railing on its three free sides. Its origin is the middle of the slab's upper
/// edge on the wall.
pub(super) fn balcony(style: &Style, width: f64, depth: f64, is_stone: bool) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    let profile =
        [(0.0, -0.26), (0.7, -0.2), (0.94, -0.12), (0.94, -0.08), (1.0, -0.06), (1.0, 0.0), (0.0, 0.0)];
    part.moulding(
        style.trim,
        [DVec3::new(-half, 0.0, 0.0), DVec3::new(half, 0.0, 0.0)],
        DVec3::Z,
        &profile.map(|(out, up)| (out * depth, up)),
    );
    let brackets = ((width / 1.4).floor() as usize).max(2);
    for i in 0..brackets {
        let x = (i as f64 / (brackets - 1) as f64 - 0.5) * (width - 0.4);
        bracket(&mut part, style.trim, DVec3::new(x, -0.74, 0.0), [0.16, 0.54, depth * 0.7]);
    }
    let (x, z) = (half - 0.06, depth - 0.08);
    let corners = [[-x, 0.04], [-x, z], [x, z], [x, 0.04]];
    for pair in corners.windows(2) {
        let at = |[x, z]: [f64; 2]| DVec3::new(x, 0.0, z);
        railing(&mut part, style.trim, at(pair[0]), at(pair[1]), is_stone);
    }
    part
}

/// A railing 1 m high from one foot to another: turned balusters of stone under a rail, or iron bars.
fn railing(part: &mut Part, stone: Material, from: DVec3, to: DVec3, is_stone: bool) {
    let length = (to - from).length();
    let step = if is_stone { 0.26 } else { 0.14 };
    let count = ((length / step).round() as usize).max(1);
    let thick = if is_stone { DVec3::new(0.08, 0.0, 0.08) } else { DVec3::new(0.022, 0.0, 0.022) };
    let material = if is_stone { stone } else { named("iron") };
    let (low, high) = (from.min(to) - thick, from.max(to) + thick);
    let mut rail = |y: [f64; 2]| {
        part.cuboid(material, DVec3::new(low.x, y[0], low.z), DVec3::new(high.x, y[1], high.z));
    };
    if is_stone {
        rail([0.0, 0.12]);
        rail([0.84, 0.98]);
    } else {
        rail([0.06, 0.09]);
        rail([0.8, 0.82]);
        rail([0.96, 1.0]);
    }
    for i in 0..=count {
        let foot = from + (to - from) * (i as f64 / count as f64);
        if is_stone {
            const BALUSTER: [(f64, f64); 8] = [
                (0.06, 0.12),
                (0.06, 0.18),
                (0.035, 0.22),
                (0.075, 0.36),
                (0.07, 0.44),
                (0.03, 0.62),
                (0.045, 0.76),
                (0.06, 0.84),
            ];
            part.lathe(material, foot, &BALUSTER, 6);
        } else {
            bar(part, material, foot, [0.09, 0.96]);
        }
    }
}

/// An upright iron bar with a knob.
fn bar(part: &mut Part, material: Material, foot: DVec3, [low, high]: [f64; 2]) {
    let middle = 0.5 * (low + high);
    let rows = [(0.011, low), (0.011, middle - 0.05), (0.026, middle), (0.011, middle + 0.05), (0.011, high)];
    part.lathe(material, foot, &rows, 4);
}

/// One storey of a bay window: a front and two slanting sides, each with a window, on panels. Its origin is the middle
/// of its lower edge on the wall.
pub(super) fn bay(style: &Style, width: f64, storey: f64) -> Part {
    let mut part = Part::default();
    let (half, front, depth) = (width * 0.5, width * 0.3, 0.85);
    let plan = [[-half, 0.0], [-front, depth], [front, depth], [half, 0.0]];
    let at = |[x, z]: [f64; 2], y: f64| DVec3::new(x, y, z);
    for pair in plan.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        // Bands of the wall below and above the glass, and posts at both ends.
        let along = at(b, 0.0) - at(a, 0.0);
        let unit = along / along.length();
        let out = unit.cross(DVec3::Y);
        let mut face = |material: Material, s: [f64; 2], y: [f64; 2], z: f64| {
            let place = |s: f64, y: f64| at(a, y) + along * s + out * z;
            let corners = [place(s[0], y[0]), place(s[1], y[0]), place(s[1], y[1]), place(s[0], y[1])];
            part.polygon(material, &corners);
        };
        let (sill, top, post) = (0.85, storey - 0.5, 0.12);
        face(style.wall, [0.0, 1.0], [0.0, sill], 0.0);
        face(style.wall, [0.0, 1.0], [top, storey], 0.0);
        face(style.wall, [0.0, post], [sill, top], 0.0);
        face(style.wall, [1.0 - post, 1.0], [sill, top], 0.0);
        face(named("glass"), [post, 1.0 - post], [sill, top], -0.08);
        // Frame and bars, as flat strips before the glass.
        let bars = if along.length() > 1.2 { 3 } else { 2 };
        for i in 0..=bars {
            let s = post + (1.0 - 2.0 * post) * f64::from(i) / f64::from(bars);
            let thin = 0.03 / along.length();
            face(style.frame, [(s - thin).max(post), (s + thin).min(1.0 - post)], [sill, top], -0.04);
        }
        for y in [sill + 0.03, sill + 0.7 * (top - sill), top - 0.03] {
            face(style.frame, [post, 1.0 - post], [y - 0.03, y + 0.03], -0.045);
        }
        let panel = [0.12, 0.88];
        face(style.trim, panel, [0.2, sill - 0.2], 0.02);
        let ends = [at(a, 0.0), at(b, 0.0)];
        for (y, reach) in [(sill - 0.1, 0.1), (storey - 0.16, 0.16), (0.0, 0.07)] {
            let profile = [(0.0, 0.0), (0.5, 0.03), (0.7, 0.07), (1.0, 0.09), (1.0, 0.14), (0.0, 0.16)];
            let lift = DVec3::Y * y;
            let profile = profile.map(|(o, up)| (o * reach, up));
            part.moulding(style.trim, ends.map(|end| end + lift), out, &profile);
        }
    }
    let cap = plan.map(|p| at(p, storey));
    part.polygon(style.trim, &cap);
    let floor: Vec<DVec3> = plan.iter().rev().map(|&p| at(p, 0.0)).collect();
    part.polygon(style.trim, &floor);
    part
}

/// A drainpipe of a height, with clips.
pub(super) fn drainpipe(height: f64) -> Part {
    let mut part = Part::default();
    let mut rows = vec![(0.05, 0.0)];
    let clips = (height / 2.2).floor() as usize;
    for clip in 1..clips {
        let y = height * clip as f64 / clips as f64;
        rows.extend([(0.05, y - 0.05), (0.065, y - 0.045), (0.065, y + 0.045), (0.05, y + 0.05)]);
    }
    rows.extend([(0.05, height - 0.5), (0.12, height - 0.2), (0.12, height)]);
    part.lathe(named("zinc"), DVec3::new(0.0, 0.0, 0.1), &rows, 8);
    part
}

/// One storey of a tower's facade, `width` wide: glass between mullions, and a spandrel.
pub(super) fn curtain_wall(spandrel: Material, width: f64, storey: f64, bays: usize) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    part.panel(named("glass blue"), DVec2::new(-half, 0.9), DVec2::new(half, storey), 0.0);
    part.on_wall(spandrel, DVec3::new(-half, 0.0, 0.0), DVec3::new(half, 0.9, 0.08));
    part.on_wall(named("steel"), DVec3::new(-half, 0.86, 0.0), DVec3::new(half, 0.94, 0.14));
    part.on_wall(named("steel"), DVec3::new(-half, storey - 0.05, 0.0), DVec3::new(half, storey, 0.12));
    for i in 0..=bays {
        let x = (i as f64 / bays as f64 - 0.5) * (width - 0.1);
        part.on_wall(named("steel"), DVec3::new(x - 0.05, 0.0, 0.0), DVec3::new(x + 0.05, storey, 0.2));
        if i < bays {
            let next = x + (width - 0.1) / bays as f64;
            let middle = 0.5 * (x + next);
            part.on_wall(
                named("steel"),
                DVec3::new(middle - 0.025, 0.94, 0.0),
                DVec3::new(middle + 0.025, storey - 0.05, 0.06),
            );
        }
    }
    part
}
