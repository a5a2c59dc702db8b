//! The ground's maps and pictures on the device.

use glam::DVec3;

use super::place::{FloorPlace, FloorUniform, KEY_SIDE, UNDERSIDE_SIDE};
use crate::frame::batch::Meshes;
use crate::frame::counters::Counters;
use crate::frame::fullscreen::{fullscreen, pipeline};
use crate::frame::graph::PassId;
use crate::frame::placed::PlacedInstances;
use crate::frame::settings::{Frame, Shadows};
use crate::frame::target::{Load, Target};
use crate::frame::targets::RADIANCE;
use crate::frame::timing::PassEncoder;
use crate::frame::uniforms::FrameUniform;
use crate::passes::gbuffer::shader;
use crate::passes::shadows::{Casters, ShadowMaps, Sun};
use crate::resources::descriptors::{
    DRAWN_AND_SAMPLED, blend, texture_2d, texture_bytes, uniform_buffer, wgsl,
};
use crate::resources::gpu::Gpu;

const LOWEST: &str = wgsl!("fullscreen", "floor_lowest");
const SMOOTH: &str = wgsl!("fullscreen", "floor_smooth");
const PICTURE: &str = wgsl!("floor", "floor_picture");
const SHOWN: &str = wgsl!("common", "floor", "floor_shown");

/// Texels of the map of undersides along a side of a block, of which the deepest is found.
const BLOCK: u32 = 16;
/// Texels of the picture of the ground: along its longer side towards the light, and across.
const SIZE: (u32, u32) = (256, 192);
const PICTURE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg8Unorm;
const LOWEST_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// Pipelines of the pass.
#[derive(Debug)]
pub(crate) struct FloorPipelines {
    lowest: wgpu::RenderPipeline,
    picture: wgpu::RenderPipeline,
    smooth: wgpu::RenderPipeline,
    shown: wgpu::RenderPipeline,
    sampler: wgpu::Sampler,
}

impl FloorPipelines {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        use wgpu::{BlendFactor, BlendOperation};
        let [lowest, picture, smooth, shown] = [
            ("floor lowest", LOWEST),
            ("floor picture", PICTURE),
            ("floor smooth", SMOOTH),
            ("floor", SHOWN),
        ]
        .map(|(label, text)| shader(gpu, label, text));
        let constants = [("WIDTH", f64::from(SIZE.0)), ("ROWS", f64::from(SIZE.1))];
        // By multiplication; alpha, which marks surfaces, is multiplied by 1.
        let darkened = Some(blend(BlendFactor::Dst, BlendFactor::Zero, BlendOperation::Add));
        let darkened = wgpu::ColorTargetState { blend: darkened, ..RADIANCE.into() };
        Self {
            lowest: pipeline(gpu, &lowest, ["vs_fullscreen", "fs_lowest"], (LOWEST_FORMAT.into(), None), &[]),
            picture: pipeline(
                gpu,
                &picture,
                ["vs_floor", "fs_picture"],
                (PICTURE_FORMAT.into(), None),
                &constants,
            ),
            smooth: pipeline(
                gpu,
                &smooth,
                ["vs_fullscreen", "fs_smooth"],
                (PICTURE_FORMAT.into(), None),
                &[],
            ),
            shown: pipeline(gpu, &shown, ["vs_floor", "fs_shown"], (darkened, None), &[]),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("floor"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }
}

/// The maps of one frame.
pub(crate) struct FloorMaps<'a> {
    place: &'a FloorPlace,
    shadows: [Shadows; 2],
    /// Of undersides, and of the key light; each of one map.
    pub(crate) casters: [Vec<Casters<'a>>; 2],
    redrawn: [Vec<bool>; 2],
}

impl<'a> FloorMaps<'a> {
    /// Casters of the maps that are redrawn.
    pub(crate) fn redrawn_casters(&mut self) -> impl Iterator<Item = &mut Casters<'a>> {
        let all = self.casters.iter_mut().flatten().zip(self.redrawn.iter().flatten());
        all.filter_map(|(casters, redrawn)| redrawn.then_some(casters))
    }
}

/// The ground on the device.
#[derive(Debug)]
pub(crate) struct FloorPass {
    /// Of undersides, and of the key light.
    maps: [ShadowMaps; 2],
    uniform: wgpu::Buffer,
    /// Deepest undersides, the picture of the ground with a pattern, and without.
    pictures: Option<[wgpu::Texture; 3]>,
    /// The last uniform block, and how often the pictures were drawn.
    #[cfg(test)]
    block: FloorUniform,
    #[cfg(test)]
    pub(crate) pictures_drawn: u32,
}

impl FloorPass {
    pub(crate) fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Self {
        Self {
            maps: std::array::from_fn(|_| ShadowMaps::new(gpu, frame_layout)),
            uniform: uniform_buffer::<FloorUniform>(gpu, "floor"),
            pictures: None,
            #[cfg(test)]
            block: bytemuck::Zeroable::zeroed(),
            #[cfg(test)]
            pictures_drawn: 0,
        }
    }

