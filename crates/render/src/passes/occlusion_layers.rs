//! HBAO+: ambient occlusion in sixteen deinterleaved layers of the depth buffer, whose lookups are local (Bavoil
//! 2014). One pass of the plan.

use crate::frame::fullscreen::{self, attachment, blended};
use crate::frame::graph::PassId;
use crate::frame::target::{Load, Target};
use crate::frame::targets::{OCCLUSION, OCCLUSION_MEAN};
use crate::frame::timing::PassEncoder;
use crate::passes::gbuffer::shader;
use crate::passes::occlusion::OcclusionNormals;
use crate::resources::descriptors::{texel_bytes, texture_2d, texture_bytes};
use crate::resources::gpu::Gpu;

/// Number of layers: every fourth pixel of every fourth row.
const LAYERS: u32 = 16;
/// Format of a layer's depths.
const DEPTHS: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// Pipelines of the pass.
#[derive(Debug)]
pub(crate) struct LayerPipelines {
    split: wgpu::RenderPipeline,
    estimate: wgpu::RenderPipeline,
    /// Into the frame's own picture, and into the accumulated mean.
    joined: [wgpu::RenderPipeline; 2],
}

impl LayerPipelines {
    pub(crate) fn new(
        gpu: &Gpu,
        source: &'static str,
        over: wgpu::BlendState,
        normals: OcclusionNormals,
    ) -> Self {
        let module = shader(gpu, "occlusion in layers", source);
        let pipeline = |vertex, fragment, target: wgpu::ColorTargetState| {
            fullscreen::pipeline(gpu, &module, [vertex, fragment], (target, None), &normals.constants())
        };
        let mean = wgpu::ColorTargetState { blend: Some(over), ..OCCLUSION_MEAN.into() };
        Self {
            split: pipeline("vs_layer", "fs_split", DEPTHS.into()),
            estimate: pipeline("vs_layer", "fs_layer", OCCLUSION.into()),
            joined: [OCCLUSION.into(), mean].map(|target| pipeline("vs_fullscreen", "fs_joined", target)),
        }
    }
}

/// Size of a layer.
fn layer_size((width, height): (u32, u32)) -> (u32, u32) {
    (width.div_ceil(4), height.div_ceil(4))
}

/// Memory of the layers for a picture of a size, in bytes.
pub(crate) fn layer_bytes(size: (u32, u32)) -> u64 {
    let (width, height) = layer_size(size);
    let texels = u64::from(width) * u64::from(height) * u64::from(LAYERS);
    texels * [DEPTHS, OCCLUSION].map(texel_bytes).iter().sum::<u64>()
}

/// Textures of the layers.
#[derive(Debug, Default)]
pub(crate) struct Layers {
    size: (u32, u32),
    /// Depth and openness.
    textures: Option<[wgpu::Texture; 2]>,
}

impl Layers {
    /// Allocates the layers for a picture of this size.
    pub(crate) fn prepare(&mut self, gpu: &Gpu, size: (u32, u32)) {
        if self.size == size && self.textures.is_some() {
            return;
        }
        self.size = size;
        let quarter = layer_size(size);
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let texture = |format| {
            let mut descriptor = texture_2d("occlusion layers", quarter, format, usage);
            descriptor.size.depth_or_array_layers = LAYERS;
            gpu.device.create_texture(&descriptor)
        };
        self.textures = Some([DEPTHS, OCCLUSION].map(texture));
    }

    /// Memory of the layers, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.textures.iter().flatten().map(texture_bytes).sum()
    }

    /// Splits the depth buffer, estimates each layer and joins the layers; `share` blends into the accumulated mean.
    /// The normal texture is only read with [`OcclusionNormals::Drawn`].
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pipelines: &LayerPipelines,
        (frame, depth, normal): (&wgpu::Buffer, &wgpu::TextureView, &wgpu::TextureView),
        (into, mean): (&wgpu::TextureView, Option<f64>),
    ) {
        let Some(textures) = &self.textures else { return };
        let all = |texture: &wgpu::Texture| {
            let array = wgpu::TextureViewDimension::D2Array;
            texture.create_view(&wgpu::TextureViewDescriptor { dimension: Some(array), ..Default::default() })
        };
        let [depths, open] = textures.each_ref().map(all);
        let group = |pipeline: &wgpu::RenderPipeline, entries: &[wgpu::BindGroupEntry<'_>]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("occlusion layers"),
                layout: &pipeline.get_bind_group_layout(0),
                entries,
            })
        };
        let view = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        let frame = wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() };
        let split = group(&pipelines.split, &[view(1, depth)]);
        let estimate =
            group(&pipelines.estimate, &[frame, view(1, depth), view(2, &depths), view(3, normal)]);
        let [deep, light] = textures;
        for (pipeline, group, texture) in
            [(&pipelines.split, &split, deep), (&pipelines.estimate, &estimate, light)]
        {
            for number in 0..LAYERS {
                layer(encoder, (pipeline, group), texture, number);
            }
        }
        let joined = &pipelines.joined[usize::from(mean.is_some())];
        let group = group(joined, &[view(2, &open)]);
        let target = Target { load: Load::Keep, ..Target::colour(into, (0, 0)) };
        blended(encoder, PassId::Occlusion, joined, &group, &target, mean.unwrap_or(1.0));
    }
}

/// Draws one layer.
fn layer(
    encoder: &mut PassEncoder<'_>,
    (pipeline, group): (&wgpu::RenderPipeline, &wgpu::BindGroup),
    texture: &wgpu::Texture,
    number: u32,
) {
    let one = texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: number,
        array_layer_count: Some(1),
        ..Default::default()
    });
    let attachments = [Some(attachment(&one, wgpu::LoadOp::Clear(wgpu::Color::BLACK)))];
    let descriptor = wgpu::RenderPassDescriptor {
        label: Some("occlusion layer"),
        color_attachments: &attachments,
        ..Default::default()
    };
    let mut pass = encoder.begin(PassId::Occlusion, &descriptor);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, group, &[]);
    pass.draw(0..3, number..number + 1);
}
