//! A scene before its models are prepared.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::preparation_settings::{Precision, PreparationSettings, Tolerance, UvBits};
use lodestream_import::{ImportError, Part, gltf, is_gltf};
use lodestream_scene::description::{Camera, DEFAULT_AMBIENT, DEFAULT_BACKGROUND, Instance};
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::PunctualLight;

use super::batches;
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
    pub(crate) fn placed(
        &self,
        place: Placement,
    ) -> (impl Iterator<Item = Instance>, impl Iterator<Item = PunctualLight>) {
        let part = move |part: &Instance| Instance { placement: part.placement.within(&place), ..*part };
        let punctual_light = move |light: &PunctualLight| light.within(&place);
        (self.parts.iter().map(part), self.punctual_lights.iter().map(punctual_light))
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
    /// Placed assets, numbered as in [`Scene::assets`]; `None` puts [`Scene::models`] side by side, once their sizes are known.
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
        let number = self.add_asset(asset);
        self.models.push(Model { parts: vec![Instance::at(number, [0.0; 3])], punctual_lights });
        Ok(self.models.len() - 1)
    }

    /// Adds an asset and returns its number.
    fn add_asset(&mut self, asset: Asset) -> u32 {
        self.assets.push(asset);
        (self.assets.len() - 1) as u32
    }

    /// Adds the meshes that a glTF file places: small ones that it places once in [batches], named after the model; others
    /// each once (and once more for each mirror or uneven scale that it is placed with), named after the model and the
    /// mesh.
    fn add_meshes(
        &mut self,
        model: &Asset,
        contents: gltf::Contents,
        names: &mut UniqueNames,
    ) -> Vec<Instance> {
        let (batches, batched) = batches::of_contents(&contents);
        let mut known: Vec<(Part, u32)> = Vec::new();
        let mut by_mesh: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        let mut instances = Vec::with_capacity(contents.placed.len());
        for (placed, _) in contents.placed.into_iter().zip(batched).filter(|(_, batched)| !batched) {
            let Part::Mesh { mesh, .. } = placed.part else { continue };
            // Few are placed with more than one linear map.
            let same = by_mesh.entry(mesh).or_default();
            let found = same.iter().find(|&&i| known[i].0 == placed.part).map(|&i| known[i].1);
            let number = found.unwrap_or_else(|| {
                let own = contents.names.get(mesh).map_or("mesh", String::as_str);
                let name = format!("{}/{}", model.name, &own[..own.floor_char_boundary(MAX_MESH_NAME_BYTES)]);
                let name = names.take(&name);
                same.push(known.len());
                let number = self.add_asset(Asset { name, part: placed.part.clone(), ..model.clone() });
                known.push((placed.part.clone(), number));
                number
            });
            instances.push(Instance { asset: number, placement: placed.placement });
        }
        for batch in batches {
            let name = names.take(&format!("{}/parts", model.name));
            let mut preparation_settings = model.preparation_settings;
            let tolerance = Tolerance::try_from(batch.tolerance).ok().map(Precision::Tolerance);
            preparation_settings.precision = preparation_settings.precision.or(tolerance);
            let uv_bits = batch.uv_bits.and_then(|bits| UvBits::try_from(bits).ok());
            preparation_settings.uv_bits = preparation_settings.uv_bits.or(uv_bits);
            let asset = Asset { name, part: batch.part, preparation_settings, ..model.clone() };
            instances.push(Instance::at(self.add_asset(asset), [0.0; 3]));
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
