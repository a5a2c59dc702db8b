//! Tangent frames for normal maps: `gradients` of `gbuffer.wgsl`, and what meshes with tangents in their vertices have.
//!
//! A frame maps slopes of a normal map along u and v to tilts of the normal. All methods here share triangles and
//! corner normals.

use glam::{DVec2, DVec3};

/// A corner of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Position.
    pub position: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// Texture coordinates.
    pub uv: DVec2,
}

/// Directions along which u and v grow, unit vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangents {
    /// Along u.
    pub u: DVec3,
    /// Along v.
    pub v: DVec3,
}

/// Method of computing a tangent frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TangentMethod {
    /// Per face, from its edges: Lengyel, "Computing tangent space basis vectors for an arbitrary mesh", 2001.
    PerFace,
    /// The sum of those around a corner, interpolated.
    Averaged,
    /// The sum, orthonormalised against the interpolated normal (Gram–Schmidt), with v from the winding of the faces.
    GramSchmidt,
    /// The same, with faces whose texture is mirrored summed by themselves, as Mikkelsen, "Simulation of wrinkled surfaces
    /// revisited", 2008, has it.
    SplitGramSchmidt,
    /// From screen-space derivatives, without vertex data: Schüler, "Normal mapping without precomputed tangents",
    /// 2006, revisited 2013. Used by the shader.
    Derivatives,
}

impl TangentMethod {
    /// All there are.
    pub const ALL: [Self; 5] =
        [Self::PerFace, Self::Averaged, Self::GramSchmidt, Self::SplitGramSchmidt, Self::Derivatives];

    /// Name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::PerFace => "per face",
            Self::Averaged => "averaged",
            Self::GramSchmidt => "averaged, Gram–Schmidt",
            Self::SplitGramSchmidt => "split by sense, Gram–Schmidt",
            Self::Derivatives => "from derivatives",
        }
    }
}

/// A triangle's own directions of u and v, as long as a unit of them is; `None` where its texture has no area.
#[must_use]
pub fn of_face([a, b, c]: [Corner; 3]) -> Option<[DVec3; 2]> {
    let (e, f) = (b.position - a.position, c.position - a.position);
    let (s, t) = (b.uv - a.uv, c.uv - a.uv);
    let det = s.x * t.y - s.y * t.x;
    (det.abs() > 1e-30).then(|| [(e * t.y - f * s.y) / det, (f * s.x - e * t.x) / det])
}

/// Gradients of u and v along the plane of a normal, as the shader takes them from what changes across the picture: any two
/// directions within the triangle do.
#[must_use]
pub fn gradients([a, b, c]: [Corner; 3], normal: DVec3) -> Option<[DVec3; 2]> {
    let (dx, dy) = (b.position - a.position, c.position - a.position);
    let (s, t) = (b.uv - a.uv, c.uv - a.uv);
    let (across_y, across_x) = (dy.cross(normal), normal.cross(dx));
    let det = dx.dot(across_y);
    (det.abs() >= 1e-30)
        .then(|| [(across_y * s.x + across_x * t.x) / det, (across_y * s.y + across_x * t.y) / det])
}

/// Triangles with what each way keeps in their corners.
#[derive(Clone, Debug)]
pub struct Mesh {
    triangles: Vec<[Corner; 3]>,
    /// Sums over the faces around each corner, all and of the same sense.
    sums: Vec<[[[DVec3; 2]; 2]; 3]>,
}

impl Mesh {
    /// Corners with equal places, normals and texture coordinates are one vertex. O(n²) in faces: for figures.
    #[must_use]
    pub fn new(triangles: Vec<[Corner; 3]>) -> Self {
        let mirrored = |of: [DVec3; 2], normal: DVec3| of[0].cross(of[1]).dot(normal) < 0.0;
        let unit = |of: [DVec3; 2]| of.map(DVec3::normalize_or_zero);
        let faces: Vec<Option<[DVec3; 2]>> = triangles.iter().map(|corners| of_face(*corners)).collect();
        let sums = triangles.iter().zip(&faces).map(|(own, of_own)| {
            own.map(|corner| {
                let mut sums = [[DVec3::ZERO; 2]; 2];
                for (other, of) in triangles.iter().zip(&faces) {
                    let (Some(of), Some(of_own)) = (of, of_own) else { continue };
                    if !other.contains(&corner) {
                        continue;
                    }
                    let alike = mirrored(*of, corner.normal) == mirrored(*of_own, corner.normal);
                    let add = |sum: &mut [DVec3; 2]| {
                        *sum = [sum[0] + unit(*of)[0], sum[1] + unit(*of)[1]];
                    };
                    let [all, of_same_sense] = &mut sums;
                    add(all);
                    if alike {
                        add(of_same_sense);
                    }
                }
                sums
            })
        });
        let sums = sums.collect();
        Self { triangles, sums }
    }

