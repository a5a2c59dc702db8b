//! Parts of facades: walls with openings, windows, doors, shop fronts, mouldings.
//!
//! A window's origin is the middle of its opening's lower edge, on the wall.

use glam::{DVec2, DVec3};

use super::materials::{Material, named};
use super::part::Part;

/// How far glass and doors lie behind the wall.
pub(super) const REVEAL: f64 = 0.16;

/// An opening of a wall: bounds of x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Opening {
    pub(super) low: DVec2,
    pub(super) high: DVec2,
}

impl Opening {
    pub(super) fn new(middle: f64, sill: f64, [width, height]: [f64; 2]) -> Self {
        let half = width * 0.5;
        Self { low: DVec2::new(middle - half, sill), high: DVec2::new(middle + half, sill + height) }
    }
}

/// How ornate the windows of a building are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ornament {
    /// A frame and a sill.
    Plain,
    /// A moulded surround too.
    Framed,
    /// A cornice on brackets above it too.
    Corniced,
}

/// Materials and ornament of a building.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Style {
    pub(super) wall: Material,
    pub(super) base: Material,
    pub(super) trim: Material,
    pub(super) frame: Material,
    pub(super) roof: Material,
    pub(super) ornament: Ornament,
}

/// A wall from x = `low` to `high` and y = 0 to `height` at z = 0, with openings, in the order of x, and their reveals.
pub(super) fn wall(material: Material, [low, high]: [f64; 2], height: f64, openings: &[Opening]) -> Part {
    let mut part = Part::default();
    let mut x = low;
    for opening in openings {
        let (l, h) = (opening.low, opening.high);
        part.panel(material, DVec2::new(x, 0.0), DVec2::new(l.x, height), 0.0);
        part.panel(material, DVec2::new(l.x, 0.0), DVec2::new(h.x, l.y), 0.0);
        part.panel(material, DVec2::new(l.x, h.y), DVec2::new(h.x, height), 0.0);
        let corners = [l, DVec2::new(l.x, h.y), h, DVec2::new(h.x, l.y)];
        // A door has no sill.
        for i in 0..if l.y > 0.0 { 4 } else { 3 } {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let deep = |p: DVec2| p.extend(-REVEAL);
            part.polygon(material, &[a.extend(0.0), deep(a), deep(b), b.extend(0.0)]);
        }
        x = h.x;
    }
    part.panel(material, DVec2::new(x, 0.0), DVec2::new(high, height), 0.0);
    part
}

/// Frame, glass and glazing bars in an opening of a size, set back by the reveal.
fn glazing(part: &mut Part, frame: Material, glass: Material, low: DVec2, high: DVec2, bars: [usize; 2]) {
    const BOARD: f64 = 0.07;
    let z = -REVEAL;
    let mut board = |low: DVec2, high: DVec2, thick: f64| {
        part.on_wall(frame, low.extend(z), high.extend(z + thick));
    };
    board(low, DVec2::new(low.x + BOARD, high.y), 0.06);
    board(DVec2::new(high.x - BOARD, low.y), high, 0.06);
    board(DVec2::new(low.x + BOARD, low.y), DVec2::new(high.x - BOARD, low.y + BOARD), 0.06);
    board(DVec2::new(low.x + BOARD, high.y - BOARD), DVec2::new(high.x - BOARD, high.y), 0.06);
    let size = high - low;
    for i in 1..bars[0] {
        let x = low.x + size.x * i as f64 / bars[0] as f64;
        board(DVec2::new(x - 0.025, low.y + BOARD), DVec2::new(x + 0.025, high.y - BOARD), 0.045);
    }
    for j in 1..bars[1] {
        // The top panes are lower than those below.
        let y = low.y + size.y * (j as f64 / bars[1] as f64).sqrt();
        board(DVec2::new(low.x + BOARD, y - 0.02), DVec2::new(high.x - BOARD, y + 0.02), 0.04);
    }
    part.panel(glass, low, high, z + 0.012);
}

