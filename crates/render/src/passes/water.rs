//! Water with a level surface: its settings and the pass that draws it.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3};

use crate::frame::fullscreen::attachment;
use crate::frame::graph::PassId;
use crate::frame::targets::{DEPTH, RADIANCE};
use crate::frame::timing::PassEncoder;
use crate::passes::gbuffer::{ADD, MULTIPLY, shader};
use crate::passes::reflections::Tracer;
use crate::resources::descriptors::{
    buffer_binding, group_layout, layout_entry, pipeline_layout, texture_binding, uniform_buffer, wgsl,
};
use crate::resources::gpu::Gpu;

/// Shader source, with the files that compute reflections.
macro_rules! water {
    ($($mirrors:literal),+) => {
        wgsl!("common", "shadows", "sky", "brdf", "water", $($mirrors),+)
    };
}

const WATER: &str = water!("water_sky");
const MIRRORING: &str = water!("tracing", "water_picture");

/// Number of ripples; as in the shader.
const WAVES: usize = 12;
/// Lengths of the longest and the shortest ripple, in units of [`Water::ripples`].
const LENGTHS: [f64; 2] = [6.0, 0.3];
/// Steepest slope of each ripple. The root mean square of their sum is 0.054, as in a breeze.
const STEEPNESS: f64 = 0.022;
/// Absorption of red and blue relative to green, about as in lakes.
const ABSORPTION: DVec3 = DVec3::new(3.5, 1.0, 1.2);
/// Share of light from above that deep water scatters back.
const SCATTERED: DVec3 = DVec3::new(0.006, 0.026, 0.024);

/// Water at one height (world y) of unlimited extent; terrain above it is land. Not drawn for eyes below it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Water {
    /// World y of the surface.
    pub level: f64,
    /// Distance in world units after which a tenth of green light remains, above 0; less of red.
    pub clarity: f64,
    /// World units per metre for the lengths of ripples, which are 0.3 to 6 metres; above 0.
    pub ripples: f64,
}

impl Water {
    /// The shader's input for an eye; `None` for eyes below the surface and for invalid settings.
    pub(crate) fn view_from(&self, eye: DVec3) -> Option<WaterView> {
        let height = eye.y - self.level;
        let sound = self.clarity > 0.0 && self.ripples > 0.0 && self.clarity.is_finite();
        if !(sound && height > 0.0 && height.is_finite() && self.ripples.is_finite()) {
            return None;
        }
        let wave = |i: usize| {
            let share = i as f64 / (WAVES - 1) as f64;
            let length = self.ripples * LENGTHS[0] * (LENGTHS[1] / LENGTHS[0]).powf(share);
            // Directions advance by the golden angle, so no two are parallel.
            let turn = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt()) * i as f64;
            let vector = DVec2::from_angle(turn) / length;
            let phase = vector.x * eye.x + vector.y * eye.z + 0.61 * i as f64;
            Wave { vector, phase: phase - phase.floor(), steepness: STEEPNESS }
        };
        Some(WaterView {
            extinction: ABSORPTION * (10.0_f64.ln() / self.clarity),
            scattered: SCATTERED,
            height,
            waves: (0..WAVES).map(wave).collect(),
        })
    }
}

/// A ripple: a sine wave, described by its slope.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wave {
    /// Wave vector in x and z, cycles per world unit.
    pub(crate) vector: DVec2,
    /// Phase below the eye, in cycles.
    pub(crate) phase: f64,
    /// Steepest slope.
    pub(crate) steepness: f64,
}

/// Water as one eye sees it: the input of the shader.
#[derive(Clone, Debug)]
pub(crate) struct WaterView {
    /// Extinction of red, green and blue per world unit.
    pub(crate) extinction: DVec3,
    /// Share of the light that deep water sends back.
    pub(crate) scattered: DVec3,
    /// Height of the eye over the water, above 0.
    pub(crate) height: f64,
    /// Ripples.
    pub(crate) waves: Vec<Wave>,
}

/// Uniform of the pass: `struct Water` of `water.wgsl`; keep the two in step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct WaterUniform {
    /// Extinction of red, green and blue; height of the eye.
    extinction: [f32; 4],
    scattered: [f32; 4],
    waves: [[f32; 4]; WAVES],
}

