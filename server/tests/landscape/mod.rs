//! A rolling ground, as an OBJ file.

use std::fmt::Write as _;

/// A landscape of `2 × size²` faces.
pub(crate) fn obj(size: u32) -> String {
    let mut text = String::new();
    for i in 0..=size {
        for j in 0..=size {
            let (x, y) = (f64::from(i), f64::from(j));
            let z = 6.0 * (x * 0.09).sin() * (y * 0.07).cos() + 0.3 * (x * 0.9 + y * 1.3).sin();
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
    }
    for (i, j) in (0..size).flat_map(|i| (0..size).map(move |j| (i, j))) {
        let a = i * (size + 1) + j + 1;
        let (b, c, d) = (a + 1, a + size + 1, a + size + 2);
        writeln!(text, "f {a} {c} {d}\nf {a} {d} {b}").unwrap();
    }
    text
}