/// The profile of a projecting moulding of this height and depth, from its lower edge on the wall to its upper one.
fn cyma(height: f64, depth: f64) -> [(f64, f64); 9] {
    const POINTS: [(f64, f64); 9] = [
        (0.0, 0.0),
        (0.22, 0.08),
        (0.30, 0.28),
        (0.52, 0.36),
        (0.60, 0.52),
        (0.86, 0.62),
        (1.0, 0.78),
        (1.0, 0.96),
        (0.0, 1.0),
    ];
    POINTS.map(|(out, up)| (out * depth, up * height))
}

/// A window of a size, with sill, and what the style adds around it.
pub(super) fn window(style: &Style, [width, height]: [f64; 2], has_sill: bool) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    let bars = if style.ornament == Ornament::Plain { [2, 1] } else { [2, 3] };
    glazing(
        &mut part,
        style.frame,
        named("glass"),
        DVec2::new(-half, 0.0),
        DVec2::new(half, height),
        [bars[0], bars[1].min(if height < 1.3 { 1 } else { 3 })],
    );
    let across = |y: f64, reach: f64| [DVec3::new(-reach, y, 0.0), DVec3::new(reach, y, 0.0)];
    if has_sill {
        let profile = [(0.0, 0.0), (0.08, 0.02), (0.10, 0.05), (0.15, 0.06), (0.15, 0.11), (0.0, 0.14)];
        part.moulding(style.trim, across(-0.14, half + 0.12), DVec3::Z, &profile);
    }
    if style.ornament == Ornament::Plain {
        return part;
    }
    // An architrave: two fillets on each side and above.
    let band = 0.15;
    for side in [-1.0, 1.0] {
        for (inner, outer, thick) in [(0.0, band * 0.6, 0.035), (band * 0.6, band, 0.065)] {
            let (a, b) = (side * (half + inner), side * (half + outer));
            part.on_wall(style.trim, DVec3::new(a.min(b), 0.0, 0.0), DVec3::new(a.max(b), height, thick));
        }
    }
    part.on_wall(
        style.trim,
        DVec3::new(-half - band, height, 0.0),
        DVec3::new(half + band, height + band, 0.065),
    );
    if style.ornament == Ornament::Corniced {
        let top = height + band + 0.22;
        part.moulding(style.trim, across(top, half + band + 0.12), DVec3::Z, &cyma(0.2, 0.24));
        for side in [-1.0, 1.0] {
            let middle = side * (half + band * 0.5);
            bracket(&mut part, style.trim, DVec3::new(middle, height + 0.02, 0.0), [0.11, 0.34, 0.2]);
        }
        // A keystone.
        let key = [(0.0, -0.1), (0.11, -0.08), (0.14, 0.2), (0.0, 0.22)];
        part.slab(style.trim, &key.map(|(z, y)| (z, y + height)), [-0.09, 0.09]);
    }
    part
}

/// A scrolled bracket below a cornice or balcony: width, height and depth.
pub(super) fn bracket(part: &mut Part, material: Material, foot: DVec3, [width, height, depth]: [f64; 3]) {
    const SCROLL: [(f64, f64); 9] = [
        (0.0, 1.0),
        (0.0, 0.0),
        (0.22, 0.02),
        (0.34, 0.14),
        (0.30, 0.34),
        (0.48, 0.52),
        (0.82, 0.58),
        (1.0, 0.74),
        (1.0, 1.0),
    ];
    let outline = SCROLL.map(|(z, y)| (foot.z + z * depth, foot.y + y * height));
    part.slab(material, &outline, [foot.x - width * 0.5, foot.x + width * 0.5]);
}

