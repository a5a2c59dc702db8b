//! Comparison of a pack with the model that it was made from.
//!
//! The model is imported and quantised with the pack's settings. Fully refined, the pack must have the same faces, with
//! the same positions, attributes and materials; wedges of every level must have attributes of the model; materials and
//! textures must be equal. The quality of coarse meshes is not checked: `lodestream-sim assess` measures it.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::preparation_settings::{PreparationSettings, ReadError};
use lodestream_geometry::DecodeError;
use lodestream_geometry::mesh::{Attributes, QuantisedMesh};
use lodestream_geometry::prepare::suit;
use lodestream_geometry::quantise::quantise;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_import::Part;
use lodestream_scene::asset::AssetDescription;

use crate::prepare::PrepareError;
use crate::prepare::Threads;
use crate::prepare::describe::describe;
use crate::prepare::texture_regions;
use lodestream_store::{LoadedAsset, PackFile, StoreError};

/// Numbers of differences; zero in a correct pack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Difference {
    /// Faces of the model, quantised.
    pub faces: usize,
    /// Faces of the model that the pack lacks.
    pub missing: usize,
    /// Faces of the pack that the model lacks.
    pub foreign: usize,
    /// Wedges of any level whose attributes occur at no wedge of the model.
    pub strange_wedges: usize,
    /// Materials and texture levels that differ.
    pub materials: usize,
}

impl Difference {
    /// Whether there is no difference.
    #[must_use]
    pub fn none(&self) -> bool {
        *self == Self { faces: self.faces, ..Self::default() }
    }
}

/// A comparison that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// The model cannot be used.
    #[error(transparent)]
    Model(#[from] PrepareError),
    /// The pack cannot be used.
    #[error(transparent)]
    Pack(#[from] StoreError),
    /// The pack's settings cannot be read.
    #[error("{}: its settings cannot be read: {why}", path.display())]
    Settings {
        /// The pack.
        path: PathBuf,
        /// What is wrong with them.
        why: ReadError,
    },
    /// The pack was made from another model or with other settings.
    #[error("{} gives another grid than {} has: the pack was made of another file", model.display(), pack.display())]
    Grid {
        /// The model.
        model: PathBuf,
        /// The pack.
        pack: PathBuf,
    },
}

/// Compares a pack with a part of a model file.
///
/// # Errors
/// See [`CompareError`].
pub fn compare(pack: &PackFile, model: &Path, part: &Part) -> Result<Difference, CompareError> {
    let asset = pack.load()?;
    let settings_error = |why| CompareError::Settings { path: pack.path().to_owned(), why };
    let preparation_settings: PreparationSettings = pack.settings()?.parse().map_err(settings_error)?;
    let crease = preparation_settings.crease_angle();
    let imported = lodestream_import::import_part(model, part, crease).map_err(PrepareError::from)?;
    let mut mesh = quantise(&imported.mesh, &preparation_settings.quantise_settings())
        .map_err(|source| PrepareError::Mesh { path: model.to_owned(), source })?;
    suit(&mut mesh, asset.base.codec);
    if mesh.grid != asset.base.grid || mesh.uv_grid != asset.base.uv_grid {
        return Err(CompareError::Grid { model: model.to_owned(), pack: pack.path().to_owned() });
    }
    let error = |source| PrepareError::Describe { path: model.to_owned(), source };
    let name = &asset.description.name;
    let described = describe(name, &imported.materials, &preparation_settings, &Threads::all_cores());
    let described = described.map_err(error)?;
    let mut description = described.description;
    texture_regions::measure(&imported.mesh, &mut description, asset.base.grid.origin);
    // Encoding quantises descriptions, so the decoded one is compared.
    let again = description.encode().and_then(|bytes| AssetDescription::decode(&bytes));
    let theirs = again.map_err(|e| error(e.into()))?;
    let mut found = geometry(&asset, &mesh).map_err(|source| pack.damaged(source))?;
    let ours = &asset.description;
    found.materials = differing(&ours.materials, &theirs.materials)
        + differing(&ours.textures, &theirs.textures)
        + pack.differing_textures(&described.textures)?;
    Ok(found)
}

/// Number of positions at which two lists differ.
fn differing<T: PartialEq>(a: &[T], b: &[T]) -> usize {
    a.iter().zip(b).filter(|(a, b)| a != b).count() + a.len().abs_diff(b.len())
}

fn geometry(asset: &LoadedAsset, mesh: &QuantisedMesh) -> Result<Difference, DecodeError> {
    // Groups are numbered within their vertex, and a wedge may stand at another one while it is coarse.
    let shown = |a: Attributes| (a.uv, a.color, a.normal);
    let known: BTreeSet<_> = mesh.wedges.iter().map(|w| shown(w.attributes)).collect();
    let strange = |a: Attributes| usize::from(!known.contains(&shown(a)));
    let mut active = ActiveMesh::growing(&asset.base);
    let mut found = Difference { faces: mesh.faces.len(), ..Difference::default() };
    found.strange_wedges = asset.base.wedges.iter().map(|w| strange(w.attributes)).sum();
    for (id, (info, payload)) in (0..).zip(asset.infos.iter().zip(&asset.chunks)) {
        let delta = active.decode(id, info, payload)?;
        found.strange_wedges += delta.wedges.iter().map(|w| strange(w.attributes)).sum::<usize>();
        active.apply(&delta).map_err(|e| DecodeError::new(format!("chunk {id}"), e.to_string()))?;
    }
    (found.missing, found.foreign) = unmatched(&faces(mesh), &faces(&active.to_mesh()));
    Ok(found)
}

/// A face independent of numbering: positions and attributes of its corners, the least first, and material.
type Shape = ([([i32; 3], Attributes); 3], u16);

fn faces(mesh: &QuantisedMesh) -> Vec<Shape> {
    let shape = |face: &lodestream_geometry::mesh::Face| {
        let mut corners = face.wedges.map(|w| {
            let wedge = mesh.wedges[w as usize];
            (mesh.positions[wedge.vertex as usize], wedge.attributes)
        });
        let turns = [0, 1, 2].map(|turn| {
            let mut turned = corners;
            turned.rotate_left(turn);
            turned
        });
        corners = turns.into_iter().min().unwrap_or(corners);
        (corners, face.material)
    };
    let mut faces: Vec<Shape> = mesh.faces.iter().map(shape).collect();
    faces.sort_unstable();
    faces
}

/// For each of two sorted lists, the number of items that the other lacks.
fn unmatched(a: &[Shape], b: &[Shape]) -> (usize, usize) {
    let (mut i, mut j, mut common) = (0, 0, 0);
    while let (Some(x), Some(y)) = (a.get(i), b.get(j)) {
        match x.cmp(y) {
            Ordering::Less => i += 1,
            Ordering::Greater => j += 1,
            Ordering::Equal => (i, j, common) = (i + 1, j + 1, common + 1),
        }
    }
    (a.len() - common, b.len() - common)
}