    /// Its triangles.
    #[must_use]
    pub fn triangles(&self) -> &[[Corner; 3]] {
        &self.triangles
    }

    /// A triangle's frame at a place within it, given by what its corners count for, with the interpolated normal.
    #[must_use]
    pub fn frame(&self, triangle: usize, weights: [f64; 3], way: TangentMethod) -> Option<(Tangents, DVec3)> {
        let corners = *self.triangles.get(triangle)?;
        let mix = |of: [DVec3; 3]| (0..3).map(|i| of[i] * weights[i]).sum::<DVec3>();
        let normal = mix(corners.map(|corner| corner.normal)).normalize_or_zero();
        let stored = |which: usize, k: usize| {
            let of = self.sums[triangle].map(|sums| sums[which][k].normalize_or_zero());
            mix(of).normalize_or_zero()
        };
        let [u, v] = match way {
            TangentMethod::PerFace => of_face(corners)?.map(DVec3::normalize_or_zero),
            TangentMethod::Averaged => [stored(0, 0), stored(0, 1)],
            TangentMethod::GramSchmidt | TangentMethod::SplitGramSchmidt => {
                let which = usize::from(way == TangentMethod::SplitGramSchmidt);
                let u = stored(which, 0);
                let u = (u - normal * normal.dot(u)).normalize_or_zero();
                let sense = normal.cross(u).dot(stored(which, 1));
                [u, normal.cross(u) * if sense < 0.0 { -1.0 } else { 1.0 }]
            }
            TangentMethod::Derivatives => gradients(corners, normal)?.map(DVec3::normalize_or_zero),
        };
        Some((Tangents { u, v }, normal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: f64, y: f64, uv: [f64; 2]) -> Corner {
        Corner { position: DVec3::new(x, y, 0.0), normal: DVec3::Z, uv: uv.into() }
    }

    #[test]
    fn on_a_plane_all_tangent_methods_agree() {
        // u runs along the diagonal, v across it, with different scales.
        let uv = |x: f64, y: f64| [3.0 * (x + y), 0.5 * (y - x)];
        let at = |x, y| corner(x, y, uv(x, y));
        let mesh = Mesh::new(vec![
            [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0)],
            [at(0.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)],
        ]);
        for way in TangentMethod::ALL {
            let (Tangents { u, v }, normal) = mesh.frame(1, [0.2, 0.3, 0.5], way).unwrap();
            let half = 0.5_f64.sqrt();
            assert!(u.distance(DVec3::new(half, half, 0.0)) < 1e-12, "{}: {u}", way.name());
            assert!(v.distance(DVec3::new(-half, half, 0.0)) < 1e-12 && normal == DVec3::Z);
        }
    }

    #[test]
    fn where_a_texture_is_mirrored_sums_cancel_unless_they_are_split() {
        // To the left of x = 0, u is mirrored.
        let at = |x: f64, y: f64| corner(x, y, [x.abs(), y]);
        let mesh = Mesh::new(vec![
            [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)],
            [at(0.0, 0.0), at(0.0, 1.0), at(-1.0, 0.0)],
        ]);
        let along_u = |weights, way| mesh.frame(1, weights, way).unwrap().0.u;
        // At the seam the sums of both sides cancel.
        for way in [TangentMethod::Averaged, TangentMethod::GramSchmidt] {
            assert_eq!(along_u([0.6, 0.4, 0.0], way), DVec3::ZERO, "{}", way.name());
        }
        for way in [TangentMethod::PerFace, TangentMethod::SplitGramSchmidt, TangentMethod::Derivatives] {
            for weights in [[0.6, 0.4, 0.0], [0.6, 0.3, 0.1]] {
                assert!(along_u(weights, way).distance(DVec3::NEG_X) < 1e-12, "{}", way.name());
            }
        }
        let flat = [at(0.0, 0.0), at(0.0, 0.5), at(0.0, 1.0)];
        assert!(of_face(flat).is_none() && gradients(flat, DVec3::Z).is_none());
    }
}
