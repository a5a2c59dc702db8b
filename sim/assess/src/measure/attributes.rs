//! Attribute differences between two meshes, at sample points of each against the nearest point of the other.
//!
//! Texture coordinates are compared where both meshes have them, and so on. Near a seam the nearest point
//! may lie in another chart, so maxima of texture coordinates say little where charts do not agree; root
//! mean squares and the share beyond a hundredth do.

use glam::DVec3;
use lodestream_geometry::distance::{TriangleBvh, closest_point_on_triangle};
use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};
use serde::Serialize;

use super::sample::{BLOCK, Located};
use super::{Settings, Surface, SurfaceSampler};

/// Differences of one kind of attribute, over sample points of both meshes; the larger of the two directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Differences {
    /// Root mean square.
    pub rms: f64,
    /// Largest.
    pub max: f64,
    /// Share of the points that differ by more than a hundredth of the unit.
    pub beyond: f64,
}

/// Attribute differences; `None` unless both meshes have the attribute.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AttributeDifferences {
    /// Distance of texture coordinates, in their units.
    pub uv: Option<Differences>,
    /// Chord between unit normals (2 sin of half the angle).
    pub normal: Option<Differences>,
    /// Distance of colours, each channel in 0..=1 as stored (sRGB).
    pub color: Option<Differences>,
    /// Share of the points with another material number; `None` if both have one material.
    pub material: Option<f64>,
}

/// Compares attributes; surfaces are those of the meshes. Costs one nearest-point search per sample, on one core.
#[must_use]
pub fn compare_attributes(a: &SourceMesh, b: &SourceMesh, settings: &Settings) -> AttributeDifferences {
    let [forth, back] = [(a, b, 0), (b, a, 1)].map(|(from, to, direction)| {
        let seed = settings.seed.wrapping_mul(2) | direction;
        one_way(from, to, seed, settings.samples.get())
    });
    let both = |has: fn(&SourceMesh) -> bool| has(a) && has(b);
    let larger = |kind: usize| forth[kind].differences().larger(back[kind].differences());
    AttributeDifferences {
        uv: both(|m| !m.uvs.is_empty()).then(|| larger(UV)),
        normal: both(|m| !m.normals.is_empty()).then(|| larger(NORMAL)),
        color: both(|m| !m.colors.is_empty()).then(|| larger(COLOR)),
        material: (a.materials.iter().chain(&b.materials).any(|&m| m > 0)).then(|| larger(MATERIAL).beyond),
    }
}

const UV: usize = 0;
const NORMAL: usize = 1;
const COLOR: usize = 2;
const MATERIAL: usize = 3;
/// Threshold above which a difference counts.
const BEYOND: f64 = 0.01;

#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    count: usize,
    square: f64,
    max: f64,
    beyond: usize,
}

impl Sum {
    fn add(&mut self, difference: f64) {
        self.count += 1;
        self.square += difference * difference;
        self.max = self.max.max(difference);
        self.beyond += usize::from(difference > BEYOND);
    }

    fn differences(&self) -> Differences {
        let count = self.count.max(1) as f64;
        Differences { rms: (self.square / count).sqrt(), max: self.max, beyond: self.beyond as f64 / count }
    }
}

impl Differences {
    fn larger(self, other: Self) -> Self {
        Self {
            rms: self.rms.max(other.rms),
            max: self.max.max(other.max),
            beyond: self.beyond.max(other.beyond),
        }
    }
}

fn one_way(from: &SourceMesh, to: &SourceMesh, seed: u64, samples: usize) -> [Sum; 4] {
    let mut sums = [Sum::default(); 4];
    let (surface, other) = (Surface::from(from), Surface::from(to));
    let Some(sampler) = SurfaceSampler::new(&surface) else { return sums };
    let bvh = TriangleBvh::new(&other.positions, &other.triangles);
    for block in 0..samples.div_ceil(BLOCK) {
        for here in sampler.located(seed, block, samples) {
            let Some(there) = nearest(&bvh, &other, here.point) else { continue };
            let [p, q] = [Value::at(from, &here), Value::at(to, &there)];
            for (sum, values) in sums.iter_mut().zip([(p.uv, q.uv), (p.normal, q.normal), (p.color, q.color)])
            {
                if let (Some(p), Some(q)) = values {
                    sum.add((0..4).map(|k| (p[k] - q[k]) * (p[k] - q[k])).sum::<f64>().sqrt());
                }
            }
            sums[MATERIAL].add(f64::from(u8::from(p.material != q.material)));
        }
    }
    sums
}

