//! Surfaces from OBJ files, by the server's importer: what it refuses cannot be measured either.

use std::path::Path;

use lodestream_server::import::{self, ImportError};

use super::Surface;

/// The triangles of all objects of an OBJ file; polygons are triangulated, points and lines are left
/// out, texture coordinates, normals and materials are read and dropped.
///
/// # Errors
/// See [`ImportError`].
pub fn read_obj(path: &Path) -> Result<Surface, ImportError> {
    let mesh = import::import(path)?.mesh;
    let triangles = mesh.faces.iter().map(|face| face.map(|corner| corner.position)).collect();
    Ok(Surface { positions: mesh.positions, triangles })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn read(text: &str) -> Result<Surface, ImportError> {
        let mut file = tempfile::Builder::new().suffix(".obj").tempfile().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        read_obj(file.path())
    }

    #[test]
    fn objects_polygons_and_relative_indices() {
        let text = "o one\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl brick\nf 1 2 3 4\n\
                    o two\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\n";
        let surface = read(text).unwrap();
        assert_eq!(surface.triangles.len(), 3);
        assert!((surface.diagonal() - 3f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn bad_files_are_errors_that_name_the_file() {
        let missing = read_obj(Path::new("no/such.obj")).unwrap_err();
        assert!(missing.to_string().contains("no/such.obj"), "{missing}");
        for text in ["v 0 0 0\nf 1 2 3\n", "v NaN 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "# empty\n"] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(".obj"), "{text:?}: {error}");
        }
    }
}
