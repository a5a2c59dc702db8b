//! The statues: a seated lion, a robed sage, a dragon coiled on a rock; and boulders.
//!
//! Each is a solid of some dozens of parts under fine relief, about two and a half metres high,
//! standing on y = 0 and facing +z.

use super::maths::{cos_turns, sin_turns, unit_or};
use super::noise::uniform;
use super::sculptor::{Sculptor, at};
use super::sdf::Figure;
use super::skin::Skin;
use glam::DVec3;

/// A lion, seated upright.
pub(super) fn lion(seed: u64) -> Figure {
    let mut s = Sculptor::new(seed ^ 0x11);
    s.with(Skin::Polished, 0.02).block(at(0.0, 0.07, -0.05), at(0.58, 0.08, 1.02), 0.03, [0.0; 2]);
    // Trunk.
    s.with(Skin::Fur, 0.16)
        .egg(at(0.0, 0.62, -0.52), at(0.37, 0.42, 0.44), 0.05)
        .limb(at(0.0, 0.68, -0.42), 0.33, at(0.0, 1.22, 0.18), 0.33)
        .egg(at(0.0, 1.12, 0.32), at(0.31, 0.42, 0.27), -0.04);
    // Hind legs: folded thighs, feet flat.
    s.pairs(true)
        .with(Skin::Fur, 0.07)
        .egg(at(0.34, 0.50, -0.34), at(0.17, 0.34, 0.43), 0.09)
        .limb(at(0.38, 0.26, -0.62), 0.11, at(0.40, 0.23, 0.02), 0.095)
        .egg(at(0.40, 0.23, 0.12), at(0.12, 0.09, 0.19), 0.0);
    // Fore legs, straight, with elbow and wrist.
    s.with(Skin::Fur, 0.08)
        .chain(&[
            (at(0.25, 1.15, 0.30), 0.19),
            (at(0.24, 0.84, 0.38), 0.15),
            (at(0.22, 0.52, 0.50), 0.105),
            (at(0.22, 0.26, 0.54), 0.115),
        ])
        .egg(at(0.22, 0.22, 0.66), at(0.125, 0.10, 0.20), 0.0);
    // Toes, and the gaps between them.
    s.with(Skin::Polished, 0.025);
    for (x, z, count) in [(0.22, 0.80, 4), (0.40, 0.28, 4)] {
        for toe in 0..count {
            let side = (f64::from(toe) - 1.5) * 0.062;
            s.limb(at(x + side, 0.20, z - 0.05), 0.046, at(x + side * 1.1, 0.185, z + 0.03), 0.038);
            s.limb(at(x + side * 1.1, 0.20, z + 0.06), 0.014, at(x + side * 1.1, 0.165, z + 0.095), 0.006);
        }
    }
    // Mane: chest, neck, and the ruff around the face.
    s.pairs(false)
        .with(Skin::Mane, 0.10)
        .egg(at(0.0, 1.50, 0.22), at(0.38, 0.50, 0.34), -0.03)
        .egg(at(0.0, 1.30, 0.44), at(0.25, 0.38, 0.20), -0.05)
        .egg(at(0.0, 1.92, 0.24), at(0.44, 0.46, 0.27), 0.03)
        .egg(at(0.0, 1.72, 0.40), at(0.36, 0.30, 0.24), 0.0);
    // Skull and muzzle.
    s.with(Skin::Polished, 0.06)
        .egg(at(0.0, 1.97, 0.46), at(0.25, 0.26, 0.27), 0.0)
        .limb(at(0.0, 1.98, 0.62), 0.095, at(0.0, 1.93, 0.80), 0.075)
        .pairs(true)
        .egg(at(0.075, 1.855, 0.80), at(0.095, 0.080, 0.10), 0.0)
        .limb(at(0.16, 1.88, 0.58), 0.08, at(0.13, 1.86, 0.66), 0.07)
        .with(Skin::Polished, 0.035)
        .limb(at(0.05, 2.085, 0.70), 0.036, at(0.17, 2.075, 0.61), 0.040);
    s.with(Skin::Plain, 0.02)
        .cut_egg(at(0.115, 2.02, 0.70), at(0.058, 0.040, 0.05), 0.0)
        .with(Skin::Plain, 0.006)
        .egg(at(0.112, 2.017, 0.672), at(0.044, 0.036, 0.040), 0.0)
        .limb(at(0.06, 2.050, 0.712), 0.014, at(0.16, 2.048, 0.672), 0.014);
    s.pairs(false)
        .with(Skin::Polished, 0.03)
        .egg(at(0.0, 1.735, 0.76), at(0.10, 0.058, 0.115), -0.02)
        .with(Skin::Plain, 0.012)
        .cut_egg(at(0.0, 1.787, 0.87), at(0.115, 0.013, 0.10), 0.0)
        .cut_limb(at(0.0, 1.79, 0.91), 0.008, at(0.0, 1.90, 0.895), 0.010)
        .with(Skin::Polished, 0.02)
        .egg(at(0.0, 1.935, 0.872), at(0.062, 0.038, 0.040), 0.0);
    s.pairs(true)
        .with(Skin::Plain, 0.01)
        .cut_egg(at(0.032, 1.925, 0.908), at(0.017, 0.013, 0.03), 0.0)
        .with(Skin::Fur, 0.03)
        .egg(at(0.235, 2.25, 0.44), at(0.075, 0.085, 0.05), 0.0)
        .with(Skin::Plain, 0.02)
        .cut_egg(at(0.24, 2.25, 0.49), at(0.042, 0.052, 0.035), 0.0);
    // Tail around the left side, with its tuft.
    s.pairs(false).with(Skin::Fur, 0.05).chain(&[
        (at(0.05, 0.40, -0.90), 0.075),
        (at(0.28, 0.25, -0.98), 0.065),
        (at(0.49, 0.21, -0.82), 0.058),
        (at(0.545, 0.20, -0.45), 0.052),
        (at(0.545, 0.20, -0.05), 0.048),
        (at(0.52, 0.21, 0.28), 0.045),
    ]);
    s.with(Skin::Mane, 0.05).egg(at(0.50, 0.23, 0.42), at(0.075, 0.075, 0.16), 0.0);
    s.finish()
}