/// A band of moulding along a facade, `width` wide.
pub(super) fn string_course(material: Material, width: f64) -> Part {
    let mut part = Part::default();
    let ends = [DVec3::new(-width * 0.5, 0.0, 0.0), DVec3::new(width * 0.5, 0.0, 0.0)];
    part.moulding(material, ends, DVec3::Z, &cyma(0.22, 0.14));
    part
}

/// The cornice below the eaves, with dentils or brackets.
pub(super) fn cornice(style: &Style, width: f64) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    let ends = |y: f64| [DVec3::new(-half, y, 0.0), DVec3::new(half, y, 0.0)];
    part.moulding(style.trim, ends(0.0), DVec3::Z, &cyma(0.42, 0.5));
    if style.ornament != Ornament::Plain {
        part.on_wall(style.trim, DVec3::new(-half, -0.3, 0.0), DVec3::new(half, 0.0, 0.06));
        let step = if style.ornament == Ornament::Corniced { 0.72 } else { 0.3 };
        let count = (width / step).floor();
        for i in 0..count as usize {
            let x = (i as f64 + 0.5) * width / count - half;
            if style.ornament == Ornament::Corniced {
                bracket(&mut part, style.trim, DVec3::new(x, -0.3, 0.0), [0.16, 0.34, 0.34]);
            } else {
                part.on_wall(style.trim, DVec3::new(x - 0.08, -0.16, 0.0), DVec3::new(x + 0.08, 0.02, 0.16));
            }
        }
    }
    part
}

/// A panelled door in an opening of a size, with a light above it and a surround.
pub(super) fn door(style: &Style, [width, height]: [f64; 2]) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    let leaf_top = height - 0.5;
    let z = -REVEAL;
    part.on_wall(style.frame, DVec3::new(-half, 0.0, z - 0.02), DVec3::new(half, leaf_top, z + 0.02));
    for side in [-1.0, 1.0] {
        for (low, high) in [(0.18, 0.75), (0.9, leaf_top - 0.18)] {
            let (a, b) = (side * 0.1, side * (half - 0.12));
            let (l, h) = (a.min(b), a.max(b));
            part.on_wall(style.frame, DVec3::new(l, low, z + 0.02), DVec3::new(h, high, z + 0.04));
            let (l, h) = (l + 0.06, h - 0.06);
            part.on_wall(
                style.frame,
                DVec3::new(l, low + 0.07, z + 0.04),
                DVec3::new(h, high - 0.07, z + 0.055),
            );
        }
    }
    part.lathe(
        named("steel"),
        DVec3::new(0.07, 1.02, z + 0.07),
        &[(0.0, 0.0), (0.035, 0.02), (0.035, 0.06), (0.0, 0.08)],
        10,
    );
    glazing(
        &mut part,
        style.frame,
        named("glass"),
        DVec2::new(-half, leaf_top),
        DVec2::new(half, height),
        [4, 1],
    );
    let reach = half + 0.34;
    for side in [-1.0, 1.0] {
        let (a, b) = (side * half, side * (half + 0.26));
        part.on_wall(style.trim, DVec3::new(a.min(b), 0.0, 0.0), DVec3::new(a.max(b), height, 0.1));
        bracket(&mut part, style.trim, DVec3::new((a + b) * 0.5, height, 0.0), [0.2, 0.4, 0.36]);
    }
    part.on_wall(
        style.trim,
        DVec3::new(-reach + 0.08, height, 0.0),
        DVec3::new(reach - 0.08, height + 0.4, 0.06),
    );
    let ends = [DVec3::new(-reach, height + 0.4, 0.0), DVec3::new(reach, height + 0.4, 0.0)];
    part.moulding(style.trim, ends, DVec3::Z, &cyma(0.24, 0.42));
    part
}

