//! The facets of an STL file, which become a mesh.

use std::path::Path;

use lodestream_geometry::mesh::Corner;

use crate::error::ImportError;
use crate::model::ImportedMaterial;
use crate::shading::{FaceShading, ShadingRuns, Unshaded};
use crate::weld::Weld;

/// Bad facets are left out unless they are more than one in this many, rounded up.
const MAX_BAD_SHARE: u64 = 10;

/// The facets read so far.
pub(super) struct Facets<'a> {
    pub(super) path: &'a Path,
    weld: Weld,
    bad: u64,
    first_bad: String,
    pub(super) warnings: Vec<String>,
}

impl<'a> Facets<'a> {
    /// None yet, of the file at a path.
    pub(super) fn new(path: &'a Path) -> Self {
        let (weld, first_bad, warnings) = Default::default();
        Self { path, weld, bad: 0, first_bad, warnings }
    }

    /// Adds a facet, or counts it as bad; `what` says why for the first.
    pub(super) fn add(&mut self, corners: [[f64; 3]; 3], what: impl FnOnce() -> String) {
        if !corners.iter().flatten().all(|x| x.abs() <= f64::from(f32::MAX)) {
            return self.add_bad(what);
        }
        let corner = |place| Corner::at(self.weld.position(place));
        let face = corners.map(corner);
        self.weld.mesh.faces.push(face);
        self.weld.mesh.materials.push(0);
    }

    /// Counts a facet that is left out.
    pub(super) fn add_bad(&mut self, what: impl FnOnce() -> String) {
        if self.bad == 0 {
            self.first_bad = what();
        }
        self.bad += 1;
    }

    /// The mesh of all facets.
    ///
    /// # Errors
    /// No facets, or too many bad ones.
    pub(super) fn finish(mut self) -> Result<Unshaded, ImportError> {
        let faces = self.weld.mesh.faces.len() as u64;
        if self.bad > (faces + self.bad).div_ceil(MAX_BAD_SHARE) || faces == 0 && self.bad > 0 {
            return Err(ImportError::stl(self.path, self.first_bad));
        }
        if faces == 0 {
            return Err(ImportError::NoFaces { path: self.path.to_owned(), found: "no facets".to_owned() });
        }
        if self.bad > 0 {
            self.warnings.push(format!("{}; {} such facets were left out", self.first_bad, self.bad));
        }
        let warnings = self.warnings.iter().map(|what| format!("{}: {what}", self.path.display()));
        let warnings = warnings.collect();
        let (mesh, materials) = (self.weld.mesh, vec![ImportedMaterial::named("")]);
        let shading = ShadingRuns::all(FaceShading::Creased, mesh.faces.len());
        Ok(Unshaded { mesh, materials, shading, warnings })
    }
}
