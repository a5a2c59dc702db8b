//! Number of a model's normals that are sent: those that deviate from the face normals by more than a tolerance.

use std::path::Path;

use anyhow::Context as _;
use lodestream_bake::preparation_settings::{NormalTolerance, PositionBits};
use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use serde::Serialize;

/// Number of wedges of a model with a normal of their own, at a tolerance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SentNormals {
    /// Name of the model's file.
    pub model: String,
    /// [`QuantiseSettings::normal_tolerance`], in degrees.
    pub tolerance_degrees: f64,
    /// Wedges of the quantised mesh.
    pub wedges: usize,
    /// Wedges with a normal of their own.
    pub sent: usize,
}

/// Counts a model file's normals at each tolerance.
///
/// # Errors
/// If the file cannot be imported or quantised.
pub fn count(
    path: &Path,
    position_bits: PositionBits,
    tolerances: &[NormalTolerance],
) -> anyhow::Result<Vec<SentNormals>> {
    let imported = lodestream_import::import_smooth(path)
        .with_context(|| format!("cannot import {}", path.display()))?;
    let model = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    let count = |&tolerance| of_mesh(&imported.mesh, &model, position_bits, tolerance);
    let counted: anyhow::Result<_> = tolerances.iter().map(count).collect();
    counted.with_context(|| format!("cannot quantise {}", path.display()))
}

fn of_mesh(
    mesh: &SourceMesh,
    model: &str,
    position_bits: PositionBits,
    tolerance: NormalTolerance,
) -> anyhow::Result<SentNormals> {
    let precision = Precision::Bits(position_bits.get());
    let tolerance_degrees = tolerance.get();
    let settings =
        QuantiseSettings { precision, normal_tolerance: tolerance_degrees, ..QuantiseSettings::default() };
    let wedges = quantise(mesh, &settings)?.wedges;
    let sent = wedges.iter().filter(|wedge| wedge.attributes.normal.is_some()).count();
    Ok(SentNormals { model: model.to_owned(), tolerance_degrees, wedges: wedges.len(), sent })
}

impl std::fmt::Display for SentNormals {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}, {}°: {} of {} wedges send their normal, {:.1} %",
            self.model,
            self.tolerance_degrees,
            self.sent,
            self.wedges,
            100.0 * self.sent as f64 / self.wedges as f64
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four separate squares in the plane z = 0, optionally with normals that deviate by 0, 4, 8 and 20 degrees from
    /// +z.
    fn squares(leaning: bool) -> String {
        let mut text = String::new();
        for (i, degrees) in (0_u32..).zip([0.0, 4.0, 8.0, 20.0_f64]) {
            for (x, y) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
                text += &format!("v {} {y} 0\n", 2 * i + x);
            }
            let lean = degrees.to_radians();
            if leaning {
                text += &format!("vn {} 0 {}\n", lean.sin(), lean.cos());
            }
            let corner = |k: u32| {
                let v = 4 * i + k;
                if leaning { format!("{v}//{}", i + 1) } else { v.to_string() }
            };
            text += &format!("f {}\n", [1, 2, 3, 4].map(corner).join(" "));
        }
        text
    }

    fn counted(text: &str, tolerances: &[f64]) -> Vec<SentNormals> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("squares.obj");
        std::fs::write(&file, text).unwrap();
        let tolerances: Vec<_> = tolerances.iter().map(|&degrees| degrees.try_into().unwrap()).collect();
        count(&file, PositionBits::default(), &tolerances).unwrap()
    }

    #[test]
    fn normals_beyond_the_tolerance_are_sent() {
        let found = counted(&squares(true), &[0.5, 5.0, 10.0, 30.0]);
        let rows: Vec<_> = found.iter().map(|n| (n.tolerance_degrees, n.wedges, n.sent)).collect();
        assert_eq!(rows, [(0.5, 16, 12), (5.0, 16, 8), (10.0, 16, 4), (30.0, 16, 0)]);
        assert!(found.iter().all(|n| n.model == "squares.obj"));
    }

    #[test]
    fn without_normals_none_is_sent() {
        let found = counted(&squares(false), &[0.0]);
        assert_eq!((found[0].wedges, found[0].sent), (16, 0));
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = count(Path::new("no/model.obj"), PositionBits::default(), &[]).unwrap_err();
        assert!(format!("{error:#}").contains("no/model.obj"), "{error:#}");
    }
}