fn nearest(bvh: &TriangleBvh, surface: &Surface, point: DVec3) -> Option<Located> {
    let (_, triangle) = bvh.nearest(point.to_array(), f64::INFINITY)?;
    let triangle = triangle as usize;
    let corners = surface.triangles[triangle].map(|v| DVec3::from_array(surface.positions[v as usize]));
    let found = closest_point_on_triangle(point, corners);
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a);
    let square = normal.length_squared();
    // Barycentric coordinates are ratios of areas; a degenerate triangle is treated as its corner.
    let weights = if square > 0.0 {
        let share = |p: DVec3, q: DVec3| (p - found).cross(q - found).dot(normal) / square;
        [share(b, c), share(c, a), share(a, b)]
    } else {
        [1.0, 0.0, 0.0]
    };
    Some(Located { point: found, triangle, weights })
}

/// Attributes at a point; unused components are 0.
struct Value {
    uv: Option<[f64; 4]>,
    normal: Option<[f64; 4]>,
    color: Option<[f64; 4]>,
    material: u16,
}

impl Value {
    fn at(mesh: &SourceMesh, at: &Located) -> Self {
        let corners = mesh.faces[at.triangle];
        let blend = |value: &dyn Fn(&Corner) -> Option<[f64; 4]>| {
            let mut sum = [0.0; 4];
            for (corner, weight) in corners.iter().zip(at.weights) {
                for (sum, x) in sum.iter_mut().zip(value(corner)?) {
                    *sum += weight * x;
                }
            }
            Some(sum)
        };
        let pick = |index: u32| (index != NONE).then_some(index as usize);
        let uv = blend(&|c| pick(c.uv).map(|i| [mesh.uvs[i][0].into(), mesh.uvs[i][1].into(), 0.0, 0.0]));
        let color = blend(&|c| pick(c.color).map(|i| mesh.colors[i].map(|x| f64::from(x) / 255.0)));
        let normal = blend(&|c| {
            let [x, y, z] = mesh.normals[pick(c.normal)?].map(f64::from);
            Some([x, y, z, 0.0])
        });
        let unit = |n: [f64; 4]| {
            let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
            n.map(|x| if length > 0.0 { x / length } else { 0.0 })
        };
        Self { uv, color, normal: normal.map(unit), material: mesh.materials[at.triangle] }
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;

    use super::*;

    fn settings() -> Settings {
        Settings { samples: NonZeroUsize::new(6000).unwrap(), ..Settings::default() }
    }

    /// A unit square of two triangles with every attribute.
    fn square() -> SourceMesh {
        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let corner = |i: u32| Corner { uv: i, normal: i, color: i, ..Corner::at(i) };
        SourceMesh {
            uvs: positions.iter().map(|p| [p[0] as f32, p[1] as f32]).collect(),
            normals: vec![[0.0, 0.0, 1.0]; 4],
            colors: vec![[0, 0, 0, 255], [255, 0, 0, 255], [255; 4], [0, 0, 0, 255]],
            positions,
            faces: vec![[0, 1, 2].map(corner), [0, 2, 3].map(corner)],
            materials: vec![0, 1],
            ..SourceMesh::default()
        }
    }

    #[test]
    fn a_mesh_does_not_differ_from_itself() {
        let found = compare_attributes(&square(), &square(), &settings());
        for kind in [found.uv, found.normal, found.color] {
            assert!(kind.unwrap().max < 1e-9, "{found:?}");
        }
        assert_eq!(found.material, Some(0.0));
    }

    #[test]
    fn each_kind_of_attribute_difference_is_measured() {
        let mut other = square();
        other.uvs.iter_mut().for_each(|uv| uv[1] += 0.25);
        other.colors.iter_mut().for_each(|c| c[3] = 204);
        other.normals = vec![[0.0, 1.0, 0.0]; 4];
        other.materials = vec![0, 0];
        let found = compare_attributes(&square(), &other, &settings());
        let is = |found: Option<Differences>, expected: f64| {
            let found = found.unwrap();
            (found.rms - expected).abs() < 1e-6 && (found.max - expected).abs() < 1e-6 && found.beyond == 1.0
        };
        assert!(is(found.uv, 0.25), "{found:?}");
        assert!(is(found.color, 0.2), "{found:?}");
        assert!(is(found.normal, 2.0_f64.sqrt()), "{found:?}");
        assert!((found.material.unwrap() - 0.5).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn attributes_that_one_mesh_lacks_are_not_compared() {
        let mut bare = square();
        bare.faces.iter_mut().flatten().for_each(|c| *c = Corner::at(c.position));
        (bare.uvs, bare.normals, bare.colors) = (Vec::new(), Vec::new(), Vec::new());
        bare.materials = vec![0; 2];
        let found = compare_attributes(&bare, &square(), &settings());
        assert_eq!((found.uv, found.normal, found.color), (None, None, None));
        assert!(found.material.is_some());
        assert_eq!(compare_attributes(&bare, &bare, &settings()).material, None);
    }
}