impl WaterUniform {
    fn new(water: &WaterView) -> Self {
        let mut waves = [[0.0; 4]; WAVES];
        for (slot, wave) in waves.iter_mut().zip(&water.waves) {
            *slot = wave.vector.as_vec2().extend(wave.phase as f32).extend(wave.steepness as f32).to_array();
        }
        Self {
            extinction: water.extinction.as_vec3().extend(water.height as f32).to_array(),
            scattered: water.scattered.as_vec3().extend(0.0).to_array(),
            waves,
        }
    }
}

/// Pipelines of the pass.
#[derive(Debug)]
pub(crate) struct WaterPipelines {
    layout: wgpu::BindGroupLayout,
    /// Multiplies the picture by the transmitted share, then adds the water's own light.
    draws: [wgpu::RenderPipeline; 2],
}

/// The water pass.
#[derive(Debug)]
pub(crate) struct WaterPass {
    uniform: wgpu::Buffer,
}

impl WaterPass {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self { uniform: uniform_buffer::<WaterUniform>(gpu, "water") }
    }

    /// Uploads a frame's water.
    pub(crate) fn prepare(&self, gpu: &Gpu, water: &WaterView) {
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&WaterUniform::new(water)));
    }

    /// Draws the prepared water over the lit picture. `mirrored` holds a copy of the picture, the depth pyramid and
    /// the tracing settings, for screen-space reflections.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pipelines: &WaterPipelines,
        light: &wgpu::BindGroup,
        (depth, mirrored): (&wgpu::TextureView, Option<(&wgpu::TextureView, &wgpu::TextureView, &Tracer)>),
        into: &wgpu::TextureView,
    ) {
        let view = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        let mut entries = vec![
            wgpu::BindGroupEntry { binding: 0, resource: self.uniform.as_entire_binding() },
            view(1, depth),
        ];
        if let Some((lit, cells, tracer)) = mirrored {
            let tracing = wgpu::BindGroupEntry { binding: 4, resource: tracer.binding() };
            entries.extend([view(2, lit), view(3, cells), tracing]);
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("water"),
            layout: &pipelines.layout,
            entries: &entries,
        });
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some(PassId::Water.name()),
            color_attachments: &[Some(attachment(into, wgpu::LoadOp::Load))],
            // Read-only: the shader samples it too.
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: None,
                stencil_ops: None,
            }),
            ..Default::default()
        };
        let mut pass = encoder.begin(PassId::Water, &descriptor);
        pass.set_bind_group(0, light, &[]);
        pass.set_bind_group(1, &group, &[]);
        for pipeline in &pipelines.draws {
            pass.set_pipeline(pipeline);
            pass.draw(0..12, 0..1);
        }
    }
}

impl WaterPipelines {
    /// `light` is the layout of group 0. `by_cells` selects the search of screen-space reflections; `None` reflects
    /// the sky only.
    pub(crate) fn new(gpu: &Gpu, light: &wgpu::BindGroupLayout, by_cells: Option<bool>) -> Self {
        let uniform = buffer_binding(wgpu::BufferBindingType::Uniform);
        let texture = texture_binding(false, wgpu::TextureViewDimension::D2);
        let fragment = wgpu::ShaderStages::FRAGMENT;
        let entries = [
            layout_entry(0, wgpu::ShaderStages::VERTEX_FRAGMENT, uniform),
            layout_entry(1, fragment, texture),
            layout_entry(2, fragment, texture),
            layout_entry(3, fragment, texture),
            layout_entry(4, fragment, uniform),
        ];
        let entries = if by_cells.is_some() { &entries[..] } else { &entries[..2] };
        let layout = group_layout(gpu, "water", entries);
        let pipeline_layout = pipeline_layout(gpu, "water", &[Some(light), Some(&layout)]);
        let module = shader(gpu, "water", if by_cells.is_some() { MIRRORING } else { WATER });
        let search = [("HI_Z", f64::from(u8::from(by_cells == Some(true))))];
        let constants: &[(&str, f64)] = if by_cells.is_some() { &search } else { &[] };
        let draws = [("fs_water_left", MULTIPLY), ("fs_water_added", ADD)].map(|(fragment, blend)| {
            let target = wgpu::ColorTargetState { blend: Some(blend), ..RADIANCE.into() };
            gpu.render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(fragment),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("vs_water"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: Default::default(),
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(false),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(fragment),
                    compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
                    targets: &[Some(target)],
                }),
                multiview_mask: None,
                cache: None,
            })
        });
        Self { layout, draws }
    }
}
