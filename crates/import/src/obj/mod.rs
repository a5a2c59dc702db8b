//! OBJ files: one mesh with a material per face.

mod mtl;
mod normalise;

use std::io::Read as _;
use std::path::{Path, PathBuf};

use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};

use crate::error::ImportError;
use crate::file::{MAX_FILE_BYTES, read_file};
use crate::model::{Imported, ImportedMaterial};
use crate::triangulate::triangulate;
use crate::weld::Weld;
use mtl::Library;
use normalise::{Format, Normalised, logical_lines, normalise, unpack_color};

/// Most materials of one asset, as the protocol describes them.
const MAX_MATERIALS: usize = lodestream_scene::asset::MAX_MATERIALS;

/// Imports an OBJ file and the MTL files that it names, relative to itself.
///
/// Objects and groups are merged. A missing or bad MTL file is a warning, and so is a material that
/// no MTL file defines.
///
/// # Errors
/// Whatever makes the geometry unusable, with the line; see [`ImportError`].
pub(super) fn import(path: &Path) -> Result<Imported, ImportError> {
    let bytes = read_file(path, MAX_FILE_BYTES)?;
    let normalised = normalise(path, &bytes)?;
    let mut warnings = Vec::new();
    let mut library = Library::new();
    for file in libraries(path, &bytes, &mut warnings) {
        mtl::load(folder(path), &file, &mut library, &mut warnings);
    }
    drop(bytes);
    if normalised.left_out > 0 {
        warnings.push(format!(
            "{}: {} points, lines or faces with fewer than 3 corners were left out",
            path.display(),
            normalised.left_out
        ));
    }
    if normalised.clamped_colors > 0 {
        warnings.push(format!(
            "{}: {} vertices have colours outside 0 to 1, which were clamped; divide values of 0 to 255 by 255",
            path.display(),
            normalised.clamped_colors
        ));
    }
    let materials = materials(path, &normalised.material_names, &library, &mut warnings)?;
    let mesh = build(path, normalised)?;
    Ok(Imported { mesh, materials, warnings })
}

/// The files that are read beside an OBJ file of the given content: MTL files, then textures, each
/// once, whether they exist or not.
pub(super) fn dependencies(path: &Path, bytes: &[u8]) -> Vec<PathBuf> {
    let mut files = libraries(path, bytes, &mut Vec::new());
    let mut library = Library::new();
    for file in &files {
        mtl::load(folder(path), file, &mut library, &mut Vec::new());
    }
    for material in library.values() {
        for image in material.maps.images() {
            if !files.contains(&image.path) {
                files.push(image.path.clone());
            }
        }
    }
    files
}

/// The folder of a model, in which and below which its other files lie.
fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// MTL files named by `mtllib` lines, in order, each once.
fn libraries(path: &Path, bytes: &[u8], warnings: &mut Vec<String>) -> Vec<PathBuf> {
    let mut located = |name: &str| {
        let found = mtl::locate(folder(path), folder(path), name);
        found.map_err(|why| warnings.push(format!("{}: mtllib {why}", path.display()))).ok()
    };
    let mut files = Vec::new();
    for (_, line) in logical_lines(bytes) {
        let Some(names) = line.strip_prefix("mtllib").filter(|rest| rest.starts_with(char::is_whitespace))
        else {
            continue;
        };
        // The rest of the line is one name with blanks, or several names.
        let named = match located(names) {
            Some(whole) if whole.exists() => vec![whole],
            None if names.split_whitespace().count() == 1 => Vec::new(),
            _ => names.split_whitespace().filter_map(&mut located).collect(),
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
) -> Result<Vec<ImportedMaterial>, ImportError> {
    if names.len() > MAX_MATERIALS {
        return Err(ImportError::TooManyMaterials {
            path: path.to_owned(),
            count: names.len(),
            limit: MAX_MATERIALS,
        });
    }
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
    Ok(materials)
}

/// Runs the parser on the checked text and merges its models.
fn build(path: &Path, normalised: Normalised) -> Result<SourceMesh, ImportError> {
    let names = normalised.material_names.len();
    let options = tobj::LoadOptions { ignore_points: true, ignore_lines: true, ..Default::default() };
    let mut text =
        "mtllib names\n".as_bytes().chain(normalised.vertices.as_bytes()).chain(normalised.faces.as_bytes());
    let (models, _) = tobj::load_obj_buf(&mut text, &options, |_| {
        // The parser sees materials only as their indices.
        let materials = (0..names).map(|i| tobj::Material { name: i.to_string(), ..Default::default() });
        Ok((materials.collect(), (0..names).map(|i| (i.to_string(), i)).collect()))
    })
    .map_err(|source| ImportError::Parser { path: path.to_owned(), source })?;
    drop(normalised);

    let mut merge = Merge::default();
    for model in models {
        merge.model(&model);
    }
    Ok(merge.weld.mesh)
}

/// Merges models into one mesh: `tobj` numbers the values of each model from 0.
#[derive(Default)]
struct Merge {
    weld: Weld,
}

impl Merge {
    fn model(&mut self, model: &tobj::Model) {
        let format = Format::from_name(&model.name);
        let mesh = &model.mesh;
        // More than MAX_MATERIALS were refused, so the index fits.
        let material = mesh.material_id.and_then(|id| u16::try_from(id).ok()).unwrap_or(0);
        let positions: Vec<u32> =
            mesh.positions.as_chunks().0.iter().map(|p| self.weld.position(*p)).collect();
        let uvs: Vec<u32> =
            mesh.texcoords.as_chunks().0.iter().map(|t| self.weld.uv(t.map(|x| x as f32))).collect();
        let normals: Vec<u32> = mesh.normals.as_chunks().0.iter().map(|n| self.weld.normal(*n)).collect();
        // One number per vertex carries the colour, the others are padding.
        let packed = mesh.vertex_color.as_chunks::<3>().0;
        let colors: Vec<u32> =
            packed.iter().map(|c| unpack_color(c[0]).map_or(NONE, |color| self.weld.color(color))).collect();
        let corner = |i: usize| Corner {
            position: positions[mesh.indices[i] as usize],
            uv: if format.uv { uvs[mesh.texcoord_indices[i] as usize] } else { NONE },
            normal: if format.normal { normals[mesh.normal_indices[i] as usize] } else { NONE },
            color: colors.get(mesh.indices[i] as usize).copied().unwrap_or(NONE),
        };
        // `tobj` gives no arities if all faces are triangles.
        let triangles = std::iter::repeat_n(3, mesh.indices.len() / 3);
        let arities: Vec<usize> = if mesh.face_arities.is_empty() {
            triangles.collect()
        } else {
            mesh.face_arities.iter().map(|&n| n as usize).collect()
        };
        let mut first = 0;
        let mut corners: Vec<Corner> = Vec::new();
        let mut points: Vec<[f64; 3]> = Vec::new();
        for arity in arities {
            corners.clear();
            corners.extend((first..first + arity).map(corner));
            points.clear();
            points.extend(corners.iter().map(|c| self.weld.mesh.positions[c.position as usize]));
            for triangle in triangulate(&points) {
                self.weld.mesh.faces.push(triangle.map(|i| corners[i]));
                self.weld.mesh.materials.push(material);
            }
            first += arity;
        }
    }
}
