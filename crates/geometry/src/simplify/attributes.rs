//! Attribute error: displacement of attributes while a chunk is missing, as lengths in grid cells.
//!
//! *Texture.* Texture deviation (Cohen, Olano and Manocha, "Appearance-preserving simplification", 1998, §5): the
//! distance between a point of the input and the place on the coarse surface with its texture coordinates, computed
//! here from the difference of texture coordinates at the nearest point and the input's local texture density. Across
//! a seam that difference is meaningless; but texture moves with vertices, so the value is bounded by the
//! displacement of the vertex. The maximum counts, of both sets of texture coordinates.
//!
//! *Shading.* The chord between the input's normal and the coarse surface's, times the input's local edge length:
//! shading below pixel size need not be exact, and a wrong normal is visible on about one input face. Normals of tiny
//! faces are noisy, so the root mean square counts.
//!
//! *Skins.* The distance between a point of the input and the nearest place of the coarse surface, both moved by their
//! joints, in each pose of the mesh (after DeCoro and Rusinkiewicz, "Pose-independent simplification of articulated
//! meshes", 2005, who sum quadrics over poses). The maximum counts.

use glam::DVec3;

use crate::mesh::distance::closest_point_on_triangle;
use crate::mesh::rows::Rows;
use crate::mesh::slot_map::SlotMap;
use crate::mesh::vec3::{Vec3, add, cross, dot, length, scale, sub, triangle_normal};
use crate::mesh::wide_bvh::WideBvh;
use crate::mesh::{UvGrid, Wedge};
use crate::simplify::live::Live;
use crate::simplify::posed::PosedMesh;

/// Most samples per region whose normals are compared.
const NORMAL_SAMPLES: usize = 400;

/// Attributes of the input at its vertices.
pub(crate) struct InputAttributes {
    normals: Vec<[f32; 3]>,
    /// Local edge length.
    spacing: Vec<f32>,
    /// Of each set of texture coordinates.
    textures: Vec<Texture>,
    posed: Option<PosedMesh>,
}

/// A set of texture coordinates of the input.
struct Texture {
    set: usize,
    grid: UvGrid,
    /// Length on the surface per unit of texture coordinates; 0 without texture.
    length_per_uv: Vec<f32>,
    /// Texture coordinates of each vertex's wedges.
    uvs: Rows<[i32; 2]>,
}

impl InputAttributes {
    /// Attributes of an uncollapsed mesh.
    pub(crate) fn new(live: &Live<'_>) -> Self {
        let area = |v: u32| -> f64 {
            let faces = live.stars.corners(v).map(|c| c / 3);
            faces.map(|f| length(normal_of(live, f))).sum::<f64>()
        };
        let spacing = (0..live.positions.len() as u32).map(|v| {
            let valence = live.stars.corners(v).count().max(1);
            (area(v) / valence as f64).sqrt() as f32
        });
        Self {
            spacing: spacing.collect(),
            normals: (0..live.positions.len() as u32).map(|v| vertex_normal(live, v)).collect(),
            textures: Texture::sets(live),
            posed: PosedMesh::new(live),
        }
    }

    /// The attribute error of a region, from its samples and the live faces nearest to them.
    pub(crate) fn error(
        &self,
        live: &Live<'_>,
        input: &WideBvh,
        samples: &[u32],
        face_near: &dyn Fn(u32) -> u32,
    ) -> f64 {
        let vertices = || samples.iter().copied().filter(|&s| (s as usize) < self.normals.len());
        let step = (samples.len() / NORMAL_SAMPLES).max(1);
        let (mut sum, mut count) = (0.0, 0.0);
        let mut normals =
            NormalCache { numbers: SlotMap::with_capacity(NORMAL_SAMPLES), normals: Vec::new() };
        for sample in vertices().step_by(step) {
            let near = NearestPoint::new(live, input.position(sample), face_near(sample));
            let around = near.vertices.map(|v| normals.at(live, v));
            let coarse = unit(near.mix(|k| around[k].map(f64::from)));
            let own = self.normals[sample as usize].map(f64::from);
            let chord = length(sub(own, coarse)) * f64::from(self.spacing[sample as usize]);
            sum += chord * chord;
            count += 1.0;
        }
        let shading = (sum / f64::max(count, 1.0)).sqrt();
        let mut worst = shading;
        for texture in &self.textures {
            worst = vertices().fold(worst, |worst, s| {
                texture.displacement(live, (s, input.position(s)), face_near(s), worst)
            });
        }
        if let Some(posed) = &self.posed {
            worst = vertices().fold(worst, |worst, s| {
                let point = input.position(s);
                let near = NearestPoint::new(live, point, face_near(s));
                let corners = near.vertices.map(|v| (v, live.positions[v as usize]));
                worst.max(posed.displacement((s, point), corners, near.weights))
            });
        }
        worst
    }
}

