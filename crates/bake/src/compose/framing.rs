//! The start camera of models whose scene has none: as near as their surfaces fit the picture.

use glam::DVec3;
use lodestream_scene::description::{AssetEntry, Camera};
use lodestream_store::{PackFile, StoreError};

use super::placing::{START_DIRECTION, placed};
use crate::scene::{DEFAULT_FOV_Y_DEGREES, Scene};

/// Share of the picture's width or height, whichever is met first, that models fill.
const FILLED: f64 = 0.75;
/// Width over height of the picture that is filled; in narrower ones the camera is not moved.
const ASPECT: f64 = 16.0 / 9.0;
/// Most vertices of base meshes that are looked at; of scenes with more, spheres are framed.
const MAX_POINTS: usize = 1 << 18;

/// The camera that frames a scene; `None` where the scene has one, or a terrain, or too much to look at.
///
/// # Errors
/// Base meshes that are missing, unreadable or damaged.
pub(crate) fn framing(scene: &Scene, packs: &[PackFile]) -> Result<Option<Camera>, StoreError> {
    if scene.camera.is_some() || scene.terrain.is_some() {
        return Ok(None);
    }
    let entries = scene.assets.iter().zip(packs).map(|(asset, pack)| pack.entry(&asset.name));
    let entries: Vec<AssetEntry> = entries.collect::<Result<_, _>>()?;
    let (instances, _) = placed(scene, &entries);
    let mut of_asset: Vec<Option<Vec<DVec3>>> = vec![None; packs.len()];
    let mut points: Vec<DVec3> = Vec::new();
    for instance in &instances {
        let Some((local, pack)) =
            of_asset.get_mut(instance.asset as usize).zip(packs.get(instance.asset as usize))
        else {
            return Ok(None);
        };
        let local = match local {
            Some(local) => local,
            None => {
                let base = pack.base()?;
                let positions = base.positions.iter().map(|&q| DVec3::from(base.grid.position(q)));
                local.insert(positions.collect())
            }
        };
        if points.len() + local.len() > MAX_POINTS {
            return Ok(None);
        }
        points.extend(local.iter().map(|&point| instance.placement.to_world(point)));
    }
    Ok(framed(&points))
}

/// The camera that looks along the default direction at points, which fill a share of the picture.
fn framed(points: &[DVec3]) -> Option<Camera> {
    let back = START_DIRECTION.normalize();
    let right = DVec3::Y.cross(back).normalize();
    let up = back.cross(right);
    let fov_y = DEFAULT_FOV_Y_DEGREES.to_radians();
    let tangent = (f64::from(fov_y) / 2.0).tan() * FILLED;
    // In the plane of an axis and the way back, the eye is where lines at the share's angle touch the points from both
    // sides: x + t z at most, x - t z at least (x along the axis, z back). The wider axis decides how far back.
    let touching = |axis: DVec3, tangent: f64| {
        let sums = |sign: f64| points.iter().map(move |p| p.dot(axis) + sign * tangent * p.dot(back));
        let (most, least) = (sums(1.0).fold(f64::MIN, f64::max), sums(-1.0).fold(f64::MAX, f64::min));
        ((most + least) / 2.0, (most - least) / (2.0 * tangent))
    };
    let ((x, back_x), (y, back_y)) = (touching(right, tangent * ASPECT), touching(up, tangent));
    let depths = || points.iter().map(|point| point.dot(back));
    let (near, far) = (depths().fold(f64::MIN, f64::max), depths().fold(f64::MAX, f64::min));
    let at = |z: f64| right * x + up * y + back * z;
    let (eye, target) = (at(back_x.max(back_y)), at((near + far) / 2.0));
    // Points at one place, or none.
    let usable = eye.is_finite() && eye.distance(target) > 1e-9 * eye.length();
    usable.then(|| Camera { eye: eye.to_array(), target: target.to_array(), up: [0.0, 1.0, 0.0], fov_y })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The extent of points in the picture of a camera: left, right, bottom, top, each of half its size.
    fn covered(camera: &Camera, points: &[DVec3]) -> [f64; 4] {
        let back = (DVec3::from(camera.eye) - DVec3::from(camera.target)).normalize();
        let right = DVec3::Y.cross(back).normalize();
        let tangent = (f64::from(camera.fov_y) / 2.0).tan();
        points.iter().fold([0.0; 4], |[left, most, bottom, top], point| {
            let from = *point - DVec3::from(camera.eye);
            let depth = -from.dot(back) * tangent;
            let (x, y) = (from.dot(right) / depth / ASPECT, from.dot(back.cross(right)) / depth);
            [f64::min(left, x), f64::max(most, x), f64::min(bottom, y), f64::max(top, y)]
        })
    }

    #[test]
    fn models_of_any_shape_fill_three_quarters_of_the_picture() {
        let corners = |size: [f64; 3], at: DVec3| -> Vec<DVec3> {
            let corner = |i: usize| DVec3::from([0, 1, 2].map(|axis| size[axis] * (i >> axis & 1) as f64));
            (0..8).map(|i| at + corner(i)).collect()
        };
        for size in [[1.0; 3], [10.0, 1.0, 1.0], [1.0, 10.0, 1.0], [0.1, 0.1, 30.0], [7.0, 0.0, 3.0]] {
            for at in [DVec3::ZERO, DVec3::new(408_201.0, 20.0, -4_080_928.0)] {
                let points = corners(size, at);
                let camera = framed(&points).unwrap();
                let [left, right, bottom, top] = covered(&camera, &points);
                let widest = right.max(-left).max(top).max(-bottom);
                assert!((widest - FILLED).abs() < 1e-6, "{size:?}: {left} {right} {bottom} {top}");
                // In the middle of the axis that decides.
                let middle = if right > top { left + right } else { bottom + top };
                assert!(middle.abs() < 1e-6, "{size:?}: {left} {right} {bottom} {top}");
            }
        }
        assert_eq!(framed(&[]), None);
        assert_eq!(framed(&[DVec3::ONE; 3]), None);
    }
}
