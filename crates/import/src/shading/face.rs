//! How a face is shaded.

/// How a face is shaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaceShading {
    /// By the normals of its corners.
    Given,
    /// By its own normal.
    Flat,
    /// Smoothly with the faces of its smoothing group, whatever their angle.
    Group(u32),
    /// Smoothly with neighbours at less than the crease angle.
    Creased,
}

/// The shading of all faces of a mesh: runs of equal ones.
#[derive(Clone, Debug, Default)]
pub(crate) struct ShadingRuns {
    /// Each with the face before which it ends.
    runs: Vec<(usize, FaceShading)>,
}

impl ShadingRuns {
    /// All faces alike.
    pub(crate) fn all(shading: FaceShading, faces: usize) -> Self {
        Self { runs: vec![(faces, shading)] }
    }

    /// Says that faces up to `end`, and after those stated before, are shaded so.
    pub(crate) fn push(&mut self, end: usize, shading: FaceShading) {
        match self.runs.last_mut() {
            Some((last, same)) if *same == shading => *last = end,
            _ => self.runs.push((end, shading)),
        }
    }

    /// Whether all faces have normals.
    pub(super) fn are_given(&self) -> bool {
        self.runs.iter().all(|(_, shading)| *shading == FaceShading::Given)
    }

    /// The shading of each face.
    pub(super) fn of_faces(&self) -> impl Iterator<Item = FaceShading> + '_ {
        let mut start = 0;
        self.runs.iter().flat_map(move |&(end, shading)| {
            let run = std::iter::repeat_n(shading, end.saturating_sub(start));
            start = end;
            run
        })
    }
}

/// Whether a face's patch of surface has to be flat, may be, or must not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flatness {
    Must,
    May,
    MustNot,
}
