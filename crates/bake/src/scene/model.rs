//! A scene before its models are prepared.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::preparation_settings::PreparationSettings;
use glam::{DQuat, DVec3};
use lodestream_import::{ImportError, Part, gltf, is_gltf};
use lodestream_scene::description::{Camera, DEFAULT_AMBIENT, DEFAULT_BACKGROUND};
use lodestream_scene::punctual_lights::PunctualLight;

use super::names::UniqueNames;
use super::terrain::SceneTerrain;

/// A model of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Asset {
    /// Name; unique within the scene.
    pub name: String,
    /// The OBJ, glTF or PLY file.
    pub file: PathBuf,
    /// The part of the file.
    pub part: Part,
    /// How it is prepared.
    pub preparation_settings: PreparationSettings,
}

impl Asset {
    /// All of a file, named after it, prepared as the defaults say.
    #[must_use]
    pub fn of_file(file: &Path) -> Self {
        let name = file.file_stem().map_or_else(|| "model".into(), |stem| stem.to_string_lossy());
        Self {
            name: name.into_owned(),
            file: file.to_owned(),
            part: Part::Whole,
            preparation_settings: PreparationSettings::default(),
        }
    }
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

impl Instance {
    /// An asset where it is by itself.
    #[must_use]
    pub const fn unplaced(asset: usize) -> Self {
        Self { asset, translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0], scale: 1.0 }
    }

    /// This instance, as part of a model that is placed in turn.
    #[must_use]
    pub fn within(&self, model: &Self) -> Self {
        let quaternion = |q: [f32; 4]| DQuat::from_array(q.map(f64::from)).normalize();
        let (turn, scale) = (quaternion(model.rotation), f64::from(model.scale));
        let moved = DVec3::from(model.translation) + turn * (DVec3::from(self.translation) * scale);
        Self {
            asset: self.asset,
            translation: moved.to_array(),
            rotation: (turn * quaternion(self.rotation)).to_array().map(|x| x as f32),
            scale: (scale * f64::from(self.scale)) as f32,
        }
    }
}

/// What a model consists of, about its own origin.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// One asset, or the meshes of a glTF file.
    pub parts: Vec<Instance>,
    /// The lights that stand in it.
    pub punctual_lights: Vec<PunctualLight>,
}

impl Model {
    /// Its parts and punctual lights where a placement of the model has them.
    pub(crate) fn placed<'a>(
        &'a self,
        place: &'a Instance,
    ) -> (impl Iterator<Item = Instance> + 'a, impl Iterator<Item = PunctualLight> + 'a) {
        let rotation = DQuat::from_array(place.rotation.map(f64::from)).normalize();
        let (translation, scale) = (DVec3::from(place.translation), f64::from(place.scale));
        let parts = self.parts.iter().map(|part| part.within(place));
        (
            parts,
            self.punctual_lights
                .iter()
                .map(move |punctual_light| punctual_light.within(translation, rotation, scale)),
        )
    }
}

/// Longest name of a mesh that an asset's name repeats, in bytes.
const MAX_MESH_NAME_BYTES: usize = 100;

/// Vertical field of view of a camera that does not give one, in degrees.
pub const DEFAULT_FOV_Y_DEGREES: f32 = 50.0;

/// A scene before its models are prepared.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Name.
    pub name: String,
    /// Models.
    pub assets: Vec<Asset>,
    /// Placed models; `None` puts [`Scene::models`] side by side, once their sizes are known.
    pub instances: Option<Vec<Instance>>,
    /// The models that the scene is made of.
    pub models: Vec<Model>,
    /// Lights that stand in the scene: its own, and where [`Scene::instances`] says where models are, theirs.
    pub punctual_lights: Vec<PunctualLight>,
    /// Unit vector from the scene towards the light.
    pub light_direction: [f32; 3],
    /// Linear red, green, blue of the light, intensity included.
    pub light_color: [f32; 3],
    /// Linear red, green, blue of the ambient light, intensity included.
    pub ambient: [f32; 3],
    /// Linear red, green, blue of what no surface covers.
    pub background: [f32; 3],
    /// Ground, if any.
    pub terrain: Option<SceneTerrain>,
    /// Start camera; `None` frames everything, once sizes are known.
    pub camera: Option<Camera>,
    /// Files beside the models that all this was read from.
    pub files: Vec<PathBuf>,
}

