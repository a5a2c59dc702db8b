//! The uniform block that every pass reads: `Frame` of `common.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Mat4};
use lodestream_scene::section::{MAX_SECTION_PLANES, SectionPlanes};

use crate::frame::accumulation::AccumulationStep;
use crate::frame::camera::{clip_from_view, view_from_world};
use crate::frame::settings::{DebugView, Frame, MAX_RELIEF_STEPS, ReliefMethod, ToneMapping};
use crate::passes::occlusion::{MAX_SAMPLES, OcclusionRadius};
use crate::passes::occlusion_kernel::kernel as hemisphere_kernel;
use crate::passes::shadows::Cascade;
use crate::passes::sky::SkyLight;
use crate::passes::temporal::TemporalStep;

/// Mirrors `struct Frame` in `common.wgsl`; keep the two in step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct FrameUniform {
    clip_from_view: [[f32; 4]; 4],
    view_from_world: [[f32; 4]; 4],
    /// Direction; [`lodestream_scene::pose::Pose::depth_factor`].
    to_sun: [f32; 4],
    /// Radiance of the sun; extinction by water.
    sun: [f32; 4],
    /// Up direction; height of the eye over water.
    up: [f32; 4],
    /// Horizontal direction towards the sun; extinction by haze per world unit.
    sky_side: [f32; 4],
    sun_disc: [f32; 4],
    before: [[f32; 4]; 4],
    irradiance: [[f32; 4]; 9],
    /// Section planes relative to the eye: normal and distance.
    sections: [[f32; 4]; MAX_SECTION_PLANES],
    /// Radiance shown in place of the sky; 1 if it is.
    background: [f32; 4],
    size_px: [f32; 2],
    tan_half_fov: [f32; 2],
    near: f32,
    time_s: f32,
    morph_s: f32,
    exposure: f32,
    occlusion_radius_world: f32,
    occlusion_radius_depth: f32,
    occlusion_strength: f32,
    scale_px: f32,
    debug_view: u32,
    occlusion_samples: u32,
    relief_steps: f32,
    /// Width, and height shifted by 16 bits, of the target; larger than `size_px` with `Settings::render_scale`.
    target_px: u32,
    tone_mapping: u32,
    dither: f32,
    jitter: [f32; 2],
    before_s: f32,
    history: f32,
    /// Bits: 1 nothing changed since the previous frame; 2 surfaces emit light; 4 and 8 [`relief_method`]; 16 relief
    /// self-shadowing; 32 no mixing of levels of tiled textures; from bit 8 the accumulation of occlusion.
    flags: u32,
    /// Texture lookups along a pixel's footprint; negative where samplers do it for textures that are whole.
    lookups: f32,
    kernel: [[f32; 4]; MAX_SAMPLES as usize],
}

