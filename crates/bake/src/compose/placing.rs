//! Where a scene's instances stand, from where they are first seen, and in what order.

use glam::{DVec3, Vec3};
use lodestream_scene::description::{AssetEntry, Camera, Instance};
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::PunctualLight;

use crate::scene::{DEFAULT_FOV_Y_DEGREES, Model, Scene, SceneTerrain, UpAxis};

/// Gap between models side by side, as a share of their mean radius.
const GAP: f64 = 0.25;
/// Distance of the start camera as a share of the distance at which the bounding sphere just fits the picture's height:
/// spheres are larger than their contents.
const FRAMING: f64 = 0.9;
/// Direction from the scene to the default start camera.
pub(super) const START_DIRECTION: DVec3 = DVec3::new(0.4, 0.3, 1.0);
/// Viewport that orders the pages; its shape matters little.
const ORDER_VIEWPORT_PX: [u32; 2] = [1280, 720];

/// The scene's instances, of assets with these entries, and its punctual lights.
pub(crate) fn placed(scene: &Scene, entries: &[AssetEntry]) -> (Vec<Instance>, Vec<PunctualLight>) {
    match &scene.instances {
        Some(instances) => (instances.clone(), scene.punctual_lights.clone()),
        None => {
            let upright: Vec<Model> = scene.models.iter().map(|model| upright(model, scene.up)).collect();
            let (instances, punctual_lights) = side_by_side(&upright, entries);
            (instances, [&scene.punctual_lights[..], &punctual_lights].concat())
        }
    }
}

/// The camera from which the scene is first seen; `spheres` are the bounds of the instances in the world.
pub(crate) fn start_camera(scene: &Scene, spheres: &[(DVec3, f64)]) -> Camera {
    match scene.camera {
        Some(camera) => camera,
        None => match &scene.terrain {
            Some(terrain) if spheres.is_empty() => overlook(terrain),
            _ => framing_camera(spheres),
        },
    }
}

/// Bounding sphere of an instance, in the world.
pub(crate) fn world_sphere(instance: &Instance, entries: &[AssetEntry]) -> (DVec3, f64) {
    let (entry, placement) = (&entries[instance.asset as usize], instance.placement);
    let local = DVec3::from(entry.origin) + Vec3::from(entry.sphere.center).as_dvec3();
    let scale = f64::from(placement.scale);
    let center = DVec3::from(placement.translation) + placement.orientation_f64() * (local * scale);
    (center, f64::from(entry.sphere.radius) * scale)
}

/// A model turned so that its axis, unless `up` names another, is y.
fn upright(model: &Model, up: Option<UpAxis>) -> Model {
    let up = up.unwrap_or(model.up);
    if up == UpAxis::Y {
        return model.clone();
    }
    let (parts, lights) = model.placed(Placement::new(DVec3::ZERO, up.turn(), 1.0));
    Model { parts: parts.collect(), punctual_lights: lights.collect(), ..model.clone() }
}

/// Default placement: one model at its own origin; several in a row along x, with their centres on one line.
fn side_by_side(models: &[Model], entries: &[AssetEntry]) -> (Vec<Instance>, Vec<PunctualLight>) {
    if let [] | [_] = models {
        let one = models.first().cloned().unwrap_or_default();
        return (one.parts, one.punctual_lights);
    }
    let bounds: Vec<(DVec3, f64)> = models
        .iter()
        .map(|model| {
            let spheres: Vec<_> = model.parts.iter().map(|i| world_sphere(i, entries)).collect();
            enclosing(&spheres)
        })
        .collect();
    let gap = GAP * bounds.iter().map(|(_, radius)| radius).sum::<f64>() / bounds.len() as f64;
    let mut x = 0.0;
    let (mut instances, mut punctual_lights) = (Vec::new(), Vec::new());
    for (model, (center, radius)) in models.iter().zip(bounds) {
        x += radius;
        let translation = (DVec3::new(x, 0.0, 0.0) - center).to_array();
        let (parts, lights) = model.placed(Placement::at(translation));
        instances.extend(parts);
        punctual_lights.extend(lights);
        x += radius + gap;
    }
    (instances, punctual_lights)
}

