//! Generated scenes of any size: boulders on a square field, all of them in view.
//!
//! Each asset is a sphere with its own roughness, computed with `+ − × ÷ √`, `floor` and an integer hash only, so that
//! it is identical on every machine.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context as _;
use lodestream_bake::scene::Scene;
use lodestream_scene::description::{Camera, Instance};

/// Most faces of an asset, assets, and instances.
const MAX_FIELD_FACES: u32 = 4_000_000;
const MAX_FIELD_ASSETS: u32 = 10_000;
const MAX_FIELD_INSTANCES: u32 = 1_000_000;
/// Distance between neighbours, in metres; a boulder's radius is about 1.
const PITCH: f64 = 3.0;

/// Size of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Distinct assets.
    pub assets: u32,
    /// Faces of each, rounded to twelve times a square.
    pub faces: u32,
    /// Instances; assets take turns.
    pub instances: u32,
}

impl Field {
    /// Parses `assets=10,faces=10000,instances=100`, in any order.
    ///
    /// # Errors
    /// A text that is not of this form, or a number out of range.
    pub fn parse(text: &str) -> Result<Self, &'static str> {
        const NEEDED: &str = "is not a field; write \"field:assets=10,faces=10000,instances=100\"";
        const RANGE: &str =
            "is a field out of range: 1 to 10000 assets, 12 to 4000000 faces, 1 to 1000000 instances";
        let mut values = [None; 3];
        for part in text.split(',') {
            let (name, value) = part.split_once('=').ok_or(NEEDED)?;
            let place = ["assets", "faces", "instances"].iter().position(|known| *known == name);
            let value: u32 = value.parse().map_err(|_| NEEDED)?;
            if values[place.ok_or(NEEDED)?].replace(value).is_some() {
                return Err(NEEDED);
            }
        }
        let [Some(assets), Some(faces), Some(instances)] = values else { return Err(NEEDED) };
        let fits = (1..=MAX_FIELD_ASSETS).contains(&assets)
            && (12..=MAX_FIELD_FACES).contains(&faces)
            && (1..=MAX_FIELD_INSTANCES).contains(&instances);
        if fits { Ok(Self { assets, faces, instances }) } else { Err(RANGE) }
    }

    /// Quads along an edge of the cube that the sphere is made from; it has 12 triangles for each square of this.
    fn edge(&self) -> u32 {
        ((f64::from(self.faces) / 12.0).sqrt().round() as u32).max(1)
    }

    /// Writes the models into a folder and returns their scene.
    pub(super) fn generate(&self, folder: &Path) -> anyhow::Result<Scene> {
        let mut files = Vec::with_capacity(self.assets as usize);
        for asset in 0..self.assets {
            let file = folder.join(format!("boulder-{asset}.obj"));
            std::fs::write(&file, boulder(asset, self.edge()))
                .with_context(|| format!("{}: cannot be written", file.display()))?;
            files.push(file);
        }
        let mut scene = Scene::of_models(&files)?;
        let side = f64::from(self.instances).sqrt().ceil();
        let place = |i: u32| {
            let (row, column) = ((f64::from(i) / side).floor(), f64::from(i) % side);
            let translation = [(column - (side - 1.0) / 2.0) * PITCH, 0.0, -row * PITCH];
            Instance::at(i % self.assets, translation)
        };
        scene.instances = Some((0..self.instances).map(place).collect());
        scene.name = "field".to_owned();
        // From above the near edge, far enough that the first row fits into a picture of 16 : 9.
        let back = (side * PITCH).max(4.0);
        scene.camera = Some(Camera {
            eye: [0.0, 0.35 * back, 0.8 * back],
            target: [0.0, 0.0, -0.25 * back],
            up: [0.0, 1.0, 0.0],
            fov_y: 50_f32.to_radians(),
        });
        Ok(scene)
    }
}