impl FrameUniform {
    /// The uniform block of a frame drawn at one size and shown at another; sides fit into 16 bits. `lookups` is the
    /// number of texture lookups along a pixel's footprint, negative where samplers do it.
    pub(crate) fn new(
        frame: &Frame<'_>,
        sky: &SkyLight,
        (width, height): (u32, u32),
        target: (u32, u32),
        step: &TemporalStep,
        lookups: f32,
        accumulation: AccumulationStep,
    ) -> Self {
        let (camera, near) = (&frame.camera, frame.settings.near);
        let (tx, ty) = camera.tan_half_fov(width, height);
        let direction = |d: DVec3, w: f32| d.as_vec3().extend(w).to_array();
        let occlusion = frame.settings.occlusion.unwrap_or_default();
        let (radius_world, radius_depth) = match occlusion.radius {
            OcclusionRadius::World(r) => (r, 0.0),
            OcclusionRadius::Depth(f) => (0.0, f * camera.depth_factor() as f32),
        };
        let samples = occlusion.samples.clamp(1, MAX_SAMPLES);
        let mut kernel = [[0.0; 4]; MAX_SAMPLES as usize];
        let centred = accumulation.method.has_centred_kernel();
        for (slot, sample) in kernel.iter_mut().zip(hemisphere_kernel(samples as usize, centred)) {
            *slot = sample.map(|x| x as f32);
        }
        Self {
            clip_from_view: step.jittered(clip_from_view(camera, near, (width, height)), (width, height)),
            view_from_world: view_from_world(camera).to_cols_array_2d(),
            to_sun: direction(sky.to_sun, camera.depth_factor() as f32),
            sun: sky.sun.extend(step.water[1]).to_array(),
            up: direction(sky.up, step.water[0]),
            sky_side: direction(sky.side, sky.haze),
            sun_disc: sky.disc,
            before: step.before.to_cols_array_2d(),
            irradiance: sky.irradiance,
            sections: sections(&frame.settings.sections, camera.eye),
            background: match frame.settings.background {
                Some([r, g, b]) => [r, g, b, 1.0],
                None => [0.0; 4],
            },
            size_px: [width as f32, height as f32],
            tan_half_fov: [tx as f32, ty as f32],
            near: near as f32,
            time_s: frame.time_s,
            morph_s: frame.settings.morph_s.max(0.0),
            exposure: frame.settings.exposure,
            occlusion_radius_world: radius_world,
            occlusion_radius_depth: radius_depth,
            occlusion_strength: occlusion.strength,
            scale_px: (f64::from(height) / (2.0 * ty)) as f32,
            debug_view: match frame.settings.debug_view {
                DebugView::Level => 1,
                DebugView::Cascade => 2,
                // Other views show intermediate results unchanged.
                _ => 0,
            },
            occlusion_samples: samples,
            relief_steps: frame.settings.relief_steps.clamp(1, MAX_RELIEF_STEPS) as f32,
            target_px: target.0 | (target.1 << 16),
            tone_mapping: match frame.settings.tone_mapping {
                ToneMapping::Filmic => 0,
                ToneMapping::Neutral => 1,
            },
            dither: if frame.settings.dither { 1.0 / 255.0 } else { 0.0 },
            jitter: step.jitter,
            before_s: step.before_s,
            history: step.history,
            flags: u32::from(step.still)
                | u32::from(frame.settings.emission) << 1
                | relief_method(frame.settings.relief_method) << 2
                | u32::from(frame.settings.relief_shadows) << 4
                | u32::from(frame.settings.anisotropy <= 1) << 5
                | accumulation.flags(),
            lookups,
            kernel,
        }
    }

    /// The block for a cascade: an orthographic view from the sun, with depth 1 at `top` above the map's centre and 0
    /// at the lowest surface that the map serves.
    pub(crate) fn as_the_sun_sees(&self, cascade: &Cascade, top: f64, eye: DVec3) -> Self {
        let at = cascade.place_of(eye, DVec3::ZERO);
        let scale = DVec3::new(2.0 / cascade.side, 2.0 / cascade.side, 1.0 / (top + cascade.below));
        let offset = (at + DVec3::Z * cascade.below) * scale;
        let diagonal = Mat4::from_scale(scale.as_vec3());
        Self {
            clip_from_view: (Mat4::from_translation(offset.as_vec3()) * diagonal).to_cols_array_2d(),
            view_from_world: Mat4::from_mat3(cascade.axes.transpose().as_mat3()).to_cols_array_2d(),
            ..*self
        }
    }
}

/// Section planes relative to the eye; one that cuts nothing where there is none.
fn sections(planes: &SectionPlanes, eye: DVec3) -> [[f32; 4]; MAX_SECTION_PLANES] {
    let mut all = [[0.0, 0.0, 0.0, 1.0]; MAX_SECTION_PLANES];
    for (slot, plane) in all.iter_mut().zip(planes.iter()) {
        *slot = plane.normal().as_vec3().extend(-plane.beyond(eye) as f32).to_array();
    }
    all
}

/// Index of a relief method in `relief_methods.wgsl`.
fn relief_method(method: ReliefMethod) -> u32 {
    match method {
        // Used where there is no acceleration texture.
        #[cfg(any(test, feature = "methods"))]
        ReliefMethod::RelaxedCones | ReliefMethod::Quadtree => 0,
        ReliefMethod::Relief => 0,
        #[cfg(any(test, feature = "methods"))]
        ReliefMethod::ParallaxOcclusion => 1,
        #[cfg(any(test, feature = "methods"))]
        ReliefMethod::SteepParallax => 2,
        #[cfg(any(test, feature = "methods"))]
        ReliefMethod::Parallax => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_is_what_the_shader_declares() {
        // Three matrices, eighteen vectors, 24 scalars, the kernel's vectors; WGSL's uniform layout
        // has no holes in that order.
        assert_eq!(size_of::<FrameUniform>(), 3 * 64 + 18 * 16 + 24 * 4 + MAX_SAMPLES as usize * 16);
    }
}