    /// Memory of maps and pictures, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        let pictures = self.pictures.iter().flatten().map(texture_bytes).sum::<u64>();
        pictures + self.maps.iter().map(ShadowMaps::bytes).sum::<u64>()
    }

    /// The maps of undersides and of the key light, the picture of the ground, and the last uniform block.
    #[cfg(test)]
    pub(crate) fn drawn(&self) -> Option<([&wgpu::Texture; 2], &wgpu::Texture, FloorUniform)> {
        let [undersides, key] = &self.maps;
        let [_, _, picture] = self.pictures.as_ref()?;
        Some(([undersides.drawn()?.0, key.drawn()?.0], picture, self.block))
    }

    /// Selects what the maps show, and decides which are redrawn.
    pub(crate) fn begin<'a>(
        &mut self,
        gpu: &Gpu,
        place: &'a FloorPlace,
        (frame, placed): (&Frame<'_>, &PlacedInstances),
        counters: &mut Counters,
    ) -> FloorMaps<'a> {
        let (casters, redrawn) = Default::default();
        let mut found = FloorMaps { place, shadows: shadows(frame), casters, redrawn };
        for (i, maps) in self.maps.iter_mut().enumerate() {
            let shadows = found.shadows[i];
            let casters = maps.casters((&place.cascades[i..=i], shadows.map_side), frame, placed);
            found.redrawn[i] = maps.begin(gpu, shadows, &casters, None, counters);
            found.casters[i] = casters;
        }
        found
    }

    /// Draws the changed maps, and from them the picture of the ground. Meshes are drawn as in the frame.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        (pipelines, encoder): (&FloorPipelines, &mut PassEncoder<'_>),
        (found, frame, eye, sunken): (&FloorMaps<'_>, &FrameUniform, DVec3, bool),
        (meshes, eye_frame): (Option<Meshes<'_>>, &wgpu::BindGroup),
        counters: &mut Counters,
    ) {
        for (i, maps) in self.maps.iter_mut().enumerate() {
            let (cascades, redrawn) = (&found.casters[i][..], &found.redrawn[i][..]);
            let sun = Sun { shadows: found.shadows[i], cascades, redrawn, frame, eye, sunken };
            maps.record(gpu, encoder, &sun, (meshes, eye_frame), |_, _| 0, counters);
        }
        let tops = self.maps.each_ref().map(|maps| maps.top().unwrap_or_default());
        let uniform = found.place.uniform(tops, eye);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        #[cfg(test)]
        {
            self.block = uniform;
        }
        if self.pictures.is_none() || found.redrawn.iter().flatten().any(|redrawn| *redrawn) {
            self.draw_pictures(gpu, pipelines, encoder);
        }
    }

    fn draw_pictures(&mut self, gpu: &Gpu, pipelines: &FloorPipelines, encoder: &mut PassEncoder<'_>) {
        #[cfg(test)]
        {
            self.pictures_drawn += 1;
        }
        let pictures = self.pictures.get_or_insert_with(|| {
            let blocks = UNDERSIDE_SIDE / BLOCK;
            let texture = |label, size, format| {
                gpu.device.create_texture(&texture_2d(label, size, format, DRAWN_AND_SAMPLED))
            };
            [
                texture("floor lowest", (blocks, blocks), LOWEST_FORMAT),
                texture("floor pattern", SIZE, PICTURE_FORMAT),
                texture("floor picture", SIZE, PICTURE_FORMAT),
            ]
        });
        let [lowest, pattern, picture] =
            pictures.each_ref().map(|texture| texture.create_view(&Default::default()));
        let [Some(undersides), Some(key)] = [0, 1].map(|i: usize| self.maps[i].view()) else { return };
        let view = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        let uniform = wgpu::BindGroupEntry { binding: 1, resource: self.uniform.as_entire_binding() };
        for (pipeline, entries, into) in [
            (&pipelines.lowest, &[view(0, &undersides)][..], &lowest),
            (
                &pipelines.picture,
                &[uniform, view(2, &lowest), view(3, &undersides), view(4, &key)][..],
                &pattern,
            ),
            (&pipelines.smooth, &[view(0, &pattern)][..], &picture),
        ] {
            let group = bind_group(gpu, pipeline, entries);
            fullscreen(encoder, PassId::Floor, pipeline, &group, &Target::colour(into, (0, 0)));
        }
    }

    /// Darkens the background of the lit picture.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        (pipelines, encoder): (&FloorPipelines, &mut PassEncoder<'_>),
        frame: &wgpu::Buffer,
        (depth, into): (&wgpu::TextureView, &wgpu::TextureView),
    ) {
        let Some(pictures) = &self.pictures else { return };
        let [lowest, _, picture] =
            pictures.each_ref().map(|texture| texture.create_view(&Default::default()));
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let entries = [
            entry(0, frame.as_entire_binding()),
            entry(1, self.uniform.as_entire_binding()),
            entry(2, wgpu::BindingResource::TextureView(&lowest)),
            entry(3, wgpu::BindingResource::TextureView(depth)),
            entry(4, wgpu::BindingResource::TextureView(&picture)),
            entry(5, wgpu::BindingResource::Sampler(&pipelines.sampler)),
        ];
        let group = bind_group(gpu, &pipelines.shown, &entries);
        let over = Target { load: Load::Keep, ..Target::colour(into, (0, 0)) };
        fullscreen(encoder, PassId::Floor, &pipelines.shown, &group, &over);
    }
}

fn bind_group(
    gpu: &Gpu,
    pipeline: &wgpu::RenderPipeline,
    entries: &[wgpu::BindGroupEntry<'_>],
) -> wgpu::BindGroup {
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("floor"),
        layout: &pipeline.get_bind_group_layout(0),
        entries,
    })
}

/// Settings of the map of undersides and of that of the key light: as late as the frame's.
fn shadows(frame: &Frame<'_>) -> [Shadows; 2] {
    let of_frame = frame.settings.shadows.unwrap_or_default();
    [UNDERSIDE_SIDE, KEY_SIDE].map(|map_side| Shadows { cascades: 1, map_side, ..of_frame })
}
