//! Wedge normals: computed from the faces, stored only where the source differs.
//!
//! The computed normal of a wedge is the area-weighted sum of the normals of the faces at its vertex whose corners
//! share its normal group (Gouraud 1971, with the weights of the cross product). If the source's normal differs by
//! more than a tolerance, the wedge stores it.

use crate::mesh::QuantisedMesh;
use crate::mesh::octahedral;
use crate::mesh::vec3::{Vec3, add, dot, length, triangle_normal};

/// The unit normal of each wedge: explicit, else computed; zero if the faces have no area. Cost: a sort of the wedges
/// and one pass over the faces.
#[must_use]
pub fn wedge_normals(mesh: &QuantisedMesh) -> Vec<[f64; 3]> {
    let computed = computed(mesh);
    let unit = |n: Vec3| {
        let size = length(n);
        if size > 0.0 { n.map(|x| x / size) } else { [0.0; 3] }
    };
    let explicit = mesh.wedges.iter().map(|wedge| wedge.attributes.normal);
    explicit.zip(computed).map(|(own, sum)| own.map_or_else(|| unit(sum), octahedral::decode)).collect()
}

/// Stores explicit normals in the wedges whose `source` normal differs from the computed one by more than `tolerance`
/// degrees. `source` has a unit normal per wedge, or zero for none.
pub(crate) fn store_explicit(mesh: &mut QuantisedMesh, source: &[Vec3], tolerance: f64) {
    let tolerance = tolerance.clamp(0.0, 180.0);
    let least = cosine(tolerance);
    let computed = computed(mesh);
    for ((wedge, &meant), sum) in mesh.wedges.iter_mut().zip(source).zip(computed) {
        let size = length(sum);
        let far = if size > 0.0 { dot(meant, sum) < least * size } else { tolerance < 180.0 };
        if far && meant != [0.0; 3] {
            wedge.attributes.normal = Some(octahedral::encode(meant));
        }
    }
}

/// Sum of the face normals over each wedge's normal group, not normalised.
fn computed(mesh: &QuantisedMesh) -> Vec<Vec3> {
    // Sorting by (vertex, group) makes wedges of one group adjacent.
    let key = |w: u32| (mesh.wedges[w as usize].vertex, mesh.wedges[w as usize].attributes.group);
    let mut order: Vec<u32> = (0..mesh.wedges.len() as u32).collect();
    order.sort_unstable_by_key(|&w| (key(w), w));
    let mut sum_of = vec![0_u32; mesh.wedges.len()];
    let mut count = 0_u32;
    for (i, &wedge) in order.iter().enumerate() {
        if i > 0 && key(order[i - 1]) != key(wedge) {
            count += 1;
        }
        sum_of[wedge as usize] = count;
    }
    drop(order);
    let mut sums = vec![[0.0; 3]; count as usize + 1];
    for face in &mesh.faces {
        let place = |w: u32| mesh.positions[mesh.wedges[w as usize].vertex as usize].map(f64::from);
        let [a, b, c] = face.wedges.map(place);
        let normal = triangle_normal(a, b, c);
        for wedge in face.wedges {
            let sum = &mut sums[sum_of[wedge as usize] as usize];
            *sum = add(*sum, normal);
        }
    }
    sum_of.into_iter().map(|i| sums[i as usize]).collect()
}

/// Cosine of `0..=180` degrees, to 2e-14: a Taylor series for an eighth of the angle, doubled three times. libm
/// results differ between machines, and packs must not.
#[must_use]
pub fn cosine(degrees: f64) -> f64 {
    let x = degrees * (std::f64::consts::PI / 180.0) / 8.0;
    let square = x * x;
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..12 {
        let n = 2.0 * f64::from(k);
        term = -term * square / (n * (n - 1.0));
        sum += term;
    }
    (0..3).fold(sum, |c, _| 2.0 * c * c - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Attributes, Face, Grid, UvGrid, Wedge};

    /// A square in the plane z = 0, facing +z, all corners in one group.
    fn square() -> QuantisedMesh {
        let wedge = |vertex| Wedge { vertex, attributes: Attributes::default() };
        QuantisedMesh {
            grid: Grid { origin: [0.0; 3], step: 1.0, bits: 4 },
            uv_grid: UvGrid::NONE,
            second_uv_grid: UvGrid::NONE,
            positions: vec![[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]],
            wedges: (0..4).map(wedge).collect(),
            faces: [[0, 1, 2], [0, 2, 3]].map(|wedges| Face { wedges, material: 0 }).to_vec(),
            parts: Vec::new(),
            skins: Vec::new(),
            poses: Vec::new(),
        }
    }

    #[test]
    fn only_normals_beyond_the_tolerance_are_stored() {
        let tilted = |degrees: f64| [degrees.to_radians().sin(), 0.0, degrees.to_radians().cos()];
        let source = [tilted(0.0), tilted(4.9), tilted(5.1), [0.0; 3]];
        let mut mesh = square();
        store_explicit(&mut mesh, &source, 5.0);
        let kept: Vec<bool> = mesh.wedges.iter().map(|w| w.attributes.normal.is_some()).collect();
        assert_eq!(kept, [false, false, true, false]);
        let normals = wedge_normals(&mesh);
        assert_eq!(normals[1], [0.0, 0.0, 1.0]);
        assert!(dot(normals[2], source[2]) > 0.3_f64.to_radians().cos());
        let mut all = square();
        store_explicit(&mut all, &source.map(|_| tilted(0.5)), 0.0);
        assert!(all.wedges.iter().all(|w| w.attributes.normal.is_some()));
        let mut none = square();
        store_explicit(&mut none, &[[0.0, 0.0, -1.0]; 4], 180.0);
        assert_eq!(none, square());
    }

    #[test]
    fn a_star_without_area_stores_the_source_normal() {
        let mut mesh = square();
        mesh.positions = vec![[0, 0, 0]; 4];
        assert_eq!(wedge_normals(&mesh)[0], [0.0; 3]);
        store_explicit(&mut mesh, &[[0.0, 1.0, 0.0]; 4], 10.0);
        assert_eq!(wedge_normals(&mesh)[0], [0.0, 1.0, 0.0]);
    }

    #[test]
    fn the_cosine_is_that_of_libm() {
        for i in 0..=1800 {
            let degrees = f64::from(i) / 10.0;
            assert!((cosine(degrees) - degrees.to_radians().cos()).abs() < 2e-14, "{degrees}");
        }
    }
}
