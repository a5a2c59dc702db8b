//! Memory that frames take on the device besides the scene's.

use super::{Renderer, drawn_side};
use crate::frame::graph::{self, Needs, Resource};
use crate::frame::settings::{AntiAliasing, Settings, Shadows};
use crate::frame::targets::{DEPTH, RADIANCE, target_bytes};
use crate::passes::bloom;
use crate::passes::floor::FloorPass;
#[cfg(any(test, feature = "methods"))]
use crate::passes::occlusion_layers;
use crate::passes::reflections::{self, ReflectionMethod};
use crate::resources::descriptors::texel_bytes;

impl Renderer {
    /// Memory of the textures that frames are drawn through, in bytes: pictures between passes, histories, shadow maps
    /// sky maps, and those of a studio's ground. The caller's target is not in it.
    #[must_use]
    pub fn target_bytes(&self) -> u64 {
        let pictures =
            self.targets.bytes() + self.temporal.bytes() + self.bloom.bytes() + self.tracer.bytes();
        #[cfg(any(test, feature = "methods"))]
        let pictures = pictures + self.layers.bytes();
        pictures
            + self.shadow_maps.bytes()
            + self.sky.bytes()
            + self.floor.as_ref().map_or(0, FloorPass::bytes)
    }

    /// Memory of all meshes in bytes, with what is free in their shared pages.
    #[must_use]
    pub fn mesh_bytes(&self) -> u64 {
        self.pools.used().iter().map(|pool| pool.bytes).sum()
    }
}

impl Settings {
    /// The most that [`Renderer::target_bytes`] can be in a target of a size without depth, whatever the scene has, sky
    /// maps and a studio's ground apart (of fixed size, less than a megabyte and two), and the target of materials with
    /// specular reflection of their own (8 bytes a pixel, in frames that have some). For pictures, not for debug views.
    #[must_use]
    pub fn most_target_bytes(&self, size: (u32, u32)) -> u64 {
        let size = (drawn_side(size.0, self.render_scale), drawn_side(size.1, self.render_scale));
        let temporal = self.anti_aliasing == AntiAliasing::Temporal;
        let needs = Needs {
            geometry: true,
            occlusion: self.occlusion.is_some(),
            shadows: self.shadows.is_some(),
            punctual_lights: self.lights.is_some(),
            emission: self.emission,
            reflections: self.reflections.map(|reflections| reflections.method == ReflectionMethod::HiZ),
            bloom: self.bloom.is_some(),
            water: self.water,
            transparency: self.transparency,
            ink: self.asks_for_ink(),
            wireframe: self.wireframe,
            motion: temporal,
            temporal,
            antialias: self.anti_aliasing == AntiAliasing::Spatial,
            enlarged: self.render_scale < 1.0,
            ..Needs::default()
        };
        // Frames of a moving camera and of a resting one have other passes, and textures stay for the next of them.
        let half = self.occlusion.is_some_and(|occlusion| occlusion.half);
        let rests = self.occlusion.is_some_and(|occlusion| occlusion.still.is_some());
        let mut touched = Vec::new();
        for still in [None, Some(false)].into_iter().filter(|still| still.is_none() || rests) {
            let needs = Needs { half_occlusion: half && still.is_none(), still, ..needs };
            touched.extend(graph::resources(&graph::plan(&graph::candidates(needs), &[Resource::Target])));
        }
        touched.sort_unstable();
        touched.dedup();
        let pixels = u64::from(size.0) * u64::from(size.1);
        let of_pass = |resource: &Resource| match resource {
            Resource::History => 2 * pixels * texel_bytes(RADIANCE),
            Resource::Pyramid => reflections::pyramid_bytes(size),
            Resource::ShadowMaps => self.shadows.map_or(0, Shadows::most_bytes),
            resource => target_bytes(*resource, size),
        };
        let all: u64 = touched.iter().map(of_pass).sum();
        #[cfg(any(test, feature = "methods"))]
        let all = all
            + self.occlusion.map_or(0, |occlusion| {
                let layered =
                    std::iter::once(occlusion.method).chain(occlusion.still).any(|one| one.is_layered());
                if layered { occlusion_layers::layer_bytes(size) } else { 0 }
            });
        all + self.bloom.map_or(0, |_| bloom::level_bytes(size))
    }
}

impl Shadows {
    /// The most memory that the shadow maps take, in bytes.
    #[must_use]
    pub fn most_bytes(self) -> u64 {
        let Self { cascades, map_side, .. } = self.clamped(u32::MAX);
        u64::from(cascades) * u64::from(map_side).pow(2) * texel_bytes(DEPTH)
    }
}
