//! Shading of faces that come without normals: flat, smooth within a smoothing group, or smooth up to a crease angle
//! (docs/design/preparing.md).
//!
//! A flat surface needs no normals: its material says so ([`Material::flat`](lodestream_scene::asset::Material::flat)),
//! and the renderer takes the normal of the face that it draws. Elsewhere a corner gets a normal only at vertices where
//! faces are shaded apart; all other normals are computed from the faces that are drawn.

mod edges;
mod face;
mod patches;
#[cfg(test)]
mod tests;

use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::normals::cosine;
use lodestream_scene::asset::MAX_MATERIALS;

use crate::model::{Imported, ImportedMaterial};
use crate::setting;
use edges::Surface;
use face::Flatness;
pub(crate) use face::{FaceShading, ShadingRuns};
use patches::Patches;

setting! {
    /// Largest angle between two faces that are shaded as one smooth surface, where the file does not say what is smooth.
    CreaseAngle(f64), 0.0..=180.0, "degrees"
}

impl CreaseAngle {
    /// No edge is a crease.
    pub const SMOOTH: Self = Self(180.0);
}

impl Default for CreaseAngle {
    fn default() -> Self {
        Self(40.0)
    }
}

/// What a file has, before its faces without normals are shaded.
#[derive(Debug)]
pub(crate) struct Unshaded {
    /// The mesh; its materials index the others.
    pub(crate) mesh: SourceMesh,
    pub(crate) materials: Vec<ImportedMaterial>,
    pub(crate) shading: ShadingRuns,
    pub(crate) warnings: Vec<String>,
}

impl Unshaded {
    /// With all faces shaded.
    pub(crate) fn shade(self, crease: CreaseAngle) -> Imported {
        let Self { mut mesh, mut materials, shading, warnings } = self;
        shade(&mut mesh, &mut materials, &shading, crease);
        Imported { mesh, materials, warnings }
    }
}

/// Shades the faces of a mesh that have no normals: makes materials flat, copies materials that are flat on some of
/// their faces, and gives normals to corners where smooth surfaces end. Without such faces nothing changes.
///
/// Cost: two passes over the edges, each a sort around every vertex.
fn shade(
    mesh: &mut SourceMesh,
    materials: &mut Vec<ImportedMaterial>,
    shading: &ShadingRuns,
    crease: CreaseAngle,
) {
    if shading.are_given() {
        return;
    }
    let faces: Vec<FaceShading> = shading.of_faces().collect();
    debug_assert_eq!(faces.len(), mesh.faces.len());
    let least = cosine(crease.get());
    let surface = Surface::new(mesh, &faces);
    let flat = Patches::new(mesh, &surface, &faces, least).flat_faces(&faces);
    let flat = flat_materials(mesh, materials, flat);
    surface.give_normals(mesh, &faces, &flat, least);
}

/// Decides for each material, and copies those of which some faces have to be flat and others must not. Returns for
/// each face whether it is flat.
fn flat_materials(
    mesh: &mut SourceMesh,
    materials: &mut Vec<ImportedMaterial>,
    faces: Vec<Flatness>,
) -> Vec<bool> {
    let mut found = vec![[false; 2]; materials.len()];
    for (&material, &flatness) in mesh.materials.iter().zip(&faces) {
        if let Some([must, must_not]) = found.get_mut(usize::from(material)) {
            *must |= flatness == Flatness::Must;
            *must_not |= flatness == Flatness::MustNot;
        }
    }
    // The flat material of each.
    let mut flat_of = Vec::with_capacity(found.len());
    for (number, &[must, must_not]) in found.iter().enumerate() {
        let copied = must && must_not && materials.len() < MAX_MATERIALS;
        flat_of.push(match (must_not, copied) {
            (false, _) => u16::try_from(number).ok(),
            (true, true) => {
                let copy = materials[number].clone();
                materials.push(copy);
                u16::try_from(materials.len() - 1).ok()
            }
            // Without room for another material it stays smooth.
            (true, false) => None,
        });
    }
    let faces = mesh.materials.iter_mut().zip(faces).map(|(material, flatness)| {
        let flat = flat_of.get(usize::from(*material)).copied().flatten();
        let flat = flat.filter(|_| flatness != Flatness::MustNot);
        *material = flat.unwrap_or(*material);
        flat.is_some()
    });
    let faces = faces.collect();
    for flat in flat_of.into_iter().flatten() {
        materials[usize::from(flat)].material.flat = true;
    }
    faces
}
