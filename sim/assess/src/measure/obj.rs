//! Surfaces from OBJ files, read by the server's importer; files that it refuses cannot be measured.

use std::path::Path;

use lodestream_geometry::mesh::SourceMesh;
use lodestream_import::ImportError;

use super::Surface;

/// The triangles of all objects of an OBJ file: polygons are triangulated, points and lines omitted, attributes and
/// materials ignored.
///
/// # Errors
/// See [`ImportError`].
pub fn read_obj(path: &Path) -> Result<Surface, ImportError> {
    Ok(Surface::from(&lodestream_import::import_smooth(path)?.mesh))
}

/// Two models with attributes. Materials of the same name get the same number in both.
///
/// # Errors
/// See [`ImportError`].
pub fn read_models(a: &Path, b: &Path) -> Result<[SourceMesh; 2], ImportError> {
    let (first, mut second) = (lodestream_import::import_smooth(a)?, lodestream_import::import_smooth(b)?);
    let number: Vec<u16> = second
        .materials
        .iter()
        .map(|m| first.materials.iter().position(|other| other.material.name == m.material.name))
        .map(|found| found.and_then(|i| u16::try_from(i).ok()).unwrap_or(u16::MAX))
        .collect();
    second.mesh.materials.iter_mut().for_each(|m| *m = number[usize::from(*m)]);
    Ok([first.mesh, second.mesh])
}

impl From<&SourceMesh> for Surface {
    fn from(mesh: &SourceMesh) -> Self {
        let triangles = mesh.faces.iter().map(|face| face.map(|corner| corner.position)).collect();
        Self { positions: mesh.positions.clone(), triangles }
    }
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
    fn materials_are_matched_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let model = |name: &str, order: [&str; 2]| {
            let [one, other] = order;
            let text = format!(
                "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl {one}\nf 1 2 3\nusemtl {other}\nf 1 2 4\n"
            );
            let path = dir.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let (a, b) = (model("a.obj", ["brick", "glass"]), model("b.obj", ["glass", "wood"]));
        let [first, second] = read_models(&a, &b).unwrap();
        assert_eq!(first.materials, [0, 1]);
        assert_eq!(second.materials, [1, u16::MAX]);
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
