//! Descriptions of scenes: a `scene.toml`, or a list of models.

#[cfg(test)]
mod batch_cost_tests;
#[cfg(test)]
pub(crate) mod batch_tests;
mod batches;
mod curve;
mod file;
mod model;
mod names;
mod part_names;
mod punctual_light;
mod split;
mod surroundings;
#[cfg(test)]
mod surroundings_tests;
mod terrain;
#[cfg(test)]
mod tests;
mod up_axis;
#[cfg(test)]
mod warm_start_tests;

use std::path::{Path, PathBuf};

use crate::preparation_settings::PreparationSettings;
use crate::sources::Sources;
pub use file::{SceneError, parse, read};
pub use model::{Asset, DEFAULT_FOV_Y_DEGREES, Model, ModelAnimation, Scene};
pub use part_names::ModelPartNames;
pub use terrain::SceneTerrain;
pub use up_axis::UpAxis;

/// Extensions of models.
pub const MODEL_EXTENSIONS: [&str; 5] = ["obj", "gltf", "glb", "ply", "stl"];

/// Whether a path has one of these extensions, in any case.
#[must_use]
pub fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|own| extensions.iter().any(|wanted| own.eq_ignore_ascii_case(wanted)))
}

/// Reads the scene of the files on a command line: one scene file, or models.
///
/// # Errors
/// See [`SceneError`]; a scene file must be the only file.
pub fn of_files(files: &[PathBuf]) -> Result<Scene, SceneError> {
    of_files_with(files, &PreparationSettings::default())
}

/// As [`of_files`], with flags. The `flags` take precedence over the scene
/// file's settings in what assets there are; [`crate::prepare::Options`] has them for how these are prepared.
///
/// # Errors
/// As [`of_files`].
pub fn of_files_with(files: &[PathBuf], flags: &PreparationSettings) -> Result<Scene, SceneError> {
    of_files_in(files, flags, &Sources::default())
}

/// As [`of_files_with`], with model files that [`crate::prepare::prepare_all_of`] then need not read again.
///
/// # Errors
/// As [`of_files`].
pub fn of_files_in(
    files: &[PathBuf],
    flags: &PreparationSettings,
    sources: &Sources,
) -> Result<Scene, SceneError> {
    let is_scene = |file: &Path| file.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    match files {
        [] => Err(SceneError::NothingNamed),
        [file] if is_scene(file) => file::read_with(file, flags, sources),
        _ => match files.iter().find(|file| is_scene(file)) {
            Some(scene) => Err(SceneError::SceneAmongOthers { path: scene.clone() }),
            None => Ok(Scene::of_models_with(files, flags, sources)?),
        },
    }
}
