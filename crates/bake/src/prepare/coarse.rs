//! Coarse stand-ins of large models, which take a small part of the time of their preparation: clustered meshes without
//! textures.

use std::path::Path;

use lodestream_geometry::mesh::{NONE, SourceMesh};
use lodestream_import::srgb::srgb_to_linear;
use lodestream_import::{Imported, ImportedMaterial};
use lodestream_scene::asset::Alpha;
use lodestream_store::PackFile;

use super::describe::FALLBACK_COLOR;
use super::settings_key::pack_version;
use super::{Keyed, Options, PrepareError, cache, is_pack, open_pack, prepare_with_key};
use crate::cluster::clustered;
use crate::scene::Asset;
use crate::sources::Sources;

/// Faces of all stand-ins of a scene together: prepared in some tenths of a second.
const COARSE_FACES: usize = 30_000;
/// Fewest faces of a stand-in.
const MIN_FACES: usize = 500;
/// Fewest faces of a scene's unprepared models for which stand-ins are worth their time.
pub const MIN_SCENE_FACES: usize = 100_000;
/// Most unprepared assets of a scene with stand-ins: with more of them, each is small and soon prepared.
const MAX_ASSETS: usize = 64;

/// A pack for each asset: that of the cache, or a coarse stand-in, which is written to `folder`. `None` if all packs are in
/// the cache, the others are small or many, or a stand-in has no face. What was imported is kept in `sources` for the preparation.
///
/// # Errors
/// Of an asset that cannot be imported, with its number.
pub fn stand_ins(
    assets: &[Asset],
    cache: &Path,
    folder: &Path,
    options: &Options,
    sources: &Sources,
) -> Result<Option<Vec<PackFile>>, (usize, PrepareError)> {
    let mut packs: Vec<Option<PackFile>> = Vec::with_capacity(assets.len());
    let mut missing = Vec::new();
    for (number, asset) in assets.iter().enumerate() {
        let at = |error| (number, error);
        if is_pack(&asset.file) {
            packs.push(Some(open_pack(&asset.file).map_err(at)?.pack));
            continue;
        }
        let keyed = Keyed::new(asset, options, sources).map_err(|error| at(error.into()))?;
        // What is damaged is found out when the scene is prepared.
        let cached = PackFile::open(&keyed.key.path(cache, &keyed.asset.name)).ok();
        let cached = cached.filter(|pack| pack.made_from() == keyed.key.bytes());
        if cached.is_none() {
            missing.push((number, keyed));
        }
        packs.push(cached);
        if missing.len() > MAX_ASSETS {
            return Ok(None);
        }
    }
    let most = (COARSE_FACES / missing.len().max(1)).max(MIN_FACES);
    let (mut faces, mut coarse) = (0, Vec::new());
    for (number, keyed) in missing {
        let Keyed { asset, source, key, imported } = keyed;
        let crease = asset.preparation_settings.crease_angle();
        let imported = imported.map_or_else(|| source.import(&asset.part, crease), Ok);
        let imported = imported.map_err(|error| (number, error.into()))?;
        faces += imported.mesh.faces.len();
        let stand_in = Imported {
            mesh: stand_in_mesh(&imported.mesh, most),
            materials: imported.materials.iter().map(untextured).collect(),
            warnings: Vec::new(),
        };
        source.keep(&asset.part, crease, imported);
        let key = cache::Key::of_settings(&[b"stand-in".as_slice(), &key.bytes()].concat(), pack_version());
        coarse.push((number, Keyed { asset, source, key, imported: Some(stand_in) }));
    }
    if faces < MIN_SCENE_FACES {
        return Ok(None);
    }
    let options = Options { quiet: true, keep_levels: false, ..options.clone() };
    for (number, keyed) in coarse {
        let path = folder.join(format!("{number}.lsp"));
        // Clusters of a mesh may have no face: whether the model is at fault shows when it is prepared.
        let made = prepare_with_key(keyed, &options, &path).and_then(|_| Ok(PackFile::open(&path)?));
        let Ok(made) = made else { return Ok(None) };
        packs[number] = Some(made);
    }
    Ok(packs.into_iter().collect())
}

/// The mesh itself if it is small.
fn stand_in_mesh(mesh: &SourceMesh, most: usize) -> SourceMesh {
    let mut coarse = if mesh.faces.len() > most { clustered(mesh, most) } else { mesh.clone() };
    // Without textures there is nothing to place.
    coarse.uvs.clear();
    coarse.second_uvs.clear();
    coarse.faces.iter_mut().flatten().for_each(|corner| (corner.uv, corner.second_uv) = (NONE, NONE));
    coarse
}

/// A material without its images.
fn untextured(imported: &ImportedMaterial) -> ImportedMaterial {
    let ImportedMaterial { material, maps, .. } = imported;
    let mut plain = ImportedMaterial { material: material.clone(), ..ImportedMaterial::default() };
    let [r, g, b, opacity] = material.base_color;
    if maps.color.is_some() && [r, g, b] == [1.0; 3] {
        let [r, g, b] = FALLBACK_COLOR.map(srgb_to_linear);
        plain.material.base_color = [r, g, b, opacity];
    }
    // Factors multiply their maps: without the maps, everything would be metallic, emissive or transparent.
    if maps.surface.metallic.is_some() {
        plain.material.metallic = 0.0;
    }
    if maps.emission.is_some() {
        plain.material.emission = [0.0; 3];
    }
    if maps.color.is_some() || maps.opacity.is_some() {
        plain.material.alpha = Alpha::Opaque;
    }
    plain
}
