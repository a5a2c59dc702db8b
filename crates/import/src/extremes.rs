//! OBJ files with extreme values and sizes.

use std::fmt::Write as _;

use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use tempfile::TempDir;

use super::{ImportError, Imported, import};

fn read(obj: &str) -> Result<Imported, ImportError> {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("a.obj");
    std::fs::write(&path, obj).unwrap();
    import(&path)
}

#[test]
fn coordinates_from_1e_30_to_1e30_are_read_as_written() {
    for scale in ["1e-30", "1e-10", "1e10", "1e30"] {
        let mesh = read(&format!("v 0 0 0\nv {scale} 0 0\nv 0 -{scale} 0\nf 1 2 3\n")).unwrap().mesh;
        let size: f64 = scale.parse().unwrap();
        assert_eq!(mesh.positions, [[0.0; 3], [size, 0.0, 0.0], [0.0, -size, 0.0]]);
        assert_eq!(quantise(&mesh, &QuantiseSettings::default()).unwrap().faces.len(), 1);
    }
}

#[test]
fn a_polygon_of_ten_thousand_corners_becomes_that_many_triangles_less_two() {
    let mut text = String::new();
    for i in 0..10_000 {
        // A saw bent to a ring, so that every other corner is reflex.
        let (angle, r) = (f64::from(i) * 6.283e-4, 1.0 + 0.1 * f64::from(i % 2));
        let _ = writeln!(text, "v {} {} 0", r * angle.cos(), r * angle.sin());
    }
    text.push('f');
    for i in 1..=10_000 {
        let _ = write!(text, " {i}");
    }
    text.push('\n');
    let mesh = read(&text).unwrap().mesh;
    assert_eq!((mesh.faces.len(), mesh.positions.len()), (9998, 10_000));
}

#[test]
fn a_hundred_thousand_objects_of_one_triangle_each_become_one_mesh() {
    let mut text = String::new();
    for i in 0..100_000 {
        let (x, y) = (i % 316, i / 316);
        let _ = writeln!(text, "o part{i}\nv {x} {y} 0\nv {x}.5 {y} 0\nv {x} {y}.5 0\nf -3 -2 -1");
    }
    let mesh = read(&text).unwrap().mesh;
    assert_eq!((mesh.faces.len(), mesh.positions.len()), (100_000, 300_000));
}

#[test]
fn faces_that_repeat_a_vertex_are_read_and_dropped_by_quantising() {
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 1 1\nf 1 2 2\nf 1 2 3\nf 1 2 3\n";
    let mesh = read(obj).unwrap().mesh;
    assert_eq!(quantise(&mesh, &QuantiseSettings::default()).unwrap().faces.len(), 2);
    let none = read("v 0 0 0\nv 1 0 0\nf 1 1 2\n").unwrap().mesh;
    let refused = quantise(&none, &QuantiseSettings::default()).unwrap_err().to_string();
    assert!(refused.contains("no usable face (1 degenerate"), "{refused}");
}
