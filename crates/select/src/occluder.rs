//! A coarse surface of an asset for the occlusion test.

/// Triangles of an asset: its base mesh, or its current refinement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Occluder {
    positions: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
}

impl Occluder {
    /// An occluder from positions, in the asset's units and relative to its grid's origin, and three indices per
    /// face. Faces with an index out of range are left out.
    #[must_use]
    pub fn new(positions: Vec<[f32; 3]>, mut faces: Vec<[u32; 3]>) -> Self {
        faces.retain(|face| face.iter().all(|&corner| (corner as usize) < positions.len()));
        Self { positions, faces }
    }

    /// Positions of the corners.
    #[must_use]
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Its faces.
    #[must_use]
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }
}