/// A sphere around the centre of the spheres' bounding box that encloses them.
fn enclosing(spheres: &[(DVec3, f64)]) -> (DVec3, f64) {
    if let [one] = spheres {
        return *one;
    }
    let low = spheres.iter().fold(DVec3::INFINITY, |low, (c, r)| low.min(*c - DVec3::splat(*r)));
    let high = spheres.iter().fold(DVec3::NEG_INFINITY, |high, (c, r)| high.max(*c + DVec3::splat(*r)));
    let center = if spheres.is_empty() { DVec3::ZERO } else { (low + high) / 2.0 };
    (center, spheres.iter().fold(0.0f64, |radius, (c, r)| radius.max(c.distance(center) + r)))
}

/// Radius of a sphere around the spheres.
pub(crate) fn radius(spheres: &[(DVec3, f64)]) -> f64 {
    enclosing(spheres).1
}

fn framing_camera(spheres: &[(DVec3, f64)]) -> Camera {
    let (target, radius) = enclosing(spheres);
    let fov_y = DEFAULT_FOV_Y_DEGREES.to_radians();
    // A model of one point still needs a camera distance.
    let radius = if radius > 0.0 { radius } else { 1.0 };
    let distance = FRAMING * radius / (f64::from(fov_y) / 2.0).sin();
    let eye = target + START_DIRECTION.normalize() * distance;
    Camera { eye: eye.to_array(), target: target.to_array(), up: [0.0, 1.0, 0.0], fov_y }
}

/// A camera at the highest point near the centre of an empty terrain.
fn overlook(terrain: &SceneTerrain) -> Camera {
    let step =
        f64::from(terrain.entry.unit) * f64::from(1_u32 << terrain.entry.parameters.finest_level) / 8.0;
    let places = (0..81).map(|i| [f64::from(i % 9 - 4) * step, f64::from(i / 9 - 4) * step]);
    let height = |[x, z]: [f64; 2]| terrain.height(x, z).unwrap_or(0.0);
    let [x, z] = places.max_by(|a, b| height(*a).total_cmp(&height(*b))).unwrap_or([0.0; 2]);
    let eye = DVec3::new(x, height([x, z]) + 2.0, z);
    // Looks towards the centre; from the centre in any direction.
    let target = eye - DVec3::new(x, 0.1 * step, if x == 0.0 && z == 0.0 { step } else { z });
    let (eye, target) = (eye.to_array(), target.to_array());
    Camera { eye, target, up: [0.0, 1.0, 0.0], fov_y: DEFAULT_FOV_Y_DEGREES.to_radians() }
}

/// Indices of instances: those in the start camera's view first, then by apparent size.
pub(crate) fn visible_first(camera: &Camera, spheres: &[(DVec3, f64)]) -> Vec<usize> {
    let view = camera.view(ORDER_VIEWPORT_PX, 1.0);
    let frustum = view.frustum();
    let eye = DVec3::from(camera.eye);
    let key = |&(center, radius): &(DVec3, f64)| {
        let relative = center - eye;
        let seen = frustum.sees(relative.as_vec3(), radius as f32);
        // Inside a sphere, the apparent size is the largest possible.
        let apparent = radius / relative.length().max(radius).max(f64::MIN_POSITIVE);
        (!seen, -apparent)
    };
    let keys: Vec<(bool, f64)> = spheres.iter().map(key).collect();
    let mut order: Vec<usize> = (0..spheres.len()).collect();
    order.sort_by(|&a, &b| keys[a].0.cmp(&keys[b].0).then(keys[a].1.total_cmp(&keys[b].1)).then(a.cmp(&b)));
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(model: &Model, up: Option<UpAxis>, point: DVec3) -> DVec3 {
        let scene = Scene { models: vec![model.clone()], up, ..Scene::empty() };
        placed(&scene, &[]).0[0].placement.to_world(point)
    }

    #[test]
    fn models_stand_upright_by_their_format_or_the_axis_that_is_named() {
        let part = Instance::at(0, [1.0, 2.0, 3.0]);
        for (up, named, [x, y, z]) in [
            (UpAxis::Y, None, [1.0, 2.0, 3.0]),
            (UpAxis::Z, None, [1.0, 3.0, -2.0]),
            (UpAxis::Z, Some(UpAxis::Y), [1.0, 2.0, 3.0]),
            (UpAxis::Y, Some(UpAxis::MinusY), [1.0, -2.0, -3.0]),
        ] {
            let model = Model { parts: vec![part], up, ..Model::default() };
            let at = turned(&model, named, DVec3::ZERO);
            assert!((at - DVec3::new(x, y, z)).length() < 1e-6, "{up} {named:?}: {at}");
        }
    }
}
