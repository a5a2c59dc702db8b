//! Surfaces from OBJ files: positions and faces, nothing else.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::Surface;

/// Why a file gives no surface.
#[derive(Debug, thiserror::Error)]
pub enum ObjError {
    /// The file cannot be opened.
    #[error("{file}: cannot open the file")]
    Open {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is no OBJ file, or its faces refer to vertices that it does not have.
    #[error("{file}: not a readable OBJ file")]
    Parse {
        /// The file.
        file: String,
        /// What the parser said.
        source: tobj::LoadError,
    },
    /// A coordinate is NaN or infinite.
    #[error("{file}: vertex {vertex} has a coordinate that is not finite")]
    NotFinite {
        /// The file.
        file: String,
        /// Number of the vertex, within its object.
        vertex: usize,
    },
    /// More vertices than 32-bit indices can number.
    #[error("{file}: more than 2^32 vertices")]
    TooLarge {
        /// The file.
        file: String,
    },
}

/// The triangles of all objects of an OBJ file; polygons are cut into fans, points and lines are
/// left out, materials are not read.
///
/// # Errors
/// See [`ObjError`].
pub fn read_obj(path: &Path) -> Result<Surface, ObjError> {
    let file = path.display().to_string();
    let open = File::open(path).map_err(|source| ObjError::Open { file: file.clone(), source })?;
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, single_index: false };
    // Materials are of no interest: every library is taken for missing, which the parser tolerates.
    let no_materials = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut BufReader::new(open), &options, no_materials)
        .map_err(|source| ObjError::Parse { file: file.clone(), source })?;

    let mut surface = Surface::default();
    for model in models {
        let base = surface.positions.len();
        for (vertex, position) in model.mesh.positions.chunks_exact(3).enumerate() {
            let position = [position[0], position[1], position[2]].map(f64::from);
            if !position.iter().all(|x| x.is_finite()) {
                return Err(ObjError::NotFinite { file, vertex: vertex + 1 });
            }
            surface.positions.push(position);
        }
        if surface.positions.len() > u32::MAX as usize {
            return Err(ObjError::TooLarge { file });
        }
        let count = surface.positions.len() - base;
        for triangle in model.mesh.indices.chunks_exact(3) {
            if triangle.iter().any(|&v| v as usize >= count) {
                return Err(ObjError::Parse { file, source: tobj::LoadError::FaceVertexOutOfBounds });
            }
            surface.triangles.push([0, 1, 2].map(|i| triangle[i] + base as u32));
        }
    }
    Ok(surface)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn read(text: &str) -> Result<Surface, ObjError> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        read_obj(file.path())
    }

    #[test]
    fn objects_polygons_and_relative_indices() {
        let text = "mtllib none.mtl\no one\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl brick\nf 1 2 3 4\n\
                    o two\nv 0 0 1\nv 1 0 1\nv 0 1 1\nl 1 2\nf -3 -2 -1\n";
        let surface = read(text).unwrap();
        assert_eq!(surface.triangles.len(), 3);
        assert!((surface.diagonal() - 3f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn bad_files_are_errors() {
        assert!(matches!(read_obj(Path::new("no/such.obj")), Err(ObjError::Open { .. })));
        assert!(matches!(read("v 0 0 0\nf 1 2 3\n"), Err(ObjError::Parse { .. })));
        assert!(matches!(read("v 0 0 0\nf -1 -2 -3\n"), Err(ObjError::Parse { .. })));
        assert!(matches!(read("v 0 0\nf 1 1 1\n"), Err(ObjError::Parse { .. })));
        let nan = "v NaN 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        assert!(matches!(read(nan), Err(ObjError::NotFinite { vertex: 1, .. })));
        assert_eq!(read("# empty\n").unwrap(), Surface::default());
    }
}
