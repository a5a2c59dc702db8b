//! The renderer: plans a frame's passes and records them.

use std::sync::OnceLock;

use glam::DVec3;

use super::asset::AssetGpu;
use super::buffer::GrowingBuffer;
use super::composite::{Composites, depth_attachment};
use super::counters::Counters;
use super::debug::{self, DebugPipelines};
use super::draw::DrawList;
use super::gpu::{Gpu, RenderError};
use super::graph::{self, Needs, Pass, PassId, Resource};
use super::instance::InstanceRaw;
use super::lights::{LampList, LampPass};
use super::material::Material;
use super::material_kit::{Features, MaterialKit};
use super::pipelines::Pipelines;
use super::scene::{Frame, MIN_RENDER_SCALE, Shade};
use super::shadows::{self, Casters, ShadowMaps, Sun};
use super::sky::SkyGpu;
use super::target::{Load, Target};
use super::targets::Targets;
use super::terrain::{TerrainGpu, TerrainLook, TerrainPipelines, TileList, TileRaw};
use super::texture::TextureShape;
use super::timing::{PassEncoder, Timer, Timings};
use super::uniforms::FrameUniform;

/// Draws frames into targets of one format.
#[derive(Debug)]
pub struct Renderer {
    kit: MaterialKit,
    pipelines: Pipelines,
    composites: Composites,
    debug: DebugPipelines,
    targets: Targets,
    frame_buffer: wgpu::Buffer,
    frame_group: wgpu::BindGroup,
    instances: GrowingBuffer<InstanceRaw>,
    tiles: GrowingBuffer<TileRaw>,
    shadow_maps: ShadowMaps,
    sky: SkyGpu,
    lamps: LampPass,
    /// Compiled with the first terrain: most scenes have none.
    terrain: OnceLock<TerrainPipelines>,
    target_format: wgpu::TextureFormat,
    warned_wireframe: bool,
    /// Where somebody asked what passes take.
    timer: Option<Timer>,
}