/// A hooded sage with a staff and a book.
pub(super) fn sage(seed: u64) -> Figure {
    let mut s = Sculptor::new(seed ^ 0x22);
    s.with(Skin::Polished, 0.02).block(at(0.0, 0.07, 0.02), at(0.60, 0.08, 0.58), 0.03, [0.0; 2]);
    // Feet under the hem.
    s.pairs(true)
        .with(Skin::Polished, 0.03)
        .egg(at(0.17, 0.19, 0.40), at(0.085, 0.07, 0.18), 0.02)
        .pairs(false);
    // Robe: a bell of heavy cloth, pulled in at the belt.
    s.with(Skin::Cloth(0.042), 0.14)
        .limb(at(0.0, 0.42, 0.0), 0.42, at(0.0, 1.20, 0.0), 0.26)
        .limb(at(-0.05, 0.26, 0.0), 0.43, at(0.05, 0.26, 0.0), 0.43)
        .with(Skin::Cloth(0.030), 0.10)
        .egg(at(0.0, 1.52, 0.01), at(0.33, 0.42, 0.235), -0.01)
        .limb(at(-0.22, 1.80, -0.02), 0.135, at(0.22, 1.80, -0.02), 0.135);
    // Cloak down the back, and a sash across the chest.
    s.with(Skin::Cloth(0.040), 0.08)
        .limb(at(0.0, 1.78, -0.14), 0.22, at(0.0, 0.45, -0.30), 0.34)
        .with(Skin::Cloth(0.018), 0.03)
        .chain(&[
            (at(0.27, 1.86, 0.06), 0.075),
            (at(0.17, 1.70, 0.215), 0.080),
            (at(0.00, 1.48, 0.265), 0.080),
            (at(-0.17, 1.27, 0.235), 0.080),
            (at(-0.29, 1.10, 0.12), 0.085),
            (at(-0.31, 0.72, 0.16), 0.075),
        ]);
    // Belt: a rope with hanging ends.
    s.with(Skin::Strands, 0.015);
    for i in 0..14 {
        let (a, b) = (f64::from(i) / 14.0, f64::from(i + 1) / 14.0);
        let on = |t: f64| at(0.305 * sin_turns(t), 1.17 - 0.02 * cos_turns(t), 0.285 * cos_turns(t));
        s.limb(on(a), 0.032, on(b), 0.032);
    }
    s.chain(&[(at(0.10, 1.14, 0.29), 0.028), (at(0.13, 0.85, 0.39), 0.026), (at(0.12, 0.60, 0.45), 0.036)]);
    // Right arm, to the staff; left arm, under the book. The sleeves hang open.
    s.with(Skin::Cloth(0.022), 0.07)
        .chain(&[(at(-0.33, 1.78, 0.0), 0.125), (at(-0.47, 1.42, 0.08), 0.115)])
        .chain(&[(at(-0.47, 1.42, 0.08), 0.11), (at(-0.45, 1.52, 0.34), 0.125)])
        .limb(at(-0.455, 1.42, 0.30), 0.10, at(-0.455, 1.20, 0.30), 0.05)
        .chain(&[(at(0.33, 1.78, 0.0), 0.125), (at(0.45, 1.38, 0.06), 0.115)])
        .chain(&[(at(0.45, 1.38, 0.06), 0.11), (at(0.24, 1.36, 0.34), 0.115)])
        .limb(at(0.29, 1.30, 0.30), 0.09, at(0.30, 1.06, 0.30), 0.045);
    s.with(Skin::Plain, 0.015)
        .cut_limb(at(-0.447, 1.54, 0.40), 0.082, at(-0.445, 1.56, 0.52), 0.10)
        .cut_limb(at(0.19, 1.355, 0.38), 0.075, at(0.12, 1.35, 0.46), 0.09);
    s.with(Skin::Polished, 0.02).limb(at(-0.45, 1.52, 0.30), 0.055, at(-0.44, 1.56, 0.46), 0.045).limb(
        at(0.26, 1.36, 0.30),
        0.052,
        at(0.10, 1.35, 0.44),
        0.042,
    );
    // Staff, its crook, and the fingers around it.
    s.with(Skin::Polished, 0.012).limb(at(-0.44, 0.12, 0.50), 0.030, at(-0.44, 2.42, 0.50), 0.026);
    let crook = |t: f64| {
        let r = 0.16 - 0.10 * t;
        at(-0.44 + 0.16 - r * cos_turns(t * 1.25), 2.42 + r * sin_turns(t * 1.25), 0.50)
    };
    for i in 0..18 {
        let (a, b) = (f64::from(i) / 18.0, f64::from(i + 1) / 18.0);
        s.limb(crook(a), 0.026 - 0.008 * a, crook(b), 0.026 - 0.008 * b);
    }
    for finger in 0..4 {
        let y = 1.60 - 0.030 * f64::from(finger);
        s.chain(&[
            (at(-0.475, y, 0.465), 0.017),
            (at(-0.482, y - 0.004, 0.515), 0.016),
            (at(-0.440, y - 0.006, 0.542), 0.015),
            (at(-0.405, y - 0.008, 0.520), 0.013),
        ]);
        // Left hand under the book.
        let x = 0.02 + 0.034 * f64::from(finger);
        s.chain(&[(at(x + 0.02, 1.335, 0.43), 0.018), (at(x - 0.01, 1.345, 0.50), 0.016)]);
    }
    // An open book: two boards, two swollen leaves of pages.
    s.with(Skin::Plain, 0.006)
        .block(at(-0.045, 1.405, 0.455), at(0.125, 0.012, 0.16), 0.005, [0.06, -0.03])
        .block(at(0.185, 1.405, 0.455), at(0.125, 0.012, 0.16), 0.005, [0.06, 0.03])
        .block(at(-0.038, 1.428, 0.453), at(0.112, 0.022, 0.145), 0.012, [0.06, -0.02])
        .block(at(0.178, 1.428, 0.453), at(0.112, 0.022, 0.145), 0.012, [0.06, 0.02]);
    // Hood with the face in its shade.
    s.with(Skin::Cloth(0.020), 0.06)
        .egg(at(0.0, 2.16, -0.02), at(0.205, 0.27, 0.225), 0.02)
        .limb(at(0.0, 2.28, -0.12), 0.13, at(0.0, 2.10, -0.25), 0.08)
        .limb(at(0.0, 1.95, -0.04), 0.19, at(0.0, 1.86, 0.0), 0.22);
    s.with(Skin::Plain, 0.02).cut_egg(at(0.0, 2.13, 0.20), at(0.135, 0.205, 0.17), 0.02);
    s.with(Skin::Polished, 0.03)
        .egg(at(0.0, 2.15, 0.06), at(0.115, 0.165, 0.13), 0.0)
        .limb(at(0.0, 2.185, 0.185), 0.016, at(0.0, 2.115, 0.215), 0.024)
        .pairs(true)
        .limb(at(0.015, 2.205, 0.185), 0.017, at(0.075, 2.205, 0.155), 0.018)
        .egg(at(0.062, 2.115, 0.145), at(0.034, 0.032, 0.03), 0.0)
        .with(Skin::Plain, 0.012)
        .cut_egg(at(0.045, 2.168, 0.190), at(0.026, 0.019, 0.022), 0.0)
        .with(Skin::Plain, 0.004)
        .ball(at(0.045, 2.168, 0.163), 0.019)
        .pairs(false);
    // Beard and moustache.
    s.with(Skin::Strands, 0.035)
        .egg(at(0.0, 2.02, 0.165), at(0.105, 0.09, 0.075), 0.0)
        .limb(at(0.0, 1.98, 0.19), 0.085, at(0.0, 1.66, 0.285), 0.030)
        .pairs(true)
        .chain(&[
            (at(0.01, 2.085, 0.205), 0.022),
            (at(0.055, 2.062, 0.200), 0.024),
            (at(0.090, 1.985, 0.190), 0.014),
        ]);
    s.finish()
}

