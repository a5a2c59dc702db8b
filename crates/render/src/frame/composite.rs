//! Final pass into a host's targets, with depth or over existing content.

use crate::frame::fullscreen;
use crate::frame::pipelines::COMPOSITE;
use crate::frame::target::{Load, Target};
use crate::passes::gbuffer::shader;
use crate::resources::gpu::Gpu;

/// Pipelines by depth format and load, compiled when a host first needs them.
#[derive(Debug, Default)]
pub(crate) struct Composites {
    made: Vec<(Kind, wgpu::RenderPipeline)>,
}

/// A target's depth format and load operation.
pub(crate) type Kind = (Option<wgpu::TextureFormat>, Load);

/// A target's kind.
pub(crate) fn kind(target: &Target<'_>) -> Kind {
    (target.depth.map(|view| view.texture().format()), target.load)
}

impl Composites {
    /// Compiles what `target` needs, of which the colour has `format`.
    pub(crate) fn ensure(&mut self, gpu: &Gpu, format: wgpu::TextureFormat, target: &Target<'_>) {
        let kind = kind(target);
        if self.get(target).is_none() {
            self.made.push((kind, pipeline(gpu, format, kind)));
        }
    }

    /// The pipeline compiled by [`Composites::ensure`].
    pub(crate) fn get(&self, target: &Target<'_>) -> Option<&wgpu::RenderPipeline> {
        let kind = kind(target);
        self.made.iter().find(|(made, _)| *made == kind).map(|(_, pipeline)| pipeline)
    }
}

fn pipeline(gpu: &Gpu, format: wgpu::TextureFormat, kind: Kind) -> wgpu::RenderPipeline {
    let is = |yes: bool| f64::from(u8::from(yes));
    let constants = [("ENCODE_SRGB", is(!format.is_srgb())), ("KEEP", is(kind.1 == Load::Keep))];
    let module = shader(gpu, "composite", COMPOSITE);
    into_target(gpu, &module, (format, kind), ["fs_overlay", "fs_composite"], &constants)
}

/// A pipeline over the whole of a host's target; the entry point depends on whether there is depth.
pub(crate) fn into_target(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    (format, (depth, load)): (wgpu::TextureFormat, Kind),
    [flat, deep]: [&str; 2],
    constants: &[(&str, f64)],
) -> wgpu::RenderPipeline {
    let entry = if depth.is_some() { deep } else { flat };
    let depth_stencil = depth.map(|format| wgpu::DepthStencilState {
        format,
        depth_write_enabled: Some(true),
        // Reversed depth: nearer is greater.
        depth_compare: Some(match load {
            Load::Keep => wgpu::CompareFunction::Greater,
            Load::Clear => wgpu::CompareFunction::Always,
        }),
        stencil: Default::default(),
        bias: Default::default(),
    });
    let stages = ["vs_fullscreen", entry];
    fullscreen::pipeline(gpu, module, stages, (format.into(), depth_stencil), constants)
}
