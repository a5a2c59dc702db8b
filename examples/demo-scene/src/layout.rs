//! The layout: instances, light and start camera, written as `scene.toml`.

use super::ground;
use super::maths::{cos_turns, sin_turns};
use super::noise::uniform;
use super::temple::{AXES, COLUMN, ENTABLATURE, FLOOR, PLINTH};
use glam::DVec3;
use std::fmt::Write as _;

/// Range of the avenue along z, in metres.
pub(super) const AVENUE: [f64; 2] = [14.2, 47.0];

/// One asset of the scene, as `scene.toml` lists it.
pub(super) struct AssetEntry {
    pub(super) name: &'static str,
    pub(super) file: String,
    /// Precision of positions, in bits per axis.
    pub(super) position_bits: u8,
    /// Depth of the height maps of its materials, in units of texture coordinates; 0 if it has none.
    pub(super) relief_depth: f64,
}

/// A placed asset: rotated about y by `turns`, scaled, then moved.
pub(super) struct Instance {
    pub(super) asset: &'static str,
    pub(super) translation: DVec3,
    pub(super) turns: f64,
    pub(super) scale: f64,
    /// Whether the height of `translation` is relative to the terrain.
    pub(super) on_terrain: bool,
}

fn place(asset: &'static str, x: f64, y: f64, z: f64) -> Instance {
    Instance { asset, translation: DVec3::new(x, y, z), turns: 0.0, scale: 1.0, on_terrain: false }
}

/// All instances of the scene.
pub(super) fn instances(seed: u64) -> Vec<Instance> {
    let mut all = vec![
        place("stylobate", 0.0, 0.0, 0.0),
        place("cella", 0.0, FLOOR, 0.0),
        place("entablature", 0.0, FLOOR + COLUMN, 0.0),
        place("roof", 0.0, FLOOR + COLUMN + ENTABLATURE, 0.0),
        place("avenue", 0.0, 0.0, 0.0),
    ];
    columns(&mut all);
    statues(&mut all);
    boulders(&mut all, seed);
    all
}

/// A colonnade of 6 × 11 around the walls, and two more columns in the porch.
fn columns(all: &mut Vec<Instance>) {
    let (nx, nz) = (6, 11);
    let mut column = |x: f64, z: f64| {
        let mut instance = place("column", x, FLOOR, z);
        // Quarter turns vary the texture without turning the square slabs.
        instance.turns = 0.25 * (all.len() % 4) as f64;
        all.push(instance);
    };
    for i in 0..nx {
        for j in 0..nz {
            if i == 0 || i == nx - 1 || j == 0 || j == nz - 1 {
                let x = AXES[0] * (2.0 * f64::from(i) / f64::from(nx - 1) - 1.0);
                let z = AXES[1] * (2.0 * f64::from(j) / f64::from(nz - 1) - 1.0);
                column(x, z);
            }
        }
    }
}

/// Statues on plinths along the avenue, by the stairs, and one inside.
fn statues(all: &mut Vec<Instance>) {
    // (kind, side, z, turn towards the visitor, who comes from +z)
    let pairs: [(&'static str, f64, f64); 5] = [
        ("lion", 40.5, 0.10),
        ("sage", 35.0, 0.15),
        ("dragon", 29.5, 0.08),
        ("sage", 24.0, 0.14),
        ("lion", 18.5, 0.06),
    ];
    for (kind, z, turn) in pairs {
        for side in [1.0, -1.0] {
            let x = 5.3 * side;
            all.push(place("plinth", x, 0.0, z));
            let mut statue = place(kind, x, PLINTH, z);
            statue.turns = -side * turn;
            all.push(statue);
        }
    }
    let mut guardian = place("dragon", 0.0, FLOOR, 3.0);
    guardian.scale = 1.25;
    all.push(guardian);
    for side in [1.0, -1.0] {
        let mut sage = place("sage", 2.6 * side, FLOOR, 10.2);
        sage.scale = 1.1;
        all.push(sage);
    }
}

/// Boulders strewn over the hills.
fn boulders(all: &mut Vec<Instance>, seed: u64) {
    let mut count = 0;
    for i in 0..200 {
        let r = |k| uniform(seed ^ 0xB0, i, k, 0);
        let (x, z) = ((r(0) - 0.5) * 150.0, (r(1) - 0.5) * 150.0 + 14.0);
        // None on the site.
        if count == 28 || (x.abs() < 15.0 && (z - 14.0).abs() < 40.0) {
            continue;
        }
        count += 1;
        let scale = 0.5 + 1.6 * r(2) * r(2);
        // A quarter of the boulder is below the ground.
        let translation = DVec3::new(x, -0.25 * scale, z);
        all.push(Instance { asset: "boulder", translation, turns: r(3), scale, on_terrain: true });
    }
}

/// The text of `scene.toml`.
pub(super) fn scene_text(assets: &[AssetEntry], instances: &[Instance], seed: u64) -> String {
    let mut text = format!(
        "# Lodestream's demo scene, seed {seed}. Metres, y up. Rotations are quaternions (x, y, z, w).\n\
         name = \"demo\"\n\n\
         [light]\ndirection = [0.75, 0.55, 0.36]\ncolor = [1.0, 0.88, 0.72]\nintensity = 1.75\n\n\
         [camera]\neye = [2.0, 2.5, 51.6]\ntarget = [-0.3, 4.1, 14.0]\nfov_y_degrees = 43.0\n"
    );
    text.push_str(&ground::terrain_text(seed));
    // Writing to a String cannot fail.
    for asset in assets {
        let _ = write!(
            text,
            "\n[[asset]]\nname = \"{}\"\nfile = \"{}\"\nposition_bits = {}\n",
            asset.name, asset.file, asset.position_bits
        );
        if asset.relief_depth > 0.0 {
            let _ = writeln!(text, "relief_depth = {}", asset.relief_depth);
        }
    }
    for instance in instances {
        let t = instance.translation;
        let (y, w) = (sin_turns(instance.turns * 0.5), cos_turns(instance.turns * 0.5));
        let _ = write!(
            text,
            "\n[[instance]]\nasset = \"{}\"\ntranslation = [{:.4}, {:.4}, {:.4}]\nrotation = [0.0, {y:.9}, 0.0, {w:.9}]\nscale = {:.4}\n",
            instance.asset, t.x, t.y, t.z, instance.scale
        );
        if instance.on_terrain {
            text.push_str("on_terrain = true\n");
        }
    }
    text
}
