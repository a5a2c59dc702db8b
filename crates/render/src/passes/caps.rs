//! Depth of the caps of solids that section planes cut ([`crate::Settings::sections`]).
//!
//! The G-buffer pass shades back faces that are seen through a cut as if they lay on the plane, but keeps their own depth,
//! since of a closed mesh the nearest face behind a plane is a back face just where the plane cuts its inside. This pass
//! then moves their depth to the plane, so that all later passes see a flat face.

use crate::frame::graph::PassId;
use crate::frame::targets::DEPTH;
use crate::frame::timing::PassEncoder;
use crate::passes::gbuffer::shader;
use crate::resources::descriptors::wgsl;
use crate::resources::gpu::Gpu;

const CAPS: &str = wgsl!("common", "fullscreen", "section", "caps");

/// The pipeline.
#[derive(Debug)]
pub(crate) struct Caps(wgpu::RenderPipeline);

impl Caps {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let module = &shader(gpu, "caps", CAPS);
        Self(gpu.render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("fs_caps"),
            layout: None,
            vertex: wgpu::VertexState {
                module,
                entry_point: Some("vs_fullscreen"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Always),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: Some("fs_caps"),
                compilation_options: Default::default(),
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        }))
    }

    /// Moves the depth of caps, which `normal` marks, to the section planes.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        frame: &wgpu::Buffer,
        normal: &wgpu::TextureView,
        depth: &wgpu::TextureView,
    ) {
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("caps"),
            layout: &self.0.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(normal) },
            ],
        });
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some(PassId::Caps.name()),
            color_attachments: &[],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        };
        let mut pass = encoder.begin(PassId::Caps, &descriptor);
        pass.set_pipeline(&self.0);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
}
