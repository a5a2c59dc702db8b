//! Composes the description of a scene from its prepared models: assets and instances in pages, nearest and largest
//! first.

mod animations;
pub(crate) mod framing;
mod pages;
mod parts;
pub(crate) mod placing;
mod shared;

pub use animations::AnimationBlobsError;
use glam::DVec3;
use lodestream_scene::description::{AssetEntry, Fingerprint, SceneError, SceneHeader, SceneLighting};
use lodestream_scene::limits::MAX_INSTANCES;

use lodestream_store::{
    BlobCache, PackFile, PartBlobsError, PunctualLightBlobs, PunctualLightBlobsError, SceneDescription,
    SceneStore, StoreError, TerrainBlobs, TerrainBlobsError,
};

use crate::proxies::Forest;
use crate::scene::Scene;
use pages::Pages;
use placing::{placed, start_camera, visible_first, world_sphere};
use shared::share_textures;

/// A scene that cannot be described.
#[derive(Debug, thiserror::Error)]
pub enum ComposeError {
    /// The scene has no instance.
    #[error("scene {name:?} places nothing; add an [[instance]]")]
    Empty {
        /// The scene.
        name: String,
    },
    /// More instances than the protocol numbers.
    #[error("the scene has {count} instances; at most {MAX_INSTANCES} are supported")]
    TooManyInstances {
        /// How many.
        count: usize,
    },
    /// The terrain's features cannot be sent.
    #[error(transparent)]
    Terrain(#[from] TerrainBlobsError),
    /// The punctual lights cannot be sent.
    #[error(transparent)]
    PunctualLights(#[from] PunctualLightBlobsError),
    /// What the parts are called cannot be sent.
    #[error(transparent)]
    Parts(#[from] PartBlobsError),
    /// Animated models that cannot be sent.
    #[error(transparent)]
    Animations(#[from] AnimationBlobsError),
    /// A pack that cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A value that the protocol refuses.
    #[error("the scene cannot be described: {0}")]
    Refused(#[from] SceneError),
}

/// Describes `scene`. `entries[i]` is the prepared asset `i`; `textures[i]` are the fingerprints of its textures, and may
/// be empty.
///
/// # Errors
/// See [`ComposeError`].
pub fn compose(
    scene: &Scene,
    entries: &[AssetEntry],
    textures: &[Vec<(u16, Fingerprint)>],
) -> Result<SceneDescription, ComposeError> {
    compose_with(scene, entries, textures, None)
}

/// As [`compose`], with proxies and the entries of their assets, which are numbered behind the scene's.
fn compose_with(
    scene: &Scene,
    entries: &[AssetEntry],
    textures: &[Vec<(u16, Fingerprint)>],
    forest: Option<(&Forest, &[AssetEntry])>,
) -> Result<SceneDescription, ComposeError> {
    let (instances, punctual_lights) = placed(scene, entries);
    if instances.is_empty() && scene.terrain.is_none() {
        return Err(ComposeError::Empty { name: scene.name.clone() });
    }
    if instances.len() > MAX_INSTANCES as usize {
        return Err(ComposeError::TooManyInstances { count: instances.len() });
    }
    let spheres: Vec<(DVec3, f64)> = instances.iter().map(|i| world_sphere(i, entries)).collect();
    let camera = start_camera(scene, &spheres);
    let order = match forest {
        Some((forest, _)) => forest.order.clone(),
        None => visible_first(&camera, &spheres),
    };
    let mut pages = Pages::default();
    match forest {
        Some((forest, of_proxies)) => {
            pages.add_forest(&forest.proxies, of_proxies, &instances, entries, &order);
        }
        None => pages.add_instances(&instances, entries, &order),
    }
    let Pages { mut pages, asset_order, .. } = pages;
    share_textures(&mut pages, &asset_order, textures);
    let header = SceneHeader {
        name: scene.name.clone(),
        fingerprint: Fingerprint::default(),
        asset_count: asset_order.len() as u32,
        instance_count: instances.len() as u32,
        page_count: pages.len() as u32,
        light: SceneLighting {
            direction: scene.light_direction,
            color: scene.light_color,
            ambient: scene.ambient,
        },
        background: scene.background,
        terrain: scene.terrain.as_ref().map(|terrain| Box::new(terrain.entry.clone())),
        camera,
        root_slope: forest.map_or(0.0, |(forest, _)| forest.root_slope),
    };
    let terrain = match &scene.terrain {
        Some(terrain) => TerrainBlobs::new(&terrain.terrain)?,
        None => TerrainBlobs::default(),
    };
    let punctual_lights = PunctualLightBlobs::new(&punctual_lights)?;
    let parts = parts::blobs(scene, &instances, &order)?;
    let animations = animations::blobs(scene, &order)?;
    header.check()?;
    for page in &pages {
        page.check()?;
    }
    let mut description =
        SceneDescription { header, pages, asset_order, terrain, punctual_lights, parts, animations };
    description.header.fingerprint = description.fingerprint();
    Ok(description)
}

/// Describes a scene whose asset `i` is `packs[i]`. Returns the packs by asset number.
///
/// # Errors
/// See [`ComposeError`].
pub fn describe(
    scene: &Scene,
    packs: Vec<PackFile>,
    forest: Option<Forest>,
) -> Result<(SceneDescription, Vec<PackFile>), ComposeError> {
    let entries: Vec<AssetEntry> = scene
        .assets
        .iter()
        .zip(&packs)
        .map(|(asset, pack)| pack.entry(&asset.name))
        .collect::<Result<_, _>>()?;
    let textures: Vec<_> = packs.iter().map(PackFile::textures).collect();
    let of_proxies = forest.as_ref().map_or(Ok(Vec::new()), Forest::entries)?;
    let with = forest.as_ref().map(|forest| (forest, &of_proxies[..]));
    let composed = compose_with(scene, &entries, &textures, with)?;
    let of_proxies = forest.into_iter().flat_map(|forest| forest.packs);
    let mut packs: Vec<Option<PackFile>> = packs.into_iter().chain(of_proxies).map(Some).collect();
    let in_order = composed.asset_order.iter().filter_map(|&i| packs.get_mut(i).and_then(Option::take));
    let in_order = in_order.collect();
    Ok((composed, in_order))
}

/// Opens a scene whose asset `i` is `packs[i]`; its blobs are in a cache that other scenes may share.
///
/// # Errors
/// A scene that cannot be described, packs whose base mesh is damaged.
pub fn open(scene: &Scene, packs: Vec<PackFile>, cache: &BlobCache) -> Result<SceneStore, ComposeError> {
    open_with(scene, packs, None, cache)
}

/// As [`open`], with the scene's proxies.
///
/// # Errors
/// As [`open`].
pub fn open_with(
    scene: &Scene,
    packs: Vec<PackFile>,
    forest: Option<Forest>,
    cache: &BlobCache,
) -> Result<SceneStore, ComposeError> {
    let (description, packs) = describe(scene, packs, forest)?;
    Ok(SceneStore::new(description, packs, cache)?)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use lodestream_geometry::index::Sphere;
    use lodestream_scene::description::{Camera, Instance};
    use lodestream_scene::punctual_lights::{First, PunctualLight};

    use super::*;

    fn entry(name: &str, origin: [f64; 3], radius: f32) -> AssetEntry {
        AssetEntry {
            name: name.into(),
            origin,
            sphere: Sphere { center: [1.0, 0.0, 0.0], radius },
            ..AssetEntry::default()
        }
    }

    #[test]
    fn one_model_stays_where_it_is_and_is_framed() {
        let scene = Scene::of_models(&[PathBuf::from("a.obj")]).unwrap();
        let composed = compose(&scene, &[entry("a", [1e7, 0.0, 0.0], 2.0)], &[]).unwrap();
        assert_eq!(composed.pages[0].instances[0].placement.translation, [0.0; 3]);
        let camera = composed.header.camera;
        assert_eq!(camera.target, [1e7 + 1.0, 0.0, 0.0]);
        let view = camera.view([640, 360], 1.0);
        let relative = DVec3::from(camera.target) - DVec3::from(camera.eye);
        assert!(view.frustum().sees(relative.as_vec3(), 2.0));
    }

    #[test]
    fn several_models_do_not_overlap_and_are_all_seen() {
        let scene = Scene::of_models(&["a.obj", "b.obj", "c.obj"].map(PathBuf::from)).unwrap();
        let entries = [entry("a", [0.0; 3], 2.0), entry("b", [50.0; 3], 1.0), entry("c", [-9.0; 3], 3.0)];
        let composed = compose(&scene, &entries, &[]).unwrap();
        let camera = composed.header.camera;
        let frustum = camera.view([640, 360], 1.0).frustum();
        let spheres: Vec<(DVec3, f64)> = composed.pages[0]
            .instances
            .iter()
            .map(|i| {
                let entry = &composed.pages[0].assets[i.asset as usize];
                (i.to_world(entry.origin, entry.sphere.center), f64::from(entry.sphere.radius))
            })
            .collect();
        for (i, (center, radius)) in spheres.iter().enumerate() {
            assert!(frustum.sees((*center - DVec3::from(camera.eye)).as_vec3(), *radius as f32));
            for (other, other_radius) in &spheres[i + 1..] {
                assert!(center.distance(*other) >= radius + other_radius);
            }
        }
    }

    #[test]
    fn pages_list_near_and_visible_instances_first_and_assets_before_their_instances() {
        let mut scene = Scene::of_models(&["a.obj", "b.obj", "never.obj"].map(PathBuf::from)).unwrap();
        scene.camera = Some(Camera {
            eye: [0.0; 3],
            target: [0.0, 0.0, -1.0],
            up: [0.0, 1.0, 0.0],
            fov_y: 60_f32.to_radians(),
        });
        let at = |asset, z| Instance::at(asset, [-1.0, 0.0, z]);
        // Behind the camera, then far to near: 200 of them.
        let mut instances = vec![at(0, 5.0)];
        instances.extend((1..=200).rev().map(|i| at(u32::from(i <= 150), -10.0 * f64::from(i))));
        scene.instances = Some(instances);
        let entries = ["a", "b", "never"].map(|name| entry(name, [0.0; 3], 1.0));
        let composed = compose(&scene, &entries, &[]).unwrap();
        assert_eq!(composed.header.page_count, 4);
        assert_eq!(composed.header.instance_count, 201);
        assert_eq!(composed.asset_order, [1, 0]);
        assert_eq!(composed.pages[0].assets[0].name, "b");
        assert_eq!(composed.pages[2].assets[0].name, "a");
        let all: Vec<f64> =
            composed.pages.iter().flat_map(|p| &p.instances).map(|i| i.placement.translation[2]).collect();
        assert_eq!(all[0], -10.0);
        assert_eq!(all[200], 5.0);
        assert!(all[..200].is_sorted_by(|a, b| a >= b));
    }

    #[test]
    fn the_fingerprint_follows_content() {
        let scene = Scene::of_models(&[PathBuf::from("a.obj")]).unwrap();
        let one = compose(&scene, &[entry("a", [0.0; 3], 2.0)], &[]).unwrap();
        let same = compose(&scene, &[entry("a", [0.0; 3], 2.0)], &[]).unwrap();
        let other = compose(&scene, &[entry("a", [0.0; 3], 2.5)], &[]).unwrap();
        assert_eq!(one.header.fingerprint, same.header.fingerprint);
        assert_ne!(one.header.fingerprint, other.header.fingerprint);
    }

    #[test]
    fn punctual_lights_of_models_stand_where_the_models_do_and_tell_scenes_apart() {
        let mut scene = Scene::of_models(&["a.obj", "b.obj"].map(PathBuf::from)).unwrap();
        let entries = ["a", "b"].map(|name| entry(name, [0.0; 3], 2.0));
        let dark = compose(&scene, &entries, &[]).unwrap();
        assert_eq!(dark.punctual_lights.punctual_lights(), None);
        let punctual_light =
            PunctualLight { position: [1.0, 5.0, 0.0], intensity: [9.0; 3], range: 30.0, spot: None };
        scene.models[1].punctual_lights = vec![punctual_light];
        let lit = compose(&scene, &entries, &[]).unwrap();
        assert_ne!(lit.header.fingerprint, dark.header.fingerprint);
        let First::PunctualLights(punctual_lights) =
            lit.punctual_lights.punctual_lights().unwrap().first().unwrap()
        else {
            panic!()
        };
        let second = lit.pages[0].instances.iter().find(|i| i.placement.translation[0] > 1.0).unwrap();
        assert_eq!(punctual_lights[0].position[0], second.placement.translation[0] + 1.0);
        assert_eq!(punctual_lights[0].position[1], 5.0);
    }

    #[test]
    fn a_scene_that_places_nothing_says_so() {
        let mut scene = Scene::of_models(&[PathBuf::from("a.obj")]).unwrap();
        scene.instances = Some(Vec::new());
        let message = compose(&scene, &[entry("a", [0.0; 3], 2.0)], &[]).unwrap_err().to_string();
        assert!(message.contains("add an [[instance]]"), "{message}");
    }
}
