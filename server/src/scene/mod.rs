//! Scenes as people describe them: a `scene.toml`, or a list of models.

mod compose;
mod file;

use std::path::{Path, PathBuf};

pub use compose::{ComposeError, Composed, compose};
pub use file::{SceneError, parse, read};

/// How finely an asset's positions are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Precision {
    /// Bits per axis.
    Bits(u8),
    /// Largest distance between a source position and its grid point, in the asset's units.
    Tolerance(f64),
}

/// A model of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Asset {
    /// Name; unique within the scene.
    pub name: String,
    /// The OBJ file.
    pub file: PathBuf,
    /// Precision of positions; the default where `None`.
    pub precision: Option<Precision>,
    /// Depth of relief, in units of texture coordinates; the default where `None`.
    pub relief_depth: Option<f32>,
}

/// A placed model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index into [`Scene::assets`].
    pub asset: usize,
    /// World position of the asset's (0, 0, 0).
    pub translation: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation: [f32; 4],
    /// World units per asset unit.
    pub scale: f32,
}

/// Where a viewer starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye.
    pub eye: [f64; 3],
    /// Point in the middle of the picture.
    pub target: [f64; 3],
    /// Roughly up.
    pub up: [f32; 3],
    /// Vertical field of view, in degrees.
    pub fov_y_degrees: f32,
}

/// Vertical field of view of a camera that does not give one, in degrees.
pub const DEFAULT_FOV_Y_DEGREES: f32 = 50.0;

/// A scene before its models are prepared.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Name.
    pub name: String,
    /// Models.
    pub assets: Vec<Asset>,
    /// Placed models; `None` puts one of each side by side, once their sizes are known.
    pub instances: Option<Vec<Instance>>,
    /// Unit vector from the scene towards the light.
    pub light_direction: [f32; 3],
    /// Linear red, green, blue of the light, intensity included.
    pub light_color: [f32; 3],
    /// Linear red, green, blue of the ambient light, intensity included.
    pub ambient: [f32; 3],
    /// Linear red, green, blue of what no surface covers.
    pub background: [f32; 3],
    /// Start camera; `None` frames everything, once sizes are known.
    pub camera: Option<Camera>,
}

impl Scene {
    /// A scene of some models, side by side.
    #[must_use]
    pub fn of_models(files: &[PathBuf]) -> Self {
        let mut assets: Vec<Asset> = Vec::new();
        for file in files {
            let stem = file.file_stem().map_or_else(|| "model".into(), |s| s.to_string_lossy());
            let taken =
                assets.iter().filter(|a| a.name == stem || a.name.starts_with(&format!("{stem}-"))).count();
            let name = if taken == 0 { stem.into_owned() } else { format!("{stem}-{}", taken + 1) };
            assets.push(Asset { name, file: file.clone(), precision: None, relief_depth: None });
        }
        let name = match &assets[..] {
            [one] => one.name.clone(),
            _ => "models".to_owned(),
        };
        Self { name, assets, ..Self::empty() }
    }

    fn empty() -> Self {
        Self {
            name: "scene".to_owned(),
            assets: Vec::new(),
            instances: None,
            light_direction: unit([0.4, 1.0, 0.6]).unwrap_or([0.0, 1.0, 0.0]),
            light_color: [1.0; 3],
            ambient: [0.25; 3],
            background: [0.35, 0.45, 0.6],
            camera: None,
        }
    }
}

/// What the command line names: scene files and models apart.
///
/// # Errors
/// See [`SceneError`]; a scene file must be the only file.
pub fn of_files(files: &[PathBuf]) -> Result<Scene, SceneError> {
    let is_scene = |file: &Path| file.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    match files {
        [] => Err(SceneError::NothingNamed),
        [file] if is_scene(file) => read(file),
        _ => match files.iter().find(|file| is_scene(file)) {
            Some(scene) => Err(SceneError::SceneAmongOthers { path: scene.clone() }),
            None => Ok(Scene::of_models(files)),
        },
    }
}

/// The vector made unit length, unless it has no direction.
fn unit(v: [f32; 3]) -> Option<[f32; 3]> {
    let length = v.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt();
    (length > 0.0 && length.is_finite()).then(|| v.map(|x| (f64::from(x) / length) as f32))
}
