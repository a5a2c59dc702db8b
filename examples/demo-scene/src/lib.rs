//! The demo scene: a temple among hills, an avenue of statues; and a [`city`] of parts.
//!
//! The former is computed from a seed by arithmetic alone and written as OBJ, MTL, PNG and `scene.toml`, so that it is imported
//! like any user's files. The same seed gives the same meshes, pixels and placements on every machine: only
//! `+ − × ÷ √`, `floor` and an integer hash are used (see `maths.rs`), and decimals are rounded to fixed places.
//!
//! ```text
//! noise, maths -> images (colour, height)
//!              -> sdf + skin -> sculptor -> statues -> polygonise
//!              -> mesh -> temple           |             |
//!                                          '-> obj <-----'   ground, layout -> scene.toml
//! ```

pub mod city;
mod ground;
mod images;
mod layout;
mod maths;
mod mesh;
mod noise;
mod obj;
mod polygonise;
mod sculptor;
mod sdf;
mod skin;
mod statues;
mod temple;
#[cfg(test)]
mod tests;

use layout::AssetEntry;
use mesh::ObjMesh;
use polygonise::polygonise;
use std::path::{Path, PathBuf};
use temple::Pitch;

/// Options of [`generate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Seed of the hills, the grain of the stone and the folds of the robes.
    pub seed: u64,
    /// Linear resolution relative to the full scene, 0.05 to 2. The number of faces grows with its square.
    pub detail: f64,
}

impl Options {
    /// The full scene: more than 1.2 million distinct faces, statues of more than 300,000 each.
    #[must_use]
    pub fn full(seed: u64) -> Self {
        Self { seed, detail: 1.0 }
    }

    /// The same assets and instances in about ten thousand faces, for tests and short simulations.
    #[must_use]
    pub fn small(seed: u64) -> Self {
        Self { seed, detail: 0.09 }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self::full(1)
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Summary {
    /// Meshes.
    pub assets: usize,
    /// Placed meshes.
    pub instances: usize,
    /// Faces, each mesh counted once.
    pub distinct_faces: usize,
    /// Faces, each mesh counted as often as it is placed.
    pub instanced_faces: usize,
    /// Size of all files written, in bytes.
    pub bytes: u64,
    /// The scene file to serve.
    pub scene: PathBuf,
}

/// An error of [`generate`] and [`city::generate`].
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file system refused to write.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// File or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// [`Options::detail`] is out of range.
    #[error("detail is {0}; give a number from 0.05 to 2")]
    Detail(f64),
    /// [`city::Options::parts`] is out of range.
    #[error("a city of {0} parts; give a number from 100 to 200000")]
    Parts(usize),
}

/// Lattice cells of the solids in the full scene, in metres: more than 300,000 faces a statue.
const LION_CELL: f64 = 0.0189;
const SAGE_CELL: f64 = 0.0165;
const DRAGON_CELL: f64 = 0.0228;
const BOULDER_CELL: f64 = 0.08;
/// Twice the texels per side of brick and cobble in the full scene.
const TEXTURE_SIZE: f64 = 1024.0;

/// An asset's name, bits of position (one or two millimetres), relief depth in units of texture coordinates, and the
/// function that makes it.
type AssetRow<'a> = (&'static str, u8, f64, Box<dyn Fn() -> ObjMesh + 'a>);

fn asset_rows(options: &Options) -> Vec<AssetRow<'_>> {
    let Options { seed, detail } = *options;
    let pitch = Pitch((1.0 / detail).clamp(1.0, 9.0));
    let figure = move |figure: sdf::Figure, cell: f64, name: &'static str, material: &'static str| {
        polygonise(&figure, cell / detail).single(name, material)
    };
    vec![
        ("stylobate", 14, 0.018, Box::new(move || temple::stylobate(seed, pitch))),
        ("column", 13, 0.0, Box::new(move || temple::column(pitch))),
        ("entablature", 14, 0.0, Box::new(move || temple::entablature(seed, pitch))),
        ("roof", 14, 0.0, Box::new(move || temple::roof(pitch))),
        ("cella", 14, 0.02, Box::new(move || temple::cella(pitch))),
        ("plinth", 12, 0.02, Box::new(temple::plinth)),
        ("avenue", 14, 0.02, Box::new(move || temple::avenue(seed, pitch, layout::AVENUE))),
        ("lion", 13, 0.0, Box::new(move || figure(statues::lion(seed), LION_CELL, "lion", "sandstone"))),
        ("sage", 13, 0.0, Box::new(move || figure(statues::sage(seed), SAGE_CELL, "sage", "marble"))),
        ("dragon", 13, 0.0, Box::new(move || figure(statues::dragon(seed), DRAGON_CELL, "dragon", "bronze"))),
        (
            "boulder",
            12,
            0.0,
            Box::new(move || figure(statues::boulder(seed), BOULDER_CELL, "boulder", "rock")),
        ),
    ]
}

/// Generates the scene and writes its files into `dir`, which is created if it is missing; files of the same names
/// are replaced. Takes about 15 s and 150 MB at full detail.
///
/// # Errors
/// [`Error::Detail`] for a detail out of range, [`Error::Write`] when the file system refuses.
pub fn generate(dir: &Path, options: &Options) -> Result<Summary, Error> {
    if !(0.05..=2.0).contains(&options.detail) {
        return Err(Error::Detail(options.detail));
    }
    let refused = |path: &Path| {
        let path = path.to_owned();
        move |source| Error::Write { path, source }
    };
    std::fs::create_dir_all(dir).map_err(refused(dir))?;
    let mut written = Vec::new();

    let materials = dir.join(obj::MATERIAL_FILE);
    obj::write_materials(&materials).map_err(refused(&materials))?;
    written.push(materials);
    let size = (TEXTURE_SIZE * options.detail.min(1.0)).round() as u32;
    for (name, picture) in images::all(options.seed, size) {
        let path = dir.join(name);
        images::write(&path, &picture).map_err(refused(&path))?;
        written.push(path);
    }

    let instances = layout::instances(options.seed);
    let mut assets = Vec::new();
    let (mut distinct_faces, mut instanced_faces) = (0, 0);
    for (name, position_bits, relief_depth, make) in asset_rows(options) {
        let mesh = make();
        let file = format!("{name}.obj");
        let path = dir.join(&file);
        obj::write(&path, &mesh).map_err(refused(&path))?;
        written.push(path);
        distinct_faces += mesh.faces();
        instanced_faces += mesh.faces() * instances.iter().filter(|i| i.asset == name).count();
        assets.push(AssetEntry { name, file, position_bits, relief_depth });
    }

    let scene = dir.join("scene.toml");
    let text = layout::scene_text(&assets, &instances, options.seed);
    std::fs::write(&scene, text).map_err(refused(&scene))?;
    written.push(scene.clone());
    let mut bytes = 0;
    for path in &written {
        bytes += std::fs::metadata(path).map_err(refused(path))?.len();
    }
    Ok(Summary {
        assets: assets.len(),
        instances: instances.len(),
        distinct_faces,
        instanced_faces,
        bytes,
        scene,
    })
}
