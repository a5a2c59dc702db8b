//! The shadow maps: redrawn when their content has changed.

use std::sync::Arc;

use glam::DVec3;

use super::mesh_casters::MeshCasters;
use super::{Cascade, Casters, SunlightUniform};
use crate::frame::batch::{Batch, Meshes};
use crate::frame::counters::Counters;
use crate::frame::graph::PassId;
use crate::frame::placed::PlacedInstances;
use crate::frame::settings::{Frame, MAP_SIDES, MAX_CASCADES, Shadows};
use crate::frame::targets::DEPTH;
use crate::frame::timing::PassEncoder;
use crate::frame::uniforms::FrameUniform;
use crate::resources::descriptors::{DRAWN_AND_SAMPLED, texture_2d, texture_bytes, uniform_buffer};
use crate::resources::gpu::Gpu;

/// Largest ratio of terrain screen errors for which a late map may be reused.
const MOST_GROUND_RATIO: f64 = 2.5;

/// Content of a layer: cascade, top above its centre, and casters.
#[derive(Debug)]
struct LayerState {
    cascade: Cascade,
    top: f64,
    meshes: Arc<MeshCasters>,
    /// Key of the terrain.
    key: Vec<u64>,
    /// Screen error of the terrain.
    ground_px: Option<f64>,
    /// Frames that reused it although something had changed.
    late: u32,
}

/// Inputs of a frame's shadow maps.
pub(crate) struct Sun<'a> {
    pub(crate) shadows: Shadows,
    pub(crate) cascades: &'a [Casters<'a>],
    /// Which maps are redrawn.
    pub(crate) redrawn: &'a [bool],
    /// The frame's uniforms for its camera, and the eye.
    pub(crate) frame: &'a FrameUniform,
    pub(crate) eye: DVec3,
    /// Surfaces whose relief writes depth cast shadows from its deepest point.
    pub(crate) sunken: bool,
}

/// The shadow maps: one texture with a layer per cascade.
#[derive(Debug)]
pub(crate) struct ShadowMaps {
    texture: Option<wgpu::Texture>,
    /// Frame uniforms for each cascade.
    frames: Vec<(wgpu::Buffer, wgpu::BindGroup)>,
    drawn: Vec<Option<LayerState>>,
    /// Mesh casters of the last frame, by layer.
    selected: Vec<Arc<MeshCasters>>,
    sampler: wgpu::Sampler,
    uniform: wgpu::Buffer,
}