/// Steps in front of a door: `count` of them, each 15 cm high, from the pavement up to the threshold.
pub(super) fn stairs(material: Material, width: f64, count: usize) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    for step in 0..count {
        let (low, high) = (step as f64 * 0.15, (step + 1) as f64 * 0.15);
        let depth = 0.3 * (count - step) as f64;
        part.on_wall(material, DVec3::new(-half, low, 0.0), DVec3::new(half, high - 0.03, depth - 0.02));
        part.on_wall(
            material,
            DVec3::new(-half - 0.02, high - 0.03, 0.0),
            DVec3::new(half + 0.02, high, depth),
        );
    }
    part
}

/// A shop front in an opening of a size: stall riser, panes, fascia with letters in relief.
pub(super) fn shop_front(style: &Style, [width, height]: [f64; 2], seed: u64) -> Part {
    let mut part = Part::default();
    let half = width * 0.5;
    let z = -REVEAL;
    let riser = 0.45;
    part.on_wall(style.frame, DVec3::new(-half, 0.0, z - 0.02), DVec3::new(half, riser, z + 0.08));
    let panes = (width / 1.1).floor().max(2.0) as usize;
    glazing(
        &mut part,
        style.frame,
        named("glass"),
        DVec2::new(-half, riser),
        DVec2::new(half, height),
        [panes, 2],
    );
    for i in 0..panes {
        let (l, h) = (i as f64 / panes as f64, (i + 1) as f64 / panes as f64);
        let low = DVec3::new(-half + l * width + 0.08, 0.1, z + 0.08);
        let high = DVec3::new(-half + h * width - 0.08, riser - 0.1, z + 0.1);
        part.on_wall(style.frame, low, high);
    }
    part.on_wall(
        style.frame,
        DVec3::new(-half - 0.1, height, 0.0),
        DVec3::new(half + 0.1, height + 0.62, 0.1),
    );
    let ends = [DVec3::new(-half - 0.12, height + 0.62, 0.0), DVec3::new(half + 0.12, height + 0.62, 0.0)];
    part.moulding(style.trim, ends, DVec3::Z, &cyma(0.16, 0.28));
    // Letters: bars and bowls of boxes are enough at the height of a hand.
    let letters = (seed % 5 + 6) as usize;
    let pitch = (width / (letters as f64 + 2.0)).min(0.42);
    for i in 0..letters {
        let x = (i as f64 + 0.5 - letters as f64 * 0.5) * pitch;
        let shape = seed >> (8 + 3 * i) & 7;
        let mut bar = |l: [f64; 2], h: [f64; 2]| {
            let scale = pitch * 0.8;
            let low = DVec3::new(x + (l[0] - 0.5) * scale, height + 0.18 + l[1] * 0.28, 0.1);
            let high = DVec3::new(x + (h[0] - 0.5) * scale, height + 0.18 + h[1] * 0.28, 0.13);
            part.on_wall(named("paint white"), low, high);
        };
        bar([0.0, 0.0], [0.2, 1.0]);
        if shape & 1 == 0 {
            bar([0.65, 0.0], [0.85, 1.0]);
        }
        if shape & 2 == 0 {
            bar([0.2, 0.8], [0.65, 1.0]);
        }
        if shape & 4 == 0 {
            bar([0.2, 0.4], [0.65, 0.58]);
        } else {
            bar([0.2, 0.0], [0.75, 0.2]);
        }
    }
    part
}

/// A sloping awning of stripes above a shop front.
pub(super) fn awning(material: Material, width: f64) -> Part {
    let mut part = Part::default();
    let stripes = (width / 0.3).floor().max(2.0) as usize;
    for i in 0..stripes {
        let material = if i % 2 == 0 { material } else { named("paint white") };
        let [l, h] = [i, i + 1].map(|k| width * (k as f64 / stripes as f64 - 0.5));
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        part.polygon(material, &[at(l, -0.62, 1.3), at(h, -0.62, 1.3), at(h, 0.0, 0.0), at(l, 0.0, 0.0)]);
        part.polygon(material, &[at(l, -0.86, 1.3), at(h, -0.86, 1.3), at(h, -0.62, 1.3), at(l, -0.62, 1.3)]);
    }
    part
}
