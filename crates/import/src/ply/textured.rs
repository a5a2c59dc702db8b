//! Textures of a PLY file: comments `TextureFile NAME` in the header, with coordinates per vertex, or per face as MeshLab
//! writes them (VCGlib, `wrap/io_trimesh/import_ply.h`): a list `texcoord` of u and v for each corner, and a number
//! `texnumber` where there are several textures.

use std::path::{Path, PathBuf};

use super::header::{Element, Property};
use crate::beside::Beside;
use crate::error::ImportError;
use crate::model::{ImageSource, ImportedMaterial};

/// Most materials of one asset, as the protocol describes them.
const MAX_MATERIALS: usize = lodestream_scene::asset::MAX_MATERIALS;

/// Where a texture is: at the stated path below the model's folder, else under its name beside the model.
fn located(beside: &Beside, stated: &str) -> Option<PathBuf> {
    let name = stated.trim_matches('"').replace('\\', "/");
    let relative = Path::new(&name);
    let is_inside = relative
        .components()
        .all(|part| matches!(part, std::path::Component::Normal(_) | std::path::Component::CurDir));
    let path = is_inside.then(|| beside.folder().join(relative));
    if path.as_ref().is_some_and(|path| path.exists()) {
        return path;
    }
    beside.named(&name).or(path).or_else(|| beside.plain(&name))
}

/// The files that textures of these names are read from, whether they exist or not.
pub(super) fn files(model: &Path, textures: &[String]) -> Vec<PathBuf> {
    let beside = Beside::new(model);
    let mut files = Vec::new();
    for file in textures.iter().filter_map(|name| located(&beside, name)) {
        for file in beside.and_named(file) {
            if !files.contains(&file) {
                files.push(file);
            }
        }
    }
    files
}

/// The materials of a file: one without texture, then one for each texture.
#[derive(Debug, Default)]
pub(super) struct Materials {
    images: Vec<Option<PathBuf>>,
}

impl Materials {
    pub(super) fn new(model: &Path, textures: &[String]) -> Self {
        let beside = Beside::new(model);
        // A face can name no more.
        let textures = textures.iter().take(usize::from(u16::MAX));
        Self { images: textures.map(|name| located(&beside, name)).collect() }
    }

    /// Number of a face's material: without a number of a texture the first; 0 if there is no such texture.
    pub(super) fn of_face(&self, texture: &FaceTexture) -> u16 {
        let number = texture.number.unwrap_or(0.0);
        let known = number >= 0.0 && number < self.images.len() as f64 && number.fract() == 0.0;
        if known { number as u16 + 1 } else { 0 }
    }

    /// The materials that faces use; renumbers those of the faces.
    ///
    /// # Errors
    /// More than an asset may have.
    pub(super) fn used(self, path: &Path, faces: &mut [u16]) -> Result<Vec<ImportedMaterial>, ImportError> {
        let mut numbers = vec![None; self.images.len() + 1];
        let mut used = Vec::new();
        for face in faces {
            let number = numbers.get_mut(usize::from(*face));
            // Faces have numbers of this list.
            let Some(number) = number else { continue };
            *face = *number.get_or_insert_with(|| {
                used.push(usize::from(*face));
                (used.len() - 1) as u16
            });
        }
        if used.len() > MAX_MATERIALS {
            let (path, count) = (path.to_owned(), used.len());
            return Err(ImportError::TooManyMaterials { path, count, limit: MAX_MATERIALS });
        }
        let material = |number: usize| {
            let image = number.checked_sub(1).and_then(|at| self.images.get(at).cloned());
            let name = if number < 2 { String::new() } else { format!("texture-{}", number - 1) };
            let mut material = ImportedMaterial::named(name);
            if let Some(image) = image.flatten() {
                material.maps.color = Some(ImageSource::from(image));
                material.material.base_color = [1.0; 4];
            }
            material
        };
        Ok(used.into_iter().map(material).collect())
    }
}

/// What the properties of a face say about its texture.
pub(super) struct FaceTexture {
    /// Places of `texcoord` and `texnumber` among the properties.
    list: Option<usize>,
    selector: Option<usize>,
    coordinates: Vec<f32>,
    number: Option<f64>,
}

impl FaceTexture {
    /// The properties of an element that matter if the file has textures.
    pub(super) fn declared(element: &Element, materials: &Materials) -> Self {
        let place = |is: &dyn Fn(&Property) -> bool| {
            element.properties.iter().position(is).filter(|_| !materials.images.is_empty())
        };
        let list = place(&|property| property.name == "texcoord" && property.length.is_some());
        let selector = place(&|property| property.name == "texnumber" && property.length.is_none());
        Self { list, selector, coordinates: Vec::new(), number: None }
    }

    /// Whether the property at a place is read.
    pub(super) fn has(&self, place: usize) -> bool {
        [self.list, self.selector].contains(&Some(place))
    }

    /// Begins a face.
    pub(super) fn clear(&mut self) {
        self.coordinates.clear();
        self.number = None;
    }

    /// A number of the property at a place.
    pub(super) fn add(&mut self, place: usize, number: f64) {
        if self.list == Some(place) {
            self.coordinates.push(number as f32);
        } else if self.selector == Some(place) {
            self.number = Some(number);
        }
    }

    /// Coordinates of the corners of a face, v up; `None` if it has not just as many, all finite.
    pub(super) fn uvs(&self, corners: usize) -> Option<impl Iterator<Item = [f32; 2]> + '_> {
        let pairs = self.coordinates.as_chunks().0;
        let whole = self.coordinates.len() == 2 * corners && corners > 0;
        (whole && self.coordinates.iter().all(|x| x.is_finite())).then(|| pairs.iter().copied())
    }
}
