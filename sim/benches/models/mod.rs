//! Input meshes of a benchmark.

use std::path::PathBuf;

use anyhow::Context as _;
use lodestream_geometry::mesh::{Corner, QuantisedMesh, SourceMesh};
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};

/// Name, file (if any) and mesh at 12 bits of each input, after `change`: the models named on the command line, else
/// those in the folder `LODESTREAM_MODELS`, else a generated mesh.
pub(crate) fn quantised(
    change: impl Fn(&mut SourceMesh),
) -> anyhow::Result<Vec<(String, Option<PathBuf>, QuantisedMesh)>> {
    // Cargo adds `--bench`.
    let mut files: Vec<PathBuf> =
        std::env::args().skip(1).filter(|a| !a.starts_with('-')).map(PathBuf::from).collect();
    if let (true, Some(folder)) = (files.is_empty(), std::env::var_os("LODESTREAM_MODELS")) {
        let entries = std::fs::read_dir(&folder).context("LODESTREAM_MODELS cannot be read")?;
        files = entries.filter_map(|e| Some(e.ok()?.path())).collect();
        files.retain(|f| f.extension().is_some_and(|e| e == "obj"));
        files.sort();
    }
    let settings = QuantiseSettings { precision: Precision::Bits(12), ..QuantiseSettings::default() };
    if files.is_empty() {
        return Ok(vec![("generated".to_owned(), None, quantise(&height_field(200), &settings)?)]);
    }
    let load = |file: PathBuf| {
        let mut mesh = lodestream_import::import_smooth(&file)
            .with_context(|| format!("cannot import {}", file.display()))?
            .mesh;
        change(&mut mesh);
        let name = file.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let mesh = quantise(&mesh, &settings)?;
        Ok((name, Some(file), mesh))
    };
    files.into_iter().map(load).collect()
}

/// A hilly terrain of `2 × size²` faces.
fn height_field(size: u32) -> SourceMesh {
    let mut mesh = SourceMesh::default();
    for i in 0..=size {
        for j in 0..=size {
            let (x, y) = (f64::from(i), f64::from(j));
            let z = 6.0 * (x * 0.09).sin() * (y * 0.07).cos() + 0.3 * (x * 0.9 + y * 1.3).sin();
            mesh.positions.push([x, y, z]);
        }
    }
    let corner = Corner::at;
    for i in 0..size {
        for j in 0..size {
            let a = i * (size + 1) + j;
            let (b, c, d) = (a + 1, a + size + 1, a + size + 2);
            mesh.faces.extend([[a, c, d], [a, d, b]].map(|f| f.map(corner)));
        }
    }
    mesh.materials = vec![0; mesh.faces.len()];
    mesh
}