/// A dragon coiled around a rock, its neck reared.
pub(super) fn dragon(seed: u64) -> Figure {
    let mut s = Sculptor::new(seed ^ 0x33);
    s.with(Skin::Rock, 0.10).egg(at(0.0, 0.16, 0.0), at(0.98, 0.24, 0.98), 0.0).limb(
        at(0.0, 0.20, 0.0),
        0.62,
        at(0.05, 1.10, -0.05),
        0.30,
    );
    let turns = 2.35;
    let mut points = Vec::new();
    let mut radii = Vec::new();
    for i in 0..=26 {
        let t = f64::from(i) / 26.0;
        let out = 0.98 - 0.44 * t * t;
        let angle = -0.02 + turns * t;
        points.push(at(out * sin_turns(angle), 0.27 + 0.98 * t * (0.6 + 0.4 * t), out * cos_turns(angle)));
        radii.push(0.012 + 0.205 * (t * (2.0 - t)).sqrt() * (0.35 + 0.65 * t));
    }
    // From the last coil (at the left, going back) up behind the rock and over it, to the front.
    for (p, r) in [
        (at(0.30, 1.45, -0.48), 0.222),
        (at(0.04, 1.66, -0.52), 0.222),
        (at(-0.17, 1.95, -0.36), 0.214),
        (at(-0.16, 2.26, -0.14), 0.196),
        (at(-0.04, 2.50, 0.04), 0.174),
        (at(0.02, 2.60, 0.27), 0.154),
        (at(0.02, 2.54, 0.47), 0.142),
    ] {
        points.push(p);
        radii.push(r);
    }
    let spine = s.serpent(&points, &radii, 210, 22.0);
    // Crest along the back.
    s.with(Skin::Plain, 0.012);
    for pair in spine.windows(2).skip(24).step_by(3) {
        let [(a, radius, back), (b, _, _)] = [pair[0], pair[1]];
        let lean = unit_or(a - b, DVec3::Z);
        let root = a + back * (radius * 0.85);
        s.limb(root, radius * 0.30, root + back * (radius * 0.62) + lean * (radius * 0.42), radius * 0.035);
    }
    dragon_head(&mut s, at(0.02, 2.54, 0.50));
    s.finish()
}