/// A sphere over the faces of a cube with `edge`² quads each, its radius modulated by noise, as OBJ.
fn boulder(seed: u32, edge: u32) -> String {
    // Smooth: noise is no crease.
    let mut text = String::from("s 1\n");
    let n = edge + 1;
    for side in 0..6_u32 {
        for j in 0..n {
            for i in 0..n {
                let at = |k: u32| 2.0 * f64::from(k) / f64::from(edge) - 1.0;
                let (u, v) = (at(i), at(j));
                // Each pair of opposite sides faces outwards.
                let p = match side {
                    0 => [1.0, u, v],
                    1 => [-1.0, v, u],
                    2 => [v, 1.0, u],
                    3 => [u, -1.0, v],
                    4 => [u, v, 1.0],
                    _ => [v, u, -1.0],
                };
                let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
                let q = p.map(|x| x / length);
                let radius = 1.0 + 0.2 * fractal(u64::from(seed), q.map(|x| 1.7 * x));
                // Writing to a string cannot fail.
                let _ = writeln!(text, "v {:.6} {:.6} {:.6}", q[0] * radius, q[1] * radius, q[2] * radius);
            }
        }
    }
    for side in 0..6_u32 {
        let first = side * n * n + 1;
        for j in 0..edge {
            for i in 0..edge {
                let [a, b] = [first + j * n + i, first + (j + 1) * n + i];
                let _ = writeln!(text, "f {a} {} {}\nf {a} {} {b}", a + 1, b + 1, b + 1);
            }
        }
    }
    text
}

/// Five octaves of value noise, each with half the wavelength and amplitude of the previous, in −1 to 1.
fn fractal(seed: u64, p: [f64; 3]) -> f64 {
    let (mut sum, mut height, mut scale) = (0.0, 0.5, 1.0);
    for octave in 0..5 {
        sum += height * noise(seed * 5 + octave, p.map(|x| x * scale));
        (height, scale) = (height * 0.5, scale * 2.0);
    }
    sum
}

/// Value noise with unit cells and quintic fade (Perlin, "Improving noise", 2002).
fn noise(seed: u64, p: [f64; 3]) -> f64 {
    let cell = p.map(f64::floor);
    let t: [f64; 3] = std::array::from_fn(|k| {
        let t = p[k] - cell[k];
        t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    });
    let mut sum = 0.0;
    for corner in 0..8_u32 {
        let mut weight = 1.0;
        let mut hash = seed ^ 0x9E37_79B9_7F4A_7C15;
        for k in 0..3 {
            let far = corner >> k & 1 == 1;
            weight *= if far { t[k] } else { 1.0 - t[k] };
            // The finaliser of SplitMix64 (Steele, Lea & Flood, 2014) on each lattice point.
            hash = (hash ^ (cell[k] as i64 + i64::from(far)) as u64).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            hash ^= hash >> 29;
        }
        hash = (hash ^ (hash >> 30)).wrapping_mul(0x94D0_49BB_1331_11EB);
        sum += weight * (((hash ^ (hash >> 31)) >> 11) as f64 / (1_u64 << 53) as f64);
    }
    sum * 2.0 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_parsed() {
        let field = Field::parse("instances=7,assets=2,faces=48").unwrap();
        assert_eq!(field, Field { assets: 2, faces: 48, instances: 7 });
        let bad = ["", "assets=1", "assets=1,faces=12,instances=0", "assets=1,faces=12,instances=x"];
        for text in
            bad.into_iter().chain(["assets=1,assets=1,faces=12,instances=1", "faces=9,assets=1,instances=1"])
        {
            assert!(Field::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn its_boulders_are_closed_different_and_turned_outwards() {
        let folder = tempfile::tempdir().unwrap();
        let field = Field { assets: 2, faces: 300, instances: 5 };
        let scene = field.generate(folder.path()).unwrap();
        assert_eq!((scene.assets.len(), scene.instances.as_ref().unwrap().len()), (2, 5));
        let mut volumes = Vec::new();
        for asset in &scene.assets {
            let mesh = lodestream_import::import(&asset.file).unwrap().mesh;
            assert_eq!(mesh.faces.len(), 12 * 25);
            // Corners on shared edges of the cube have the same text, so welding closes the surface.
            let key = |p: [f64; 3]| p.map(|x| (x * 1e6).round() as i64);
            let mut edges = std::collections::BTreeMap::new();
            let mut volume = 0.0;
            for face in &mesh.faces {
                let p = face.map(|corner| mesh.positions[corner.position as usize]);
                for k in 0..3 {
                    *edges.entry((key(p[k]), key(p[(k + 1) % 3]))).or_insert(0) += 1;
                }
                let [a, b, c] = p.map(glam::DVec3::from);
                volume += a.dot(b.cross(c)) / 6.0;
            }
            assert!(edges.iter().all(|((a, b), count)| *count == 1 && edges.get(&(*b, *a)) == Some(&1)));
            assert!((2.0..7.0).contains(&volume), "{volume}");
            volumes.push(volume);
        }
        assert_ne!(volumes[0], volumes[1]);
    }
}
