//! A model file that is read once, for several imports of its parts.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::content::Content;
use crate::error::ImportError;
use crate::file::is_gltf;
use crate::gltf::{self, Contents, CopyTolerance, Document, PartSize};
use crate::import::{dependencies, import_part, streamed_dependencies};
use crate::model::{Imported, Part};
use crate::shading::CreaseAngle;

/// A model file. The JSON of a glTF file is parsed once and stays in memory, its buffers are read where they are needed.
/// Files of other formats have only one part, for which they are read.
#[derive(Debug)]
pub struct ModelFile {
    path: PathBuf,
    document: Option<Document>,
    dependencies: Vec<PathBuf>,
}

impl ModelFile {
    /// The model at a path with this content.
    ///
    /// # Errors
    /// A file that cannot be read, a glTF file that cannot be parsed.
    pub fn parse(path: &Path, content: Arc<dyn Content>) -> Result<Self, ImportError> {
        if !is_gltf(path) {
            let bytes = content.read(0..content.length());
            let bytes = bytes.map_err(|source| ImportError::Read { path: path.to_owned(), source })?;
            let dependencies = dependencies(path, &bytes);
            return Ok(Self { path: path.to_owned(), document: None, dependencies });
        }
        if content.length() == 0 {
            return Err(ImportError::Empty { path: path.to_owned() });
        }
        let document = Document::parse(path, content)?;
        let dependencies = document.dependencies();
        Ok(Self { path: path.to_owned(), document: Some(document), dependencies })
    }

    /// A model of a format that is streamed ([`is_streamed`](crate::is_streamed)), of which at most the header is read.
    #[must_use]
    pub fn streamed(path: &Path) -> Self {
        Self { path: path.to_owned(), document: None, dependencies: streamed_dependencies(path) }
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The files that it names, each once, whether they exist or not.
    #[must_use]
    pub fn dependencies(&self) -> &[PathBuf] {
        &self.dependencies
    }

    /// What the file states of a part, without reading it; `None` for the whole file and for files of other formats than
    /// glTF.
    #[must_use]
    pub fn stated_size(&self, part: &Part) -> Option<PartSize> {
        self.document.as_ref()?.stated_size(part)
    }

    /// The meshes and lights of a glTF file, as [`gltf::contents`].
    ///
    /// # Errors
    /// As there, and files of other formats.
    pub fn contents(&self, copies: Option<CopyTolerance>) -> Result<Contents, ImportError> {
        match &self.document {
            Some(document) => document.contents(copies),
            None => gltf::contents(&self.path, copies),
        }
    }

    /// Imports a part.
    ///
    /// # Errors
    /// As [`crate::import`].
    pub fn import(&self, part: &Part, crease: CreaseAngle) -> Result<Imported, ImportError> {
        match &self.document {
            Some(document) => document.import(part).map(|read| read.shade(crease)),
            None => import_part(&self.path, part, crease),
        }
    }
}
