//! Fullscreen passes: pipelines and recording.

use crate::frame::graph::PassId;
use crate::frame::target::{Load, Target};
use crate::frame::timing::PassEncoder;
use crate::resources::gpu::Gpu;

/// A pipeline of `fullscreen.wgsl` and a fragment stage; the layout follows from the bindings that it reads.
pub(crate) fn fullscreen_pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    entry: &str,
    target: wgpu::ColorTargetState,
    constants: &[(&str, f64)],
) -> wgpu::RenderPipeline {
    pipeline(gpu, module, ["vs_fullscreen", entry], (target, None), constants)
}

/// A pipeline with its own vertex stage and optional depth.
pub(crate) fn pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    [vertex, entry]: [&str; 2],
    (target, depth_stencil): (wgpu::ColorTargetState, Option<wgpu::DepthStencilState>),
    constants: &[(&str, f64)],
) -> wgpu::RenderPipeline {
    gpu.render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(entry),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// A colour attachment.
pub(crate) fn attachment(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPassColorAttachment<'_> {
    wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
    }
}

/// Draws a fullscreen pass.
pub(crate) fn fullscreen(
    encoder: &mut PassEncoder<'_>,
    id: PassId,
    pipeline: &wgpu::RenderPipeline,
    group: &wgpu::BindGroup,
    target: &Target<'_>,
) {
    blended(encoder, id, pipeline, group, target, 1.0);
}

/// Draws a fullscreen pass with `share` as the blend constant.
pub(crate) fn blended(
    encoder: &mut PassEncoder<'_>,
    id: PassId,
    pipeline: &wgpu::RenderPipeline,
    group: &wgpu::BindGroup,
    target: &Target<'_>,
    share: f64,
) {
    let load = match target.load {
        Load::Clear => wgpu::LoadOp::Clear(wgpu::Color::BLACK),
        Load::Keep => wgpu::LoadOp::Load,
    };
    let attachments = [Some(attachment(target.colour, load))];
    let descriptor = wgpu::RenderPassDescriptor {
        label: Some(id.name()),
        color_attachments: &attachments,
        depth_stencil_attachment: depth_attachment(target),
        ..Default::default()
    };
    let mut pass = encoder.begin(id, &descriptor);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, group, &[]);
    pass.set_blend_constant(wgpu::Color { r: share, g: share, b: share, a: share });
    pass.draw(0..3, 0..1);
}

/// The depth attachment of `target`, if it has depth.
pub(crate) fn depth_attachment<'a>(
    target: &Target<'a>,
) -> Option<wgpu::RenderPassDepthStencilAttachment<'a>> {
    let load = match target.load {
        Load::Keep => wgpu::LoadOp::Load,
        // 0 is infinitely far.
        Load::Clear => wgpu::LoadOp::Clear(0.0),
    };
    target.depth.map(|view| wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
        stencil_ops: None,
    })
}