impl Texture {
    /// The sets that the mesh has.
    fn sets(live: &Live<'_>) -> Vec<Self> {
        let grids = (0..).zip([live.mesh().uv_grid, live.mesh().second_uv_grid]);
        grids.filter(|(_, grid)| grid.bits > 0).map(|(set, grid)| Self::new(live, set, grid)).collect()
    }

    fn new(live: &Live<'_>, set: usize, grid: UvGrid) -> Self {
        let count = live.positions.len();
        let of = |wedge: &Wedge| (wedge.vertex, wedge.attributes.uv_of_set(set));
        let uvs = Rows::new(count, || live.wedges.iter().map(of));
        let length_per_uv = (0..count as u32).map(|v| {
            let (mut surface, mut map) = (0.0, 0.0);
            for face in live.stars.corners(v).map(|c| c / 3) {
                let wedges = live.face_wedges[face as usize];
                let uv = |k: usize| uv_of(&grid, of(&live.wedges.get(wedges[k])).1);
                let ([a, b], [c, d], [e, f]) = (uv(0), uv(1), uv(2));
                map += ((c - a) * (f - b) - (d - b) * (e - a)).abs();
                surface += length(normal_of(live, face));
            }
            if map > 0.0 { (surface / map).sqrt() as f32 } else { 0.0 }
        });
        Self { set, length_per_uv: length_per_uv.collect(), grid, uvs }
    }

    /// Displacement of the texture at a vertex of the input, or `enough` if it is less.
    fn displacement(&self, live: &Live<'_>, (sample, point): (u32, Vec3), face: u32, enough: f64) -> f64 {
        let successor = live.successor(sample);
        let most = length(sub(point, live.positions[successor as usize]));
        if most <= enough {
            return enough;
        }
        // The nearest face may lie across a seam; the matching texture is then on another face around the vertex.
        let around = live.stars.corners(successor).map(|c| c / 3);
        let mut best = most;
        for face in std::iter::once(face).chain(around) {
            best = best.min(self.displacement_on(live, (sample, point), face));
            if best <= enough {
                return enough;
            }
        }
        best
    }

    /// The displacement if the texture is on the given face; at least the distance to the face.
    fn displacement_on(&self, live: &Live<'_>, (sample, point): (u32, Vec3), face: u32) -> f64 {
        let near = NearestPoint::new(live, point, face);
        let wedges = live.face_wedges[face as usize];
        let [u, v, _] = near.mix(|k| {
            let [u, v] = uv_of(&self.grid, live.wedges.get(wedges[k]).attributes.uv_of_set(self.set));
            [u, v, 0.0]
        });
        let own = self.uvs.row(sample).iter();
        let difference = own
            .map(|&uv| {
                let [a, b] = uv_of(&self.grid, uv);
                ((a - u) * (a - u) + (b - v) * (b - v)).sqrt()
            })
            .fold(f64::INFINITY, f64::min);
        near.distance.max(difference * f64::from(self.length_per_uv[sample as usize]))
    }
}

/// The point of a face nearest to a vertex of the input, as weights of the face's corners.
struct NearestPoint {
    vertices: [u32; 3],
    weights: [f64; 3],
    distance: f64,
}

impl NearestPoint {
    fn new(live: &Live<'_>, point: Vec3, face: u32) -> Self {
        let vertices = live.face_vertices[face as usize];
        let triangle = live.triangle(face as usize);
        let point = DVec3::from(point);
        let at = closest_point_on_triangle(point, triangle.map(DVec3::from));
        Self { vertices, weights: weights(at.to_array(), triangle), distance: at.distance(point) }
    }

    fn mix(&self, corner: impl Fn(usize) -> Vec3) -> Vec3 {
        (0..3).fold([0.0; 3], |sum, k| add(sum, scale(corner(k), self.weights[k])))
    }
}

/// Barycentric coordinates of a point on a triangle; those of a corner if the triangle has no area.
fn weights(p: Vec3, [a, b, c]: [Vec3; 3]) -> [f64; 3] {
    let normal = triangle_normal(a, b, c);
    let square = dot(normal, normal);
    if square <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let v = dot(cross(sub(p, a), sub(c, a)), normal) / square;
    let w = dot(cross(sub(b, a), sub(p, a)), normal) / square;
    [1.0 - v - w, v, w]
}

