//! OBJ files: one mesh with a material per face.

mod mtl;
mod parse;
#[cfg(test)]
mod tests;
mod udim;

use std::path::{Path, PathBuf};

use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};

use crate::beside::Beside;
use crate::error::ImportError;
use crate::file::{MAX_FILE_BYTES, read_file};
use crate::model::ImportedMaterial;
use crate::shading::{FaceShading, ShadingRuns, Unshaded};
use crate::text::utf8;
use crate::triangulate::triangulate;
use crate::weld::Weld;
use mtl::Library;
use parse::{Parsed, logical_lines, parse};
use udim::Tiles;

/// Most materials of one asset, as the protocol describes them.
const MAX_MATERIALS: usize = lodestream_scene::asset::MAX_MATERIALS;

/// Imports an OBJ file and the MTL files that it names, relative to itself.
///
/// Objects and groups are merged. A missing or bad MTL file is a warning, and so is a material that
/// no MTL file defines.
///
/// # Errors
/// Whatever makes the geometry unusable, with the line; see [`ImportError`].
pub(super) fn import(path: &Path) -> Result<Unshaded, ImportError> {
    let bytes = read_file(path, MAX_FILE_BYTES)?;
    let text = utf8(&bytes);
    let parsed = parse(path, &text)?;
    let mut warnings = Vec::new();
    let mut library = Library::new();
    let beside = Beside::new(path);
    for file in libraries(path, &text, &beside, &mut warnings) {
        mtl::load(&beside, &file, &mut library, &mut warnings);
    }
    drop(text);
    drop(bytes);
    if let Some(first) = &parsed.first_bad {
        warnings.push(format!("{first}; {} such faces were left out", parsed.bad_faces));
    }
    for (count, what) in parsed.without.iter().zip(["texture coordinates", "normals"]) {
        if *count > 0 {
            warnings.push(format!(
                "{}: {count} faces name {what} that do not exist or are no finite numbers, and are read without",
                path.display()
            ));
        }
    }
    if parsed.left_out > 0 {
        warnings.push(format!(
            "{}: {} points, lines or faces with fewer than 3 corners were left out",
            path.display(),
            parsed.left_out
        ));
    }
    if parsed.clamped_colors > 0 {
        warnings.push(format!(
            "{}: {} vertices have colours outside 0 to 1, which were clamped; divide values of 0 to 255 by 255",
            path.display(),
            parsed.clamped_colors
        ));
    }
    let tiles = Tiles::new(folder(path), &parsed, &library);
    if tiles.materials() > MAX_MATERIALS {
        return Err(ImportError::TooManyMaterials {
            path: path.to_owned(),
            count: tiles.materials(),
            limit: MAX_MATERIALS,
        });
    }
    let materials = materials(path, &parsed.material_names, &library, &mut warnings);
    let materials = tiles.split(path, materials, &mut warnings);
    let (mesh, shading) = build(&parsed, &tiles);
    Ok(Unshaded { mesh, materials, shading, warnings })
}

/// The files that are read beside an OBJ file of the given content: MTL files, then textures, each
/// once, whether they exist or not.
pub(super) fn dependencies(path: &Path, bytes: &[u8]) -> Vec<PathBuf> {
    let text = utf8(bytes);
    let beside = Beside::new(path);
    let libraries = libraries(path, &text, &beside, &mut Vec::new());
    let mut library = Library::new();
    for file in &libraries {
        mtl::load(&beside, file, &mut library, &mut Vec::new());
    }
    let mut files = Vec::new();
    for file in libraries.into_iter().flat_map(|file| beside.and_named(file)) {
        if !files.contains(&file) {
            files.push(file);
        }
    }
    let folder = folder(path);
    let images = library.values().flat_map(|material| material.maps.images());
    let images = images.filter(|image| !udim::is_set(folder, image));
    let images = images.flat_map(|image| beside.and_named(image.path.clone()));
    // Which tiles there are, only the faces tell.
    let parsed = if udim::any_set(folder, &library) { parse(path, &text).ok() } else { None };
    let tiles = parsed.map(|parsed| Tiles::new(folder, &parsed, &library).images(&parsed, &library));
    for image in images.chain(tiles.into_iter().flatten()) {
        if !files.contains(&image) {
            files.push(image);
        }
    }
    files
}