impl ShadowMaps {
    /// Creates the pass without maps.
    pub(crate) fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Self {
        let frames = (0..MAX_CASCADES).map(|_| {
            let buffer = uniform_buffer::<FrameUniform>(gpu, "cascade");
            let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("cascade"),
                layout: frame_layout,
                entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
            });
            (buffer, group)
        });
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow maps"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            // Surfaces nearer to the sun than the stored depth are lit.
            compare: Some(wgpu::CompareFunction::GreaterEqual),
            ..Default::default()
        });
        Self {
            texture: None,
            frames: frames.collect(),
            drawn: Vec::new(),
            selected: Vec::new(),
            sampler,
            uniform: uniform_buffer::<SunlightUniform>(gpu, "sunlight"),
        }
    }

    /// The texture, and the cascade and top of each layer.
    #[cfg(test)]
    pub(crate) fn drawn(&self) -> Option<(&wgpu::Texture, Vec<(Cascade, f64)>)> {
        let drawn = self.drawn.iter().flatten().map(|drawn| (drawn.cascade, drawn.top));
        Some((self.texture.as_ref()?, drawn.collect()))
    }

    /// Memory of the maps, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.texture.as_ref().map_or(0, texture_bytes)
    }

    /// Height of the highest caster above the middle of the first map, as it was drawn.
    pub(crate) fn top(&self) -> Option<f64> {
        Some(self.drawn.first()?.as_ref()?.top)
    }

    /// All layers, once there are some.
    pub(crate) fn view(&self) -> Option<wgpu::TextureView> {
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        let all = wgpu::TextureViewDescriptor { dimension, ..Default::default() };
        Some(self.texture.as_ref()?.create_view(&all))
    }

    /// Bindings of the shadow lookup from binding 2: maps, comparison sampler and cascades.
    pub(crate) fn bindings<R>(&self, read: impl FnOnce([wgpu::BindGroupEntry<'_>; 3]) -> R) -> Option<R> {
        let view = self.view()?;
        let resources = [
            wgpu::BindingResource::TextureView(&view),
            wgpu::BindingResource::Sampler(&self.sampler),
            self.uniform.as_entire_binding(),
        ];
        let mut binding = 1;
        Some(read(resources.map(|resource| {
            binding += 1;
            wgpu::BindGroupEntry { binding, resource }
        })))
    }

    /// Uploads the absence of shadows, for forward-lit surfaces, which always look them up.
    pub(crate) fn none(&mut self, gpu: &Gpu) {
        self.drawn.clear();
        self.texture.get_or_insert_with(|| texture(gpu, MAP_SIDES[0], 1));
        let uniform = SunlightUniform::new(Shadows::default(), std::iter::empty(), DVec3::ZERO);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    /// Selects the mesh casters of a frame, in order of the cascades.
    pub(crate) fn casters<'a>(
        &mut self,
        (cascades, map_side): (&'a [Cascade], u32),
        frame: &Frame<'_>,
        placed: &PlacedInstances,
    ) -> Vec<Casters<'a>> {
        let select = |count: usize| {
            let before = self.selected.get(count - 1);
            Casters::new((&cascades[..count], map_side), frame, placed, before)
        };
        let casters: Vec<_> = (1..=cascades.len()).filter_map(select).collect();
        self.selected = casters.iter().map(|casters| Arc::clone(&casters.meshes)).collect();
        casters
    }

    /// Decides which maps are redrawn; to be called once a frame before [`ShadowMaps::record`], which draws them. Counts
    /// maps that stay although something has changed.
    pub(crate) fn begin(
        &mut self,
        gpu: &Gpu,
        shadows: Shadows,
        cascades: &[Casters<'_>],
        ground_px: Option<f64>,
        counters: &mut Counters,
    ) -> Vec<bool> {
        let side = shadows.map_side;
        let layers = cascades.len().max(1) as u32;
        let old = self.texture.as_ref();
        if old.is_none_or(|old| old.width() != side || old.depth_or_array_layers() < layers) {
            self.texture = Some(texture(gpu, side, layers));
            self.drawn.clear();
        }
        self.drawn.resize_with(cascades.len(), || None);
        let mut redrawn = Vec::new();
        for (layer, casters) in cascades.iter().enumerate() {
            let cascade = &casters.cascade;
            if let Some(drawn) = &mut self.drawn[layer]
                && drawn.cascade == *cascade
                && alike(drawn.ground_px, ground_px)
            {
                let same_meshes =
                    Arc::ptr_eq(&drawn.meshes, &casters.meshes) || drawn.meshes.key == casters.meshes.key;
                let same = same_meshes
                    && drawn.top == casters.top
                    && drawn.key == casters.key
                    && drawn.ground_px == ground_px;
                drawn.late = if same { 0 } else { drawn.late + 1 };
                if drawn.late <= shadows.max_staleness {
                    counters.late_shadow_maps += u32::from(!same);
                    redrawn.push(false);
                    continue;
                }
            }
            // Nearer cascades are redrawn sooner, and not all in one frame.
            let late = shadows.max_staleness * (cascades.len() - 1 - layer) as u32 / cascades.len() as u32;
            let (key, meshes) = (casters.key.clone(), Arc::clone(&casters.meshes));
            self.drawn[layer] =
                Some(LayerState { cascade: *cascade, top: casters.top, meshes, key, ground_px, late });
            redrawn.push(true);
        }
        redrawn
    }

    /// Draws the changed maps. Meshes are drawn as in the frame, whose bindings come with them; `ground` draws the
    /// terrain casters of a cascade and returns their number of triangles.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        sun: &Sun<'_>,
        (meshes, eye_frame): (Option<Meshes<'_>>, &wgpu::BindGroup),
        mut ground: impl FnMut(&mut wgpu::RenderPass<'_>, usize) -> u64,
        counters: &mut Counters,
    ) {
        let Sun { shadows, cascades, redrawn, frame, eye, sunken } = *sun;
        let Some(texture) = &self.texture else { return };
        for (layer, casters) in cascades.iter().enumerate().filter(|(layer, _)| redrawn[*layer]) {
            let cascade = &casters.cascade;
            let (buffer, group) = &self.frames[layer];
            let uniform = frame.as_the_sun_sees(cascade, casters.top, eye);
            gpu.queue.write_buffer(buffer, 0, bytemuck::bytes_of(&uniform));
            let view = texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2),
                base_array_layer: layer as u32,
                array_layer_count: Some(1),
                ..Default::default()
            });
            let descriptor = wgpu::RenderPassDescriptor {
                label: Some("shadow map"),
                color_attachments: &[],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &view,
                    depth_ops: Some(wgpu::Operations {
                        // 0 is furthest from the sun.
                        load: wgpu::LoadOp::Clear(0.0),
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..Default::default()
            };
            if let Some((patches, lists)) = meshes.and_then(|meshes| meshes.curved) {
                let ranges = casters.batches.iter().map(Batch::range);
                // Tessellated as for the eye, so that lit and casting surfaces are equal.
                lists.record((gpu, patches), encoder, PassId::ShadowMaps, eye_frame, ranges);
            }
            let mut pass = encoder.begin(PassId::ShadowMaps, &descriptor);
            pass.set_bind_group(0, group, &[]);
            if let Some(meshes) = meshes {
                casters.groups.draw(&mut pass, meshes, counters, |pass, pipelines, group, counters| {
                    let features = group.material.features;
                    if features.blend {
                        // Transparent surfaces cast no shadow.
                        return false;
                    }
                    pass.set_pipeline(if sunken && features.relief_may_be_deep() {
                        pipelines.sunken_caster(gpu, features)
                    } else if features.mask {
                        pipelines.pierced_caster(gpu, features)
                    } else {
                        pipelines.caster(gpu, features)
                    });
                    counters.shadow_triangles += group.triangles;
                    true
                });
            }
            counters.shadow_triangles += ground(&mut pass, layer);
            counters.shadow_maps += 1;
        }
        let places = self.drawn.iter().flatten().map(|drawn| (drawn.cascade, drawn.top));
        let uniform = SunlightUniform::new(shadows, places, eye);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }
}

/// Whether a map of terrain with one screen error may be reused for another: a much finer or coarser surface would
/// shadow itself.
fn alike(drawn: Option<f64>, now: Option<f64>) -> bool {
    match (drawn, now) {
        (Some(drawn), Some(now)) => (1.0 / MOST_GROUND_RATIO..=MOST_GROUND_RATIO).contains(&(drawn / now)),
        (drawn, now) => drawn == now,
    }
}

fn texture(gpu: &Gpu, side: u32, layers: u32) -> wgpu::Texture {
    let mut descriptor = texture_2d("shadow maps", (side, side), DEPTH, DRAWN_AND_SAMPLED);
    descriptor.size.depth_or_array_layers = layers;
    gpu.device.create_texture(&descriptor)
}