/// Cache of vertex normals.
struct NormalCache {
    numbers: SlotMap,
    normals: Vec<[f32; 3]>,
}

impl NormalCache {
    fn at(&mut self, live: &Live<'_>, vertex: u32) -> [f32; 3] {
        let next = self.normals.len() as u32;
        let number = self.numbers.number_or(vertex, next);
        if number == next {
            self.normals.push(vertex_normal(live, vertex));
        }
        self.normals[number as usize]
    }
}

/// Area-weighted normal of a vertex; zero without faces.
fn vertex_normal(live: &Live<'_>, vertex: u32) -> [f32; 3] {
    let faces = live.stars.corners(vertex).map(|c| c / 3);
    let sum = faces.fold([0.0; 3], |sum, face| add(sum, normal_of(live, face)));
    unit(sum).map(|x| x as f32)
}

fn normal_of(live: &Live<'_>, face: u32) -> Vec3 {
    let [a, b, c] = live.triangle(face as usize);
    triangle_normal(a, b, c)
}

fn unit(v: Vec3) -> Vec3 {
    let size = length(v);
    if size > 0.0 { scale(v, 1.0 / size) } else { v }
}

fn uv_of(grid: &UvGrid, uv: [i32; 2]) -> [f64; 2] {
    [0, 1].map(|k| f64::from(uv[k]) * grid.step[k])
}

#[cfg(test)]
mod tests {
    use crate::checkpoint::InMemoryCheckpoint;
    use crate::common;
    use crate::mesh::{Corner, SourceMesh};
    use crate::pool::{MonitoredPool, Serial, Silent};
    use crate::simplify::simplify;

    /// Largest attribute and geometric errors of the chunks of a square of 40 × 40 cells, with given heights and
    /// texture coordinates.
    fn errors(z: fn(f64, f64) -> f64, uv: fn(f32, f32) -> [f32; 2]) -> (f64, f64) {
        let mut mesh = SourceMesh::default();
        for y in 0..=40_u8 {
            for x in 0..=40_u8 {
                let (s, t) = (f64::from(x) / 40.0, f64::from(y) / 40.0);
                mesh.positions.push([s, t, z(s, t)]);
                mesh.uvs.push(uv(s as f32, t as f32));
            }
        }
        for i in (0..40).flat_map(|y| (0..40).map(move |x| y * 41 + x)) {
            for face in [[i, i + 1, i + 42], [i, i + 42, i + 41]] {
                mesh.faces.push(face.map(|v| Corner { uv: v, ..Corner::at(v) }));
                mesh.materials.push(0);
            }
        }
        let mesh = common::quantised(&mesh);
        let mut pool = MonitoredPool::new(&Serial, &Silent, mesh.faces.len());
        let checkpoint = InMemoryCheckpoint::default();
        let chunks = simplify(&mesh, &common::regions(400), &mut pool, &checkpoint).unwrap().levels.all();
        assert!(chunks.len() > 2);
        let cells = f64::from(1_u32 << mesh.grid.bits);
        let most = |error: &dyn Fn(&crate::simplify::hierarchy::RegionChunk) -> f64| {
            chunks.iter().map(error).fold(0.0, f64::max) / cells
        };
        (most(&|c| c.attribute_error), most(&|c| c.error))
    }

    #[test]
    fn a_flat_square_with_uniform_texture_has_no_attribute_error() {
        let (attributes, _) = errors(|_, _| 0.0, |s, t| [s, t]);
        // Rounding to the uv grid remains.
        assert!(attributes < 2e-3, "{attributes}");
    }

    #[test]
    fn distorted_texture_has_attribute_error() {
        let (attributes, geometric) = errors(|_, _| 0.0, |s, t| [s * s * s, t]);
        assert!(geometric < 1e-6 && attributes > 0.01, "{attributes} {geometric}");
    }

    #[test]
    fn waves_have_shading_error() {
        let (attributes, _) =
            errors(|s, _| 0.05 * (s * 10.0 - (s * 10.0).floor() - 0.5).abs(), |_, _| [0.0; 2]);
        let (flat, _) = errors(|_, _| 0.0, |_, _| [0.0; 2]);
        assert!(flat < 1e-6 && attributes > 1e-3, "{attributes} {flat}");
    }
}
