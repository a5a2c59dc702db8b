//! Short forms of wgpu's descriptors: what the renderer's objects of one kind have in common.

use crate::resources::gpu::Gpu;

/// A 2D texture with one layer, one level and one sample.
pub(crate) fn texture_2d(
    label: &'static str,
    (width, height): (u32, u32),
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    }
}

/// Memory of a texture's texels, in bytes; devices may add some.
pub(crate) fn texture_bytes(texture: &wgpu::Texture) -> u64 {
    let side = |side: u32, level: u32| u64::from((side >> level).max(1));
    let texels: u64 = (0..texture.mip_level_count())
        .map(|level| side(texture.width(), level) * side(texture.height(), level))
        .sum();
    let layers = u64::from(texture.depth_or_array_layers());
    texels * layers * texel_bytes(texture.format())
}

/// Memory of a texel of a format that is not compressed, in bytes.
pub(crate) fn texel_bytes(format: wgpu::TextureFormat) -> u64 {
    format.block_copy_size(None).unwrap_or(4).into()
}

/// A texture that passes draw into and sample, and that can be read back.
pub(crate) const DRAWN_AND_SAMPLED: wgpu::TextureUsages = wgpu::TextureUsages::RENDER_ATTACHMENT
    .union(wgpu::TextureUsages::TEXTURE_BINDING)
    .union(wgpu::TextureUsages::COPY_SRC);

/// A texture that is sampled, written by copies, and read back or copied into a larger one.
pub(crate) const SAMPLED_AND_COPIED: wgpu::TextureUsages = wgpu::TextureUsages::TEXTURE_BINDING
    .union(wgpu::TextureUsages::COPY_DST)
    .union(wgpu::TextureUsages::COPY_SRC);

/// A texture that is streamed. Browsers write pictures into textures by drawing.
pub(crate) const STREAMED: wgpu::TextureUsages = if cfg!(target_family = "wasm") {
    SAMPLED_AND_COPIED.union(wgpu::TextureUsages::RENDER_ATTACHMENT)
} else {
    SAMPLED_AND_COPIED
};

/// Blending that is the same for colour and alpha.
pub(crate) const fn blend(
    src_factor: wgpu::BlendFactor,
    dst_factor: wgpu::BlendFactor,
    operation: wgpu::BlendOperation,
) -> wgpu::BlendState {
    let both = wgpu::BlendComponent { src_factor, dst_factor, operation };
    wgpu::BlendState { color: both, alpha: both }
}

/// A buffer for a uniform block `T`, written by the queue.
pub(crate) fn uniform_buffer<T>(gpu: &Gpu, label: &str) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: size_of::<T>() as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// An entry of a bind group's layout.
pub(crate) const fn layout_entry(
    binding: u32,
    visibility: wgpu::ShaderStages,
    ty: wgpu::BindingType,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

/// Binding of a whole buffer.
pub(crate) const fn buffer_binding(ty: wgpu::BufferBindingType) -> wgpu::BindingType {
    wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None }
}

/// Binding of a texture of floating-point or normalised texels.
pub(crate) const fn texture_binding(
    filterable: bool,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindingType {
    let sample_type = wgpu::TextureSampleType::Float { filterable };
    wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

/// The layout of a bind group.
pub(crate) fn group_layout(
    gpu: &Gpu,
    label: &str,
    entries: &[wgpu::BindGroupLayoutEntry],
) -> wgpu::BindGroupLayout {
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
    gpu.device.create_bind_group_layout(&descriptor)
}

/// The layout of a pipeline with these bind groups.
pub(crate) fn pipeline_layout(
    gpu: &Gpu,
    label: &str,
    groups: &[Option<&wgpu::BindGroupLayout>],
) -> wgpu::PipelineLayout {
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: groups,
        immediate_size: 0,
    })
}

/// A compute pipeline, named after its entry point.
#[cfg(any(test, feature = "methods"))]
pub(crate) fn compute_pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    entry: &str,
    layout: &wgpu::PipelineLayout,
) -> wgpu::ComputePipeline {
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(layout),
        module,
        entry_point: Some(entry),
        compilation_options: Default::default(),
        cache: None,
    })
}

/// A shader's source: files of `shaders/`, by name and in order, as `build.rs` has written them.
macro_rules! wgsl {
    ($($file:literal),+ $(,)?) => {
        concat!($(include_str!(concat!(env!("OUT_DIR"), "/", $file, ".wgsl"))),+)
    };
}
pub(crate) use wgsl;