impl Scene {
    /// A scene of some models, side by side.
    ///
    /// # Errors
    /// A glTF file that cannot be read: its meshes become assets, so they must be known.
    pub fn of_models(files: &[PathBuf]) -> Result<Self, ImportError> {
        let mut scene = Self::empty();
        let mut names = UniqueNames::default();
        for file in files {
            let mut asset = Asset::of_file(file);
            asset.name = names.take(&asset.name);
            scene.add_model(asset, &mut names)?;
        }
        scene.name = match files {
            [one] => Asset::of_file(one).name,
            _ => "models".to_owned(),
        };
        Ok(scene)
    }

    /// Adds a model: one asset, or for a whole glTF file one for each of its meshes. Returns its number
    /// among [`Scene::models`]. The asset's own name stays; its meshes' must be none of those that are taken.
    pub(super) fn add_model(&mut self, asset: Asset, names: &mut UniqueNames) -> Result<usize, ImportError> {
        if asset.part != Part::Whole || !is_gltf(&asset.file) {
            return self.add_merged(asset);
        }
        let contents = gltf::contents(&asset.file)?;
        let model = Model {
            punctual_lights: contents.punctual_lights.clone(),
            parts: self.add_meshes(&asset, contents, names),
        };
        self.models.push(model);
        Ok(self.models.len() - 1)
    }

    /// Adds all of a file as one asset, or one mesh of it, which has no punctual lights: they stand beside meshes.
    ///
    /// # Errors
    /// A glTF file that cannot be read, where all of it is meant.
    pub(super) fn add_merged(&mut self, asset: Asset) -> Result<usize, ImportError> {
        let whole = asset.part == Part::Whole && is_gltf(&asset.file);
        let punctual_lights = if whole { gltf::contents(&asset.file)?.punctual_lights } else { Vec::new() };
        self.assets.push(asset);
        self.models.push(Model { parts: vec![Instance::unplaced(self.assets.len() - 1)], punctual_lights });
        Ok(self.models.len() - 1)
    }

    /// Adds the meshes that a glTF file places, each once (and once more for each mirror or uneven scale
    /// that it is placed with), named after the model and the mesh.
    fn add_meshes(
        &mut self,
        model: &Asset,
        contents: gltf::Contents,
        names: &mut UniqueNames,
    ) -> Vec<Instance> {
        let mut known: Vec<(Part, usize)> = Vec::new();
        let mut by_mesh: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        let mut instances = Vec::with_capacity(contents.placed.len());
        for placed in contents.placed {
            let Part::Mesh { mesh, .. } = placed.part else { continue };
            // Few are placed with more than one linear map.
            let same = by_mesh.entry(mesh).or_default();
            let found = same.iter().find(|&&i| known[i].0 == placed.part).map(|&i| known[i].1);
            let number = found.unwrap_or_else(|| {
                let own = contents.names.get(mesh).map_or("mesh", String::as_str);
                let name = format!("{}/{}", model.name, &own[..own.floor_char_boundary(MAX_MESH_NAME_BYTES)]);
                let name = names.take(&name);
                same.push(known.len());
                self.assets.push(Asset { name, part: placed.part, ..model.clone() });
                known.push((placed.part, self.assets.len() - 1));
                self.assets.len() - 1
            });
            instances.push(Instance {
                asset: number,
                translation: placed.translation,
                rotation: placed.rotation.map(|x| x as f32),
                scale: placed.scale as f32,
            });
        }
        instances
    }

    pub(super) fn empty() -> Self {
        Self {
            name: "scene".to_owned(),
            assets: Vec::new(),
            instances: None,
            models: Vec::new(),
            punctual_lights: Vec::new(),
            light_direction: unit([0.4, 1.0, 0.6]).unwrap_or([0.0, 1.0, 0.0]),
            light_color: [1.0; 3],
            ambient: DEFAULT_AMBIENT,
            background: DEFAULT_BACKGROUND,
            terrain: None,
            camera: None,
            files: Vec::new(),
        }
    }
}

/// The vector made unit length, unless it has no direction.
pub(super) fn unit(v: [f32; 3]) -> Option<[f32; 3]> {
    let length = v.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt();
    (length > 0.0 && length.is_finite()).then(|| v.map(|x| (f64::from(x) / length) as f32))
}
