//! A scene before its models are prepared.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::preparation_settings::{PositionBits, Precision, PreparationSettings, Tolerance, UvBits};
use crate::sources::Sources;
use crate::stderr::write_line;
use lodestream_geometry::Settings;
use lodestream_import::gltf::{self, CopyTolerance};
use lodestream_import::{ImportError, Part, is_gltf};
use lodestream_scene::animation::AnimatedModel;
use lodestream_scene::description::{Camera, DEFAULT_AMBIENT, DEFAULT_BACKGROUND, Instance};
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::surroundings::{STUDIO_AMBIENT, STUDIO_BACKGROUND, STUDIO_LIGHT};

use super::batches::{self, Batch};
use super::names::UniqueNames;
use super::part_names::ModelPartNames;
use super::terrain::SceneTerrain;
use super::up_axis::UpAxis;

/// [`Settings::visible_side`] of batches: of a building more is seen than of an object, for its walls are near.
const VISIBLE_SIDE: f64 = 0.35;

/// A model of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Asset {
    /// Name; unique within the scene.
    pub name: String,
    /// The OBJ, glTF, PLY or STL file.
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

    /// Settings of simplification, with the default codec.
    pub(crate) fn simplify_settings(&self) -> Settings {
        let settings = self.preparation_settings.simplify_settings();
        match self.part {
            Part::Batch(_) => Settings { visible_side: VISIBLE_SIDE, ..settings },
            Part::Whole | Part::Mesh { .. } => settings,
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
    /// What the parts of each of [`Model::parts`] are called.
    pub part_names: ModelPartNames,
    /// Its axis that points up where models stand side by side, unless [`Scene::up`] names another.
    pub up: UpAxis,
    /// How some of [`Model::parts`] move, if any does.
    pub animation: Option<ModelAnimation>,
}

/// How parts of a model move.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelAnimation {
    /// Nodes, parts and clips; it has no places.
    pub model: AnimatedModel,
    /// Of each of its parts, the index among [`Model::parts`].
    pub parts: Vec<u32>,
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

/// Half the error of positions that the settings allow: a copy adds it to that of its original.
fn copy_tolerance(settings: &PreparationSettings) -> CopyTolerance {
    match settings.precision {
        Some(Precision::Tolerance(length)) => CopyTolerance::Length(length.get() / 2.0),
        bits => {
            let bits = match bits {
                Some(Precision::Bits(bits)) => bits,
                _ => PositionBits::default(),
            };
            // A position is at most half a step from its grid point.
            CopyTolerance::Share(0.25 / f64::from(1_u32 << bits.get()))
        }
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
    /// Which of [`Model::parts`] each of [`Scene::instances`] is: number of the model, and index there. Instances behind
    /// its end are called as their asset.
    pub instance_parts: Vec<(u32, u32)>,
    /// Lights that stand in the scene: its own, and where [`Scene::instances`] says where models are, theirs.
    pub punctual_lights: Vec<PunctualLight>,
    /// Unit vector from the scene towards the light.
    pub light_direction: [f32; 3],
    /// The axis of all models that points up where they stand side by side; `None`: as their formats have it.
    pub up: Option<UpAxis>,
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
    /// Whether it gets proxies if it has many instances.
    pub proxies: bool,
    /// Files beside the models that all this was read from.
    pub files: Vec<PathBuf>,
}

impl Scene {
    /// A scene of some models, side by side, in a studio.
    ///
    /// # Errors
    /// A glTF file that cannot be read: its meshes become assets, so they must be known.
    pub fn of_models(files: &[PathBuf]) -> Result<Self, ImportError> {
        Self::of_models_with(files, &PreparationSettings::default(), &Sources::default())
    }

    /// As [`Self::of_models`], with settings.
    pub(super) fn of_models_with(
        files: &[PathBuf],
        flags: &PreparationSettings,
        sources: &Sources,
    ) -> Result<Self, ImportError> {
        let mut scene = Self::empty();
        scene.set_studio();
        let mut names = UniqueNames::default();
        for file in files {
            let mut asset = Asset::of_file(file);
            asset.name = names.take(&asset.name);
            scene.add_model(asset, flags, sources, &mut names)?;
        }
        scene.name = match files {
            [one] => Asset::of_file(one).name,
            _ => "models".to_owned(),
        };
        Ok(scene)
    }

    /// Adds a model: one asset, or for a whole glTF file one for each of its meshes. Returns its number
    /// among [`Scene::models`]. The asset's own name stays; its meshes' must be none of those that are taken.
    pub(super) fn add_model(
        &mut self,
        asset: Asset,
        flags: &PreparationSettings,
        sources: &Sources,
        names: &mut UniqueNames,
    ) -> Result<usize, ImportError> {
        if asset.part != Part::Whole || !is_gltf(&asset.file) {
            return self.add_merged(asset, sources);
        }
        let settings = flags.or(asset.preparation_settings);
        let contents = sources.contents(&asset.file, Some(copy_tolerance(&settings)))?;
        for warning in &contents.warnings {
            write_line(format_args!("warning: {warning}"));
        }
        let batches = batches::of_contents(&contents, settings.batching.unwrap_or_default());
        let punctual_lights = contents.punctual_lights.clone();
        let up = UpAxis::of_file(&asset.file);
        let animation = contents.animation.clone();
        let (parts, part_names, placed) = self.add_meshes(&asset, contents, batches, names);
        // What moves is in no batch.
        let part = |of: &usize| placed.get(of).copied();
        let animation = animation.and_then(|gltf::FileAnimation { model, placed }| {
            Some(ModelAnimation { model, parts: placed.iter().map(part).collect::<Option<_>>()? })
        });
        self.models.push(Model { parts, punctual_lights, part_names, up, animation });
        Ok(self.models.len() - 1)
    }

    /// Adds all of a file as one asset, or one mesh of it, which has no punctual lights: they stand beside meshes.
    ///
    /// # Errors
    /// A glTF file that cannot be read, where all of it is meant.
    pub(super) fn add_merged(&mut self, asset: Asset, sources: &Sources) -> Result<usize, ImportError> {
        let whole = asset.part == Part::Whole && is_gltf(&asset.file);
        let contents = whole.then(|| sources.contents(&asset.file, None)).transpose()?;
        for warning in contents.iter().flat_map(|contents| &contents.warnings) {
            write_line(format_args!("warning: {warning}"));
        }
        let part_names = match &contents {
            Some(contents) => ModelPartNames::of_merged(&asset.name, contents),
            None => ModelPartNames::of_one(&asset.name),
        };
        let punctual_lights = contents.map(|contents| contents.punctual_lights).unwrap_or_default();
        let up = UpAxis::of_file(&asset.file);
        let parts = vec![Instance::at(self.add_asset(asset), [0.0; 3])];
        self.models.push(Model { parts, punctual_lights, part_names, up, animation: None });
        Ok(self.models.len() - 1)
    }

    /// Adds an asset and returns its number.
    fn add_asset(&mut self, asset: Asset) -> u32 {
        self.assets.push(asset);
        (self.assets.len() - 1) as u32
    }

    /// Adds the meshes that a glTF file places: those in [batches], named after the model; others and their copies each
    /// once (and once more for a mirror image and for each uneven scale that it is placed with), named after the model
    /// and the mesh. Gives the instances, their names, and the instance of each placed mesh that is in no batch.
    fn add_meshes(
        &mut self,
        model: &Asset,
        contents: gltf::Contents,
        (batches, batched): (Vec<Batch>, Vec<bool>),
        names: &mut UniqueNames,
    ) -> (Vec<Instance>, ModelPartNames, BTreeMap<usize, u32>) {
        let mut part_names = ModelPartNames::of_file(&model.name, Arc::clone(&contents.part_names));
        let placed_part = |placed: &gltf::PlacedMesh| match placed.part {
            Part::Mesh { .. } => Some((placed.node, placed.mesh)),
            Part::Whole | Part::Batch(_) => None,
        };
        let placed_parts: Vec<_> = contents.placed.iter().map(placed_part).collect();
        let mut known: Vec<(Part, u32)> = Vec::new();
        let mut by_mesh: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        let mut instances = Vec::with_capacity(contents.placed.len());
        let mut alone = BTreeMap::new();
        let all = contents.placed.into_iter().zip(batched).enumerate();
        for (index, (placed, _)) in all.filter(|(_, (_, batched))| !batched) {
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
            alone.insert(index, instances.len() as u32);
            instances.push(Instance { asset: number, placement: placed.placement });
            part_names.add(placed.placement, [(placed.node, mesh)]);
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
            let placed = batch.placed.iter().filter_map(|&placed| placed_parts[placed]);
            part_names.add(Placement::default(), placed);
        }
        (instances, part_names, alone)
    }

    /// Puts the scene into a studio, lit from the default side.
    pub(super) fn set_studio(&mut self) {
        (self.background, self.ambient) = (STUDIO_BACKGROUND, STUDIO_AMBIENT);
        self.light_direction = STUDIO_LIGHT;
    }

    /// A scene without models, under the sky.
    pub(crate) fn empty() -> Self {
        Self {
            name: "scene".to_owned(),
            assets: Vec::new(),
            instances: None,
            instance_parts: Vec::new(),
            models: Vec::new(),
            punctual_lights: Vec::new(),
            light_direction: unit([0.4, 1.0, 0.6]).unwrap_or([0.0, 1.0, 0.0]),
            up: None,
            light_color: [1.0; 3],
            ambient: DEFAULT_AMBIENT,
            background: DEFAULT_BACKGROUND,
            terrain: None,
            camera: None,
            proxies: true,
            files: Vec::new(),
        }
    }
}

/// The vector made unit length, unless it has no direction.
pub(super) fn unit(v: [f32; 3]) -> Option<[f32; 3]> {
    let length = v.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>().sqrt();
    (length > 0.0 && length.is_finite()).then(|| v.map(|x| (f64::from(x) / length) as f32))
}