impl Renderer {
    /// A renderer for targets of `target_format`. With an sRGB format the target encodes what it
    /// is given; with any other the shader applies the sRGB curve, so both show the same picture.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device refuses a shader or pipeline.
    pub fn new(gpu: &Gpu, target_format: wgpu::TextureFormat) -> Result<Self, RenderError> {
        let kit = MaterialKit::new(gpu);
        let pipelines = Pipelines::new(gpu, &kit, target_format);
        let frame_buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frame"),
            size: size_of::<FrameUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let frame_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: &pipelines.frame_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: frame_buffer.as_entire_binding() }],
        });
        let shadow_maps = ShadowMaps::new(gpu, &pipelines.frame_layout);
        gpu.check()?;
        Ok(Self {
            kit,
            pipelines,
            composites: Composites::default(),
            debug: DebugPipelines::default(),
            targets: Targets::default(),
            frame_buffer,
            frame_group,
            instances: GrowingBuffer::new("instance buffer", wgpu::BufferUsages::VERTEX),
            tiles: GrowingBuffer::new("terrain tiles", wgpu::BufferUsages::VERTEX),
            shadow_maps,
            sky: SkyGpu::new(gpu),
            lamps: LampPass::new(gpu),
            terrain: OnceLock::new(),
            target_format,
            warned_wireframe: false,
            timer: None,
        })
    }

    /// The format of the targets that this renderer draws into.
    #[must_use]
    pub fn target_format(&self) -> wgpu::TextureFormat {
        self.target_format
    }

    /// Times passes from the next frame on, or no longer. Timestamps are two queries a pass, read back without waiting.
    pub fn time_passes(&mut self, gpu: &Gpu, on: bool) {
        match (&self.timer, on) {
            (None, true) => self.timer = Some(Timer::new(gpu)),
            (_, false) => self.timer = None,
            (Some(_), true) => {}
        }
    }

    /// What passes took in the last frames, of which the newest are not yet back from the device; empty unless
    /// [`Renderer::time_passes`] asked for it.
    pub fn timings(&mut self) -> Timings {
        self.timer.as_mut().map(Timer::timings).unwrap_or_default()
    }

    /// Makes an empty asset. Positions of its vertices will be relative to `origin` (asset units);
    /// materials refer to `textures` by index.
    #[must_use]
    pub fn create_asset(
        &self,
        gpu: &Gpu,
        origin: DVec3,
        materials: &[Material],
        textures: &[TextureShape],
    ) -> AssetGpu {
        materials.iter().for_each(|material| self.pipelines.meshes.ensure(gpu, Features::of(material)));
        AssetGpu::new(gpu, self.kit.clone(), origin, materials, textures)
    }

    /// Makes a terrain without tiles. The first one compiles its pipelines.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] where the device cannot hold the atlas of tiles, [`RenderError::Device`] if it
    /// refuses a shader or pipeline.
    pub fn create_terrain(&self, gpu: &Gpu, look: TerrainLook) -> Result<TerrainGpu, RenderError> {
        let pipelines = self.terrain.get_or_init(|| TerrainPipelines::new(gpu, &self.pipelines.frame_layout));
        TerrainGpu::new(gpu, pipelines, look)
    }

    /// Records a frame into `target`. Uploads happen at once, drawing when the
    /// caller submits `encoder` to the device's queue; one frame must be submitted before the next
    /// is recorded.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] for a size that the device cannot draw (or 0), [`RenderError::Target`] for views
    /// that cannot be drawn into, and [`RenderError::Device`] with the first error that wgpu reported since the
    /// last frame.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &Target<'_>,
        frame: &Frame<'_>,
    ) -> Result<Counters, RenderError> {
        target.check(self.target_format)?;
        let mut passes = PassEncoder::new(encoder, self.timer.as_mut().map(Timer::begin));
        let (size, mut counters) = (drawn_size(target, frame.settings.render_scale), Counters::default());
        let mut list = DrawList::new(frame, size, &mut counters);
        let sky = self.sky.light(gpu, &frame.environment);
        let shadows = frame.settings.shadows.filter(|_| sky.sun.max_element() > 0.0);
        let shadows = shadows.map(|shadows| shadows.clamped(gpu.device.limits().max_texture_dimension_2d));
        let cascades = shadows.map(|shadows| shadows::of_frame(frame, &list, shadows));
        let cascades = cascades.unwrap_or_default();
        let mut casters: Vec<Casters<'_>> = Vec::new();
        if let Some(shadows) = shadows {
            casters = (1..=cascades.len())
                .filter_map(|count| Casters::new(&cascades[..count], shadows.map_side))
                .collect();
            casters.iter_mut().for_each(|casters| casters.add_meshes(&mut list, frame));
        }
        let ground = match frame.terrain {
            Some(terrain) => {
                Some(TileList::new(gpu, terrain, frame.camera.eye, &mut casters, &mut self.tiles)?)
            }
            None => None,
        };
        let ground = ground.filter(|ground| !ground.is_empty());
        if frame.settings.wireframe && self.pipelines.meshes.wire.is_none() && !self.warned_wireframe {
            tracing::warn!("{} cannot draw wireframes; they are left out", gpu.describe());
            self.warned_wireframe = true;
        }
        let has_surfaces = !list.batches.is_empty() || ground.is_some();
        let occlusion = frame.settings.occlusion.is_some_and(|o| o.strength > 0.0);
        let shown = debug::shown(frame.settings.shade, occlusion, !casters.is_empty());
        let lamps = Some(LampList::new(frame, size)).filter(|list| !list.lamps.is_empty());
        let lamps = lamps.filter(|_| LampPass::is_possible(gpu));
        let plan = graph::plan(
            &graph::candidates(Needs {
                geometry: has_surfaces,
                occlusion,
                shadows: !casters.is_empty(),
                lamps: lamps.is_some(),
                emission: list.any(|features| features.emits && !features.blend),
                transparency: list.any(|features| features.blend),
                shown: shown.map(|(_, reads)| reads),
                wireframe: frame.settings.wireframe && self.pipelines.meshes.wire.is_some(),
                // What is enlarged is smoothed by that.
                antialias: frame.settings.antialias && size == target.size,
                depth: target.depth.is_some(),
                keep: target.load == Load::Keep,
            }),
            &[Resource::Target],
        );
        self.targets.ensure(gpu, size, &graph::resources(&plan))?;
        self.instances.write(gpu, 0, &list.instances)?;
        if let Some(lamps) = &lamps {
            self.lamps.prepare(gpu, lamps)?;
        }
        let uniform = FrameUniform::new(frame, &sky, size, target.size);
        gpu.queue.write_buffer(&self.frame_buffer, 0, bytemuck::bytes_of(&uniform));
        let runs = |id| plan.iter().any(|pass| pass.id == id);
        if let Some((shown, _)) = shown.filter(|_| runs(PassId::Debug)) {
            self.debug.ensure(gpu, self.target_format, shown, target);
            if runs(PassId::Overdraw) {
                self.terrain.get().inspect(|terrain| {
                    terrain.prepare_overdraw(gpu, &self.pipelines.frame_layout);
                });
            }
        } else if runs(PassId::Composite) {
            self.composites.ensure(gpu, self.target_format, target);
        } else if target.load == Load::Clear {
            clear_depth(passes.encoder, target);
        }
        if casters.is_empty() && runs(PassId::Transparency) {
            self.shadow_maps.none(gpu);
        }
        passes.planned();
        if let Some(shadows) = shadows
            && runs(PassId::ShadowMaps)
        {
            let ground_px = frame.terrain.map(|terrain| terrain.error_px);
            let sun = Sun { shadows, cascades: &casters, frame: &uniform, eye: frame.camera.eye, ground_px };
            self.shadow_maps.record(
                gpu,
                &mut passes,
                &sun,
                (&self.pipelines.meshes, self.instances.buffer()),
                |pass, cascade| match (&ground, self.terrain.get(), self.tiles.buffer()) {
                    (Some(ground), Some(pipelines), Some(tiles)) => {
                        ground.cast(pass, pipelines, tiles, cascade)
                    }
                    _ => 0,
                },
                &mut counters,
            );
            passes.recorded(PassId::ShadowMaps);
        }
        for pass in &plan {
            self.run(gpu, &mut passes, *pass, target, frame, (&list, ground.as_ref()), &mut counters);
            passes.recorded(pass.id);
            counters.passes.push(pass.id);
        }
        passes.end(self.timer.as_mut());
        gpu.check()?;
        Ok(counters)
    }

    /// The maps of shadows.
    #[cfg(test)]
    pub(crate) fn shadow_maps(&self) -> &ShadowMaps {
        &self.shadow_maps
    }

    /// The intermediate texture of a resource, if the last frame's plan had it.
    pub(crate) fn intermediate(&self, resource: Resource) -> Option<&wgpu::Texture> {
        self.targets.texture(resource)
    }

    #[expect(clippy::too_many_arguments, reason = "one call site; a struct would only rename them")]
    fn run(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pass: Pass,
        target: &Target<'_>,
        frame: &Frame<'_>,
        list: (&DrawList<'_>, Option<&TileList<'_>>),
        counters: &mut Counters,
    ) {
        use Resource::{Albedo, Depth, Display, Normal, Occlusion, OcclusionRaw, Radiance, Sunlight};
        let p = &self.pipelines;
        let full = |encoder: &mut PassEncoder<'_>, pipeline, reads: &[Resource], write| {
            self.full(gpu, encoder, pass.id, (pipeline, reads), write);
        };
        match pass.id {
            PassId::GBuffer | PassId::Overdraw | PassId::Emission | PassId::Transparency | PassId::Edges => {
                self.geometry(gpu, encoder, pass.id, frame, list, counters)
            }
            PassId::Occlusion => full(encoder, &p.occlusion, &[Depth], OcclusionRaw),
            PassId::OcclusionBlur => full(encoder, &p.blur, &[Depth, OcclusionRaw], Occlusion),
            // Before all others: what has changed of the maps is drawn when the frame is planned.
            PassId::ShadowMaps => {}
            PassId::Sunlight => self.sunlight(gpu, encoder),
            PassId::Lighting => {
                let [occlusion, shadows] =
                    [PassId::OcclusionBlur, PassId::Sunlight].map(|pass| counters.passes.contains(&pass));
                // The shader reads none of what there is not, but its slot must be filled: any will do.
                let or = |there, resource| if there { resource } else { Albedo };
                let reads = [Depth, Normal, Albedo, or(occlusion, Occlusion), or(shadows, Sunlight)];
                let pipeline = &p.lighting[usize::from(occlusion)][usize::from(shadows)];
                self.lit(gpu, encoder, pass.id, (pipeline, &reads), true);
            }
            PassId::Lamps => self.lamps(gpu, encoder, frame.settings.shade == Shade::Lamps),
            PassId::Wireframe => {
                self.over(gpu, encoder, pass.id, (&p.wireframe, &[Resource::Edges]), Radiance);
            }
            PassId::Sky => self.lit(gpu, encoder, pass.id, (&p.sky, &[]), false),
            PassId::ToneMap if pass.writes(Display) => {
                full(encoder, &p.tonemap_display, &[Radiance], Display);
            }
            PassId::AntiAlias => {
                let group = self.inputs(gpu, &p.antialias, &[Display]);
                fullscreen(encoder, pass.id, &p.antialias, &group, &Target { depth: None, ..*target });
            }
            PassId::ToneMap => {
                let group = self.inputs(gpu, &p.tonemap, &[Radiance]);
                fullscreen(encoder, pass.id, &p.tonemap, &group, &Target { depth: None, ..*target });
            }
            PassId::Debug => {
                let settings = &frame.settings;
                // Of what there is not the plan has no pass.
                let [occlusion, shadows] =
                    [PassId::OcclusionBlur, PassId::Sunlight].map(|pass| counters.passes.contains(&pass));
                let Some((shown, reads)) = debug::shown(settings.shade, occlusion, shadows) else {
                    return;
                };
                let Some(pipeline) = self.debug.get(shown, target) else { return };
                // The shader reads none of what is not shown, but its slots must be filled.
                let mut slots = [Depth; 3];
                slots[..reads.len()].copy_from_slice(reads);
                let group = self.inputs(gpu, pipeline, &slots);
                fullscreen(encoder, pass.id, pipeline, &group, target);
            }
            PassId::Composite => {
                let Some(pipeline) = self.composites.get(target) else { return };
                let group = self.inputs(gpu, pipeline, &[Radiance, Depth]);
                fullscreen(encoder, pass.id, pipeline, &group, target);
            }
        }
    }

    /// Looks the shadow maps up for each pixel.
    fn sunlight(&self, gpu: &Gpu, encoder: &mut PassEncoder<'_>) {
        let pipeline = &self.pipelines.sunlight;
        let view = |resource| self.targets.view(resource);
        let (Some(depth), Some(normal), Some(into)) =
            (view(Resource::Depth), view(Resource::Normal), view(Resource::Sunlight))
        else {
            return;
        };
        let first = [
            wgpu::BindGroupEntry { binding: 0, resource: self.frame_buffer.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&depth) },
            wgpu::BindGroupEntry { binding: 5, resource: wgpu::BindingResource::TextureView(&normal) },
        ];
        let group = self.shadow_maps.bindings(|maps| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("sunlight"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &first.into_iter().chain(maps).collect::<Vec<_>>(),
            })
        });
        if let Some(group) = group {
            fullscreen(encoder, PassId::Sunlight, pipeline, &group, &Target::colour(&into, (0, 0)));
        }
    }

    /// A fullscreen pass from intermediate textures (bindings 1, 2, …) into another.
    fn full(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        id: PassId,
        (pipeline, reads): (&wgpu::RenderPipeline, &[Resource]),
        write: Resource,
    ) {
        if let Some(target) = self.targets.view(write) {
            let group = self.inputs(gpu, pipeline, reads);
            fullscreen(encoder, id, pipeline, &group, &Target::colour(&target, (0, 0)));
        }
    }

    /// Tells lamps by tiles, and adds their light to the picture; or shows how many there are in its place.
    fn lamps(&self, gpu: &Gpu, encoder: &mut PassEncoder<'_>, counted: bool) {
        let view = |resource| self.targets.view(resource);
        let (Some(depth), Some(normal), Some(albedo), Some(into)) =
            (view(Resource::Depth), view(Resource::Normal), view(Resource::Albedo), view(Resource::Radiance))
        else {
            return;
        };
        self.lamps.cull(gpu, &mut encoder.begin_compute(PassId::Lamps), &self.frame_buffer, &depth);
        let mut pass = encoder.begin(
            PassId::Lamps,
            &wgpu::RenderPassDescriptor {
                label: Some("lamps"),
                color_attachments: &[Some(attachment(&into, wgpu::LoadOp::Load))],
                depth_stencil_attachment: None,
                timestamp_writes: None,
                occlusion_query_set: None,
                multiview_mask: None,
            },
        );
        self.lamps.light(gpu, &mut pass, &self.frame_buffer, &[depth, normal, albedo], counted);
    }

    /// A fullscreen pass that looks the sky up, into radiance; only surfaces reflect it.
    fn lit(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        id: PassId,
        (pipeline, reads): (&wgpu::RenderPipeline, &[Resource]),
        surfaces: bool,
    ) {
        if let Some(target) = self.targets.view(Resource::Radiance) {
            let [seen, lobes, split_sum] = self.sky.views();
            let view = |binding, view| (binding, wgpu::BindingResource::TextureView(view));
            let sampler = (12, wgpu::BindingResource::Sampler(self.sky.sampler()));
            let more = [view(11, &lobes), view(13, &split_sum)].into_iter().filter(|_| surfaces);
            let entries: Vec<_> = [view(10, &seen), sampler].into_iter().chain(more).collect();
            let group = self.inputs_and(gpu, pipeline, reads, &entries);
            fullscreen(encoder, id, pipeline, &group, &Target::colour(&target, (0, 0)));
        }
    }

    /// A fullscreen pass from intermediate textures over what is in another.
    fn over(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        id: PassId,
        (pipeline, reads): (&wgpu::RenderPipeline, &[Resource]),
        write: Resource,
    ) {
        if let Some(target) = self.targets.view(write) {
            let group = self.inputs(gpu, pipeline, reads);
            let target = Target { load: Load::Keep, ..Target::colour(&target, (0, 0)) };
            fullscreen(encoder, id, pipeline, &group, &target);
        }
    }

    fn inputs(&self, gpu: &Gpu, pipeline: &wgpu::RenderPipeline, reads: &[Resource]) -> wgpu::BindGroup {
        self.inputs_and(gpu, pipeline, reads, &[])
    }

    fn inputs_and(
        &self,
        gpu: &Gpu,
        pipeline: &wgpu::RenderPipeline,
        reads: &[Resource],
        more: &[(u32, wgpu::BindingResource<'_>)],
    ) -> wgpu::BindGroup {
        let views: Vec<_> = reads.iter().filter_map(|r| self.targets.view(*r)).collect();
        let frame = wgpu::BindGroupEntry { binding: 0, resource: self.frame_buffer.as_entire_binding() };
        let textures = views.iter().zip(1..).map(|(view, binding)| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        });
        let more =
            more.iter().map(|(binding, of)| wgpu::BindGroupEntry { binding: *binding, resource: of.clone() });
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("pass inputs"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &std::iter::once(frame).chain(textures).chain(more).collect::<Vec<_>>(),
        })
    }

    /// The passes that draw triangles: surfaces; what they give off, what is seen through and edges over the lit
    /// picture; or how often each pixel is drawn.
    fn geometry(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        id: PassId,
        frame: &Frame<'_>,
        (list, ground): (&DrawList<'_>, Option<&TileList<'_>>),
        counters: &mut Counters,
    ) {
        let view = |r| self.targets.view(r);
        let Some(depth) = view(Resource::Depth) else { return };
        let colours: &[Resource] = match id {
            PassId::GBuffer => &[Resource::Normal, Resource::Albedo],
            PassId::Overdraw => &[Resource::Overdraw],
            PassId::Edges => &[Resource::Edges],
            _ => &[Resource::Radiance],
        };
        let views: Vec<_> = colours.iter().copied().filter_map(view).collect();
        let over = !matches!(id, PassId::GBuffer | PassId::Overdraw);
        let load = match id {
            PassId::Emission | PassId::Transparency => wgpu::LoadOp::Load,
            _ => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
        };
        let attachments: Vec<_> = views.iter().map(|view| Some(attachment(view, load))).collect();
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some(id.name()),
            color_attachments: &attachments,
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth,
                depth_ops: Some(wgpu::Operations {
                    // 0 is infinitely far.
                    load: if over { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(0.0) },
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        };
        let mut pass = encoder.begin(id, &descriptor);
        pass.set_bind_group(0, &self.frame_group, &[]);
        let (meshes, relief) = (&self.pipelines.meshes, frame.settings.relief);
        if let Some(instances) = self.instances.buffer() {
            match id {
                PassId::Emission => list.emission(gpu, &mut pass, meshes, instances, counters),
                PassId::Transparency => {
                    if let Some(light) = self.light(gpu) {
                        pass.set_bind_group(0, &light, &[]);
                        list.transparent(gpu, &mut pass, meshes, instances, counters);
                    }
                }
                PassId::Edges => {
                    if let Some(wire) = &meshes.wire {
                        list.wires(&mut pass, wire, instances, counters);
                    }
                }
                PassId::Overdraw => list.overdraw(gpu, &mut pass, (meshes, instances), false, counters),
                _ => list.surfaces(gpu, &mut pass, meshes, instances, relief, counters),
            }
        }
        // After the assets, which hide much of it.
        if let (Some(ground), Some(pipelines), Some(tiles)) =
            (ground, self.terrain.get(), self.tiles.buffer())
            && let Some(pipeline) = pipelines.of(id, relief)
        {
            ground.draw(&mut pass, pipeline, tiles, counters);
        }
        if let (PassId::Overdraw, Some(instances)) = (id, self.instances.buffer()) {
            list.overdraw(gpu, &mut pass, (meshes, instances), true, counters);
        }
    }

    /// What is lit where it is drawn reads of the frame, of the sun and of the sky.
    fn light(&self, gpu: &Gpu) -> Option<wgpu::BindGroup> {
        let frame = wgpu::BindGroupEntry { binding: 0, resource: self.frame_buffer.as_entire_binding() };
        let [seen, lobes, split_sum] = self.sky.views();
        let view = |binding, view| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        };
        let sampler = wgpu::BindingResource::Sampler(self.sky.sampler());
        let sky = [
            view(10, &seen),
            view(11, &lobes),
            wgpu::BindGroupEntry { binding: 12, resource: sampler },
            view(13, &split_sum),
        ];
        self.shadow_maps.bindings(|maps| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("light"),
                layout: &self.pipelines.meshes.light_layout,
                entries: &std::iter::once(frame).chain(maps).chain(sky).collect::<Vec<_>>(),
            })
        })
    }
}

/// The size in which a target's picture is drawn.
fn drawn_size(target: &Target<'_>, scale: f32) -> (u32, u32) {
    let enlarged = scale < 1.0;
    if target.depth.is_some() || target.load == Load::Keep || !enlarged {
        return target.size;
    }
    // At least a pixel, at most the target's.
    let side =
        |side: u32| ((side as f32 * scale.max(MIN_RENDER_SCALE)).round() as u32).clamp(1.min(side), side);
    (side(target.size.0), side(target.size.1))
}

fn attachment(
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

pub(crate) fn fullscreen(
    encoder: &mut PassEncoder<'_>,
    id: PassId,
    pipeline: &wgpu::RenderPipeline,
    group: &wgpu::BindGroup,
    target: &Target<'_>,
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
    pass.draw(0..3, 0..1);
}

/// A target's depth where no surface is drawn.
fn clear_depth(encoder: &mut wgpu::CommandEncoder, target: &Target<'_>) {
    if target.depth.is_some() {
        // The pass ends as it begins: clearing is all it does.
        drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("clear depth"),
            color_attachments: &[],
            depth_stencil_attachment: depth_attachment(target),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        }));
    }
}
