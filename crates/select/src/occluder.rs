//! A coarse surface of an asset, which hides what is behind it.

/// Triangles of an asset: its base mesh, or what is refined of it. Shared, since several sessions may look at one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Occluder {
    positions: Vec<[f32; 3]>,
    faces: Vec<[u32; 3]>,
}

impl Occluder {
    /// A surface: positions in the asset's units, relative to its grid's origin, and three of their indices a face. Faces
    /// that name positions which are not there are left out.
    #[must_use]
    pub fn new(positions: Vec<[f32; 3]>, mut faces: Vec<[u32; 3]>) -> Self {
        faces.retain(|face| face.iter().all(|&corner| (corner as usize) < positions.len()));
        Self { positions, faces }
    }

    /// Its corners.
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
