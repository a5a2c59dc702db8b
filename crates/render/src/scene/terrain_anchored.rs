//! What stands on ground whose heights are multiplied: it goes up and down with what is below it.

use glam::DVec3;

use crate::scene::instance::Instance;
use crate::scene::lights::Light;
use crate::scene::terrain_renderer::TerrainRenderer;

/// Instances and punctual lights as they are drawn while heights are not the scene's.
#[derive(Debug, Default)]
pub(crate) struct TerrainAnchored {
    /// By how much less than the ground at each place rises, its height before: in the order of what stands there.
    heights: Vec<f64>,
    /// The same places as the scene has them, moved; by asset.
    pub(crate) instances: Vec<Vec<Instance>>,
    pub(crate) lights: Vec<Light>,
}

impl TerrainAnchored {
    /// Moves what stands on `ground` as its heights are now. Heights of places are looked up once, a microsecond each, as
    /// long as no place is added.
    pub(crate) fn follow(
        &mut self,
        ground: &mut TerrainRenderer,
        instances: &[Vec<Instance>],
        lights: &[Light],
    ) {
        let places = instances.iter().flatten().map(|instance| instance.translation);
        let places = || places.clone().chain(lights.iter().map(|light| light.position));
        if self.heights.len() != places().count() {
            let factor = ground.vertical_exaggeration();
            // What the scene's own heights are.
            let height = |place: DVec3| ground.height(place.x, place.z) / factor;
            self.heights = places().map(height).collect();
        }
        let rise = ground.vertical_exaggeration() - 1.0;
        let mut heights = self.heights.iter().map(|height| DVec3::Y * (height * rise));
        let mut up = |place: DVec3| place + heights.next().unwrap_or(DVec3::ZERO);
        self.instances.clear();
        for of_asset in instances {
            let moved = of_asset
                .iter()
                .map(|instance| Instance { translation: up(instance.translation), ..*instance });
            self.instances.push(moved.collect());
        }
        self.lights = lights.iter().map(|light| Light { position: up(light.position), ..*light }).collect();
    }

    /// Forgets what it knows of the ground, which has changed.
    pub(crate) fn forget(&mut self) {
        self.heights.clear();
    }
}