fn dragon_head(s: &mut Sculptor, head: DVec3) {
    let p = |x: f64, y: f64, z: f64| head + at(x, y, z);
    // Skull, upper jaw, cheeks.
    s.with(Skin::Polished, 0.05)
        .egg(p(0.0, 0.02, 0.04), at(0.150, 0.130, 0.20), 0.03)
        .limb(p(0.0, 0.01, 0.14), 0.105, p(0.0, -0.045, 0.44), 0.062)
        .egg(p(0.0, -0.025, 0.46), at(0.078, 0.052, 0.07), 0.0)
        .pairs(true)
        .egg(p(0.095, -0.03, 0.06), at(0.065, 0.085, 0.12), 0.0)
        .limb(p(0.035, 0.055, 0.18), 0.030, p(0.030, 0.000, 0.43), 0.022)
        .egg(p(0.038, 0.005, 0.485), at(0.030, 0.026, 0.032), 0.0)
        .pairs(false);
    // Lower jaw, open, and the tongue.
    s.with(Skin::Polished, 0.03)
        .limb(p(0.0, -0.13, 0.05), 0.085, p(0.0, -0.255, 0.36), 0.046)
        .with(Skin::Plain, 0.02)
        .cut_limb(p(0.0, -0.115, 0.14), 0.040, p(0.0, -0.165, 0.44), 0.072)
        .with(Skin::Polished, 0.01)
        .chain(&[
            (p(0.0, -0.13, 0.10), 0.036),
            (p(0.0, -0.185, 0.26), 0.030),
            (p(0.0, -0.165, 0.40), 0.022),
            (p(0.0, -0.120, 0.50), 0.007),
        ])
        .egg(p(0.0, -0.315, 0.35), at(0.020, 0.055, 0.025), 0.0);
    s.pairs(true).with(Skin::Plain, 0.008);
    // Teeth.
    for i in 0..6 {
        let t = f64::from(i) / 5.0;
        let size = if i == 4 { 1.8 } else { 1.0 };
        let (x, z) = (0.082 - 0.032 * t, 0.20 + 0.27 * t);
        let top = -0.070 - 0.022 * t;
        s.limb(p(x, top, z), 0.019 * size, p(x, top - 0.045 * size, z + 0.008), 0.006);
        let (x, low) = (0.068 - 0.030 * t, -0.165 - 0.062 * t);
        s.limb(p(x, low, z - 0.05), 0.017 * size, p(x, low + 0.040 * size, z - 0.045), 0.006);
    }
    // Eyes under heavy brows, nostrils.
    s.with(Skin::Polished, 0.018)
        .limb(p(0.060, 0.105, 0.19), 0.026, p(0.125, 0.105, 0.03), 0.030)
        .with(Skin::Plain, 0.012)
        .cut_egg(p(0.108, 0.052, 0.135), at(0.036, 0.030, 0.045), 0.0)
        .with(Skin::Plain, 0.004)
        .ball(p(0.093, 0.052, 0.130), 0.031)
        .with(Skin::Plain, 0.008)
        .cut_egg(p(0.048, 0.012, 0.512), at(0.013, 0.012, 0.018), 0.0);
    // Horns, ear fins, cheek spikes, whiskers.
    s.with(Skin::Polished, 0.02)
        .chain(&[
            (p(0.085, 0.105, -0.04), 0.050),
            (p(0.140, 0.205, -0.16), 0.042),
            (p(0.185, 0.255, -0.31), 0.032),
            (p(0.200, 0.330, -0.44), 0.020),
            (p(0.190, 0.430, -0.50), 0.006),
        ])
        .limb(p(0.140, 0.01, -0.02), 0.034, p(0.270, 0.055, -0.20), 0.006)
        .limb(p(0.140, -0.06, -0.01), 0.030, p(0.250, -0.075, -0.16), 0.006)
        .limb(p(0.105, -0.13, 0.02), 0.028, p(0.180, -0.205, -0.10), 0.006)
        .with(Skin::Plain, 0.008)
        .chain(&[
            (p(0.070, -0.03, 0.47), 0.022),
            (p(0.150, -0.02, 0.52), 0.021),
            (p(0.215, -0.08, 0.49), 0.019),
            (p(0.240, -0.18, 0.42), 0.017),
            (p(0.285, -0.24, 0.37), 0.013),
        ])
        .pairs(false);
}

/// A boulder about two metres across.
pub(super) fn boulder(seed: u64) -> Figure {
    let mut s = Sculptor::new(seed ^ 0x44);
    s.with(Skin::Rock, 0.25);
    for i in 0..6 {
        let r = |k| uniform(seed ^ 0x45, i, k, 0);
        let angle = r(0);
        let centre = at(0.55 * sin_turns(angle) * r(1), 0.25 + 0.5 * r(2), 0.55 * cos_turns(angle) * r(1));
        s.block(
            centre,
            at(0.3 + 0.3 * r(3), 0.25 + 0.25 * r(4), 0.3 + 0.3 * r(5)),
            0.06,
            [0.2 * r(6), 0.2 * r(7)],
        );
    }
    s.finish()
}