/// The folder of a model, in which and below which its other files lie.
fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// MTL files named by `mtllib` lines, in order, each once.
fn libraries(path: &Path, bytes: &[u8], beside: &Beside, warnings: &mut Vec<String>) -> Vec<PathBuf> {
    let mut located = |name: &str| {
        let found = mtl::locate(beside, beside, name);
        found.map_err(|why| warnings.push(format!("{}: mtllib {why}", path.display()))).ok()
    };
    let mut files = Vec::new();
    for (_, line) in logical_lines(bytes) {
        let Some(names) = line.strip_prefix("mtllib").filter(|rest| rest.starts_with(char::is_whitespace))
        else {
            continue;
        };
        // The rest of the line is one name with blanks, or several names.
        let words = || names.split_whitespace();
        let is_there = |name: &str| mtl::locate(beside, beside, name).is_ok_and(|path| path.exists());
        let several =
            words().count() > 1 && words().all(is_there) && !beside.folder().join(names.trim()).exists();
        let named = match located(names) {
            Some(whole) if whole.exists() && !several => vec![whole],
            None if words().count() == 1 => Vec::new(),
            _ => words().filter_map(&mut located).collect(),
        };
        for file in named {
            if !files.contains(&file) {
                files.push(file);
            }
        }
    }
    files
}

fn materials(
    path: &Path,
    names: &[String],
    library: &Library,
    warnings: &mut Vec<String>,
) -> Vec<ImportedMaterial> {
    let mut undefined = Vec::new();
    let materials = names
        .iter()
        .map(|name| {
            library.get(name).cloned().unwrap_or_else(|| {
                if !name.is_empty() {
                    undefined.push(name.as_str());
                }
                ImportedMaterial::named(name)
            })
        })
        .collect();
    if let Some(first) = undefined.first() {
        warnings.push(format!(
            "{}: {} materials are in no MTL file and become grey (the first is {first:?})",
            path.display(),
            undefined.len()
        ));
    }
    materials
}

/// Welds the values that faces use, in the order of the faces, and triangulates.
fn build(parsed: &Parsed, tiles: &Tiles<'_>) -> (SourceMesh, ShadingRuns) {
    let (mut weld, mut shading) = (Weld::default(), ShadingRuns::default());
    let mut corners: &[[u32; 3]] = &parsed.corners;
    let mut polygon: Vec<Corner> = Vec::new();
    let mut points: Vec<[f64; 3]> = Vec::new();
    for face in &parsed.faces {
        let (own, rest) = corners.split_at(face.corners);
        corners = rest;
        let (material, shifted) = tiles.place(parsed, face.material, own);
        // More than MAX_MATERIALS were refused, so the index fits.
        let material = u16::try_from(material).unwrap_or(0);
        // An attribute that a corner lacks is not used at the others.
        let all_have = |kind: usize| own.iter().all(|corner| corner[kind] != 0);
        let (has_uv, has_normal) = (all_have(1), all_have(2));
        polygon.clear();
        points.clear();
        for corner in own {
            let [position, uv, normal] = corner.map(|index| (index as usize).wrapping_sub(1));
            let color = parsed.colors.get(position).copied().flatten();
            let position = weld.position(parsed.positions[position]);
            points.push(weld.mesh.positions[position as usize]);
            polygon.push(Corner {
                position,
                uv: if has_uv { weld.uv(shifted(parsed.uvs[uv])) } else { NONE },
                normal: if has_normal { weld.normal(parsed.normals[normal]) } else { NONE },
                color: color.map_or(NONE, |color| weld.color(color)),
                second_uv: NONE,
            });
        }
        for triangle in triangulate(&points) {
            weld.mesh.faces.push(triangle.map(|i| polygon[i]));
            weld.mesh.materials.push(material);
        }
        shading.push(weld.mesh.faces.len(), if has_normal { FaceShading::Given } else { face.shading });
    }
    (weld.mesh, shading)
}
