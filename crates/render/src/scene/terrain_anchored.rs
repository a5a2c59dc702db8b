//! Terrain-anchored objects: instances and lights that follow the terrain's vertical exaggeration.

use glam::DVec3;
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::PunctualLight;

use crate::scene::terrain_renderer::TerrainRenderer;

/// Instances and punctual lights at their exaggerated positions.
#[derive(Debug, Default)]
pub(crate) struct TerrainAnchored {
    /// Height of the scene's terrain at each object, in the objects' order.
    heights: Vec<f64>,
    /// The scene's instances, moved; by asset.
    pub(crate) instances: Vec<Vec<Placement>>,
    pub(crate) lights: Vec<PunctualLight>,
}

impl TerrainAnchored {
    /// Moves all objects with the current heights of `ground`. Terrain heights are looked up once, a microsecond each,
    /// unless objects are added.
    pub(crate) fn follow(
        &mut self,
        ground: &mut TerrainRenderer,
        instances: &[Vec<Placement>],
        lights: &[PunctualLight],
    ) {
        let places = instances.iter().flatten().map(|placement| DVec3::from(placement.translation));
        let places = || places.clone().chain(lights.iter().map(|light| DVec3::from(light.position)));
        if self.heights.len() != places().count() {
            let factor = ground.vertical_exaggeration();
            // Heights without exaggeration.
            let height = |place: DVec3| ground.height(place.x, place.z) / factor;
            self.heights = places().map(height).collect();
        }
        let rise = ground.vertical_exaggeration() - 1.0;
        let mut heights = self.heights.iter().map(|height| DVec3::Y * (height * rise));
        let mut up = |place: DVec3| place + heights.next().unwrap_or(DVec3::ZERO);
        self.instances.clear();
        for of_asset in instances {
            let moved = of_asset.iter().map(|placement| Placement {
                translation: up(placement.translation.into()).into(),
                ..*placement
            });
            self.instances.push(moved.collect());
        }
        self.lights = lights
            .iter()
            .map(|light| PunctualLight { position: up(light.position.into()).into(), ..*light })
            .collect();
    }

    /// Discards the looked-up heights, after the terrain has changed.
    pub(crate) fn invalidate(&mut self) {
        self.heights.clear();
    }
}
