//! Patches of a surface between creases, and whether they are to be flat.

use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::normals::cosine;

use super::edges::{Surface, join, root};
use super::face::{FaceShading, Flatness};

/// Up to this angle neighbours lie in one plane, in degrees: flat and smooth look alike.
const PLANAR_DEGREES: f64 = 1.0;
/// Up to this angle a flat face is taken for a sample of a curved surface: simplification replaces it by larger faces,
/// which would show edges that the model has not.
const SAMPLED_DEGREES: f64 = 3.0;

/// How much a patch bends at its edges: the sum of their lengths × angles, up to a factor.
#[derive(Clone, Copy, Default)]
struct Bend {
    /// At edges up to [`SAMPLED_DEGREES`].
    sampled: f64,
    /// At sharper ones.
    faceted: f64,
}

/// Patches: faces that are connected by edges below the crease angle.
pub(super) struct Patches {
    of_face: Vec<u32>,
    bend: Vec<Bend>,
}

impl Patches {
    pub(super) fn new(
        mesh: &SourceMesh,
        surface: &Surface,
        shading: &[FaceShading],
        least_cosine: f64,
    ) -> Self {
        let mut of_face: Vec<u32> = (0..mesh.faces.len() as u32).collect();
        let divides = |faces: [u32; 2]| {
            let [a, b] = faces.map(|face| shading[face as usize]);
            a != b
        };
        surface.edges(mesh, |edge| {
            if edge.cosine >= least_cosine && !divides(edge.faces) {
                join(&mut of_face, edge.faces[0], edge.faces[1]);
            }
        });
        for face in 0..of_face.len() as u32 {
            of_face[face as usize] = root(&mut of_face, face);
        }
        let mut bend = vec![Bend::default(); of_face.len()];
        let [planar, sampled] = [PLANAR_DEGREES, SAMPLED_DEGREES].map(cosine);
        surface.edges(mesh, |edge| {
            let [a, b] = edge.faces.map(|face| of_face[face as usize]);
            if a != b || edge.cosine >= planar {
                return;
            }
            let bend = &mut bend[a as usize];
            let at = if edge.cosine >= sampled { &mut bend.sampled } else { &mut bend.faceted };
            *at += edge.length * (1.0 - edge.cosine).max(0.0).sqrt();
        });
        Self { of_face, bend }
    }

    /// Whether faces are to be flat.
    pub(super) fn flat_faces(&self, shading: &[FaceShading]) -> Vec<Flatness> {
        let flatness = |(shading, patch): (&FaceShading, &u32)| {
            let Bend { sampled, faceted } = self.bend[*patch as usize];
            match shading {
                FaceShading::Given | FaceShading::Group(_) => Flatness::MustNot,
                _ if sampled + faceted == 0.0 => Flatness::May,
                FaceShading::Flat if faceted > sampled => Flatness::Must,
                FaceShading::Flat | FaceShading::Creased => Flatness::MustNot,
            }
        };
        shading.iter().zip(&self.of_face).map(flatness).collect()
    }
}
