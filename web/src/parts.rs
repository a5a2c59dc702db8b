//! Picking in the worker, whose core has the meshes.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use lodestream_client::core::Ray;
use lodestream_scene::parts::{PartTransform, ScenePart};
use wasm_bindgen::prelude::*;

use crate::Streamer;

/// Parts from pairs of instance and part.
pub(crate) fn scene_parts(pairs: &[u32]) -> Vec<ScenePart> {
    pairs.chunks_exact(2).map(|pair| ScenePart { instance: pair[0], part: pair[1] }).collect()
}

/// The transform of a matrix of 16 numbers, column after column.
pub(crate) fn part_transform(matrix: &[f64]) -> Result<PartTransform, String> {
    let columns =
        matrix.try_into().map_err(|_| format!("a part's matrix has {} numbers, not 16", matrix.len()))?;
    PartTransform::from_matrix(columns).map_err(|why| why.to_string())
}

#[wasm_bindgen]
impl Streamer {
    /// Sets which parts are moved within their instances, as pairs of instance and part, and a matrix of 16 numbers for
    /// each.
    ///
    /// # Errors
    /// Matrices that are no similarities.
    pub fn move_parts(&mut self, parts: &[u32], matrices: &[f64]) -> Result<(), String> {
        let transforms = matrices.chunks(16).map(part_transform).collect::<Result<Vec<_>, _>>()?;
        let moved: BTreeMap<_, _> = scene_parts(parts).into_iter().zip(transforms).collect();
        self.core.move_parts(&moved);
        Ok(())
    }

    /// Sets the instances for which no proxy may stand: those with parts that have a state.
    pub fn pin(&mut self, instances: &[u32]) {
        self.core.pin_instances(instances);
    }

    /// The nearest part on a ray of six numbers, origin and direction: instance, part (-1 if a proxy stands for the
    /// instance), place (three numbers) and distance. Hidden parts, and all others if some are isolated, are skipped; both are pairs of instance and part.
    #[must_use]
    pub fn pick(&self, ray: &[f64], hidden: &[u32], isolated: Option<Vec<u32>>) -> Option<Vec<f64>> {
        let &[x, y, z, dx, dy, dz] = ray else { return None };
        let ray = Ray { origin: DVec3::new(x, y, z), direction: DVec3::new(dx, dy, dz) };
        let hidden: BTreeSet<ScenePart> = scene_parts(hidden).into_iter().collect();
        let isolated: Option<BTreeSet<ScenePart>> =
            isolated.map(|pairs| scene_parts(&pairs).into_iter().collect());
        let hit = self.core.pick(ray, |part| {
            hidden.contains(&part) || isolated.as_ref().is_some_and(|isolated| !isolated.contains(&part))
        })?;
        let numbers = [hit.instance.into(), hit.part.map_or(-1.0, f64::from)];
        Some([&numbers[..], &hit.place.to_array(), &[hit.distance]].concat())
    }

    /// Bounds of a part as it is drawn: centre and radius of a sphere, lowest and highest coordinates. None for a part
    /// without faces, or that has not arrived.
    #[must_use]
    pub fn part_bounds(&self, instance: u32, part: u32) -> Option<Vec<f64>> {
        let bounds = self.core.part_bounds(ScenePart { instance, part })?;
        let [low, high] = bounds.extent.map(|corner| corner.to_array());
        Some([&bounds.centre.to_array()[..], &[bounds.radius], &low, &high].concat())
    }
}
