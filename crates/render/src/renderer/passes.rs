//! Recording of the planned passes: their inputs and draws.

use lodestream_scene::asset::Specular;

use super::Renderer;
use crate::frame::accumulation::AccumulationStep;
use crate::frame::batch::{Batch, Meshes};
use crate::frame::counters::Counters;
use crate::frame::draw::DrawList;
use crate::frame::draw_groups::DrawGroups;
use crate::frame::draw_passes::Relief;
use crate::frame::fullscreen::{attachment, blended, fullscreen};
use crate::frame::graph::{Pass, PassId, Resource};
use crate::frame::pipelines::{FullscreenPass, OcclusionOutput, OcclusionVariant};
use crate::frame::settings::{DebugView, Frame, Settings};
use crate::frame::target::{Load, Target};
use crate::frame::timing::PassEncoder;
use crate::passes::bloom::Bloom;
use crate::passes::debug;
use crate::resources::gpu::Gpu;
use crate::scene::terrain::TileList;

/// Binding of the specular reflection of dielectrics: `specular.wgsl`.
const SPECULAR: u32 = 14;
/// Binding of the sampler between texels: `enlarge.wgsl`.
const BETWEEN: u32 = 2;

impl Renderer {
    /// Records a planned pass.
    #[expect(clippy::too_many_arguments, reason = "one call site; a struct would only rename them")]
    pub(super) fn run(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pass: Pass,
        target: &Target<'_>,
        (frame, accumulated): (&Frame<'_>, AccumulationStep),
        (list, ground, [groups, moving]): (&DrawList<'_>, Option<&TileList<'_>>, [&DrawGroups<'_>; 2]),
        counters: &mut Counters,
    ) {
        use Resource::{
            Albedo, Depth, Display, Lit, Normal, Occlusion, OcclusionHalf, OcclusionMean, OcclusionRaw,
            Pyramid, Radiance, Sunlight,
        };
        let p = |pass| self.pipelines.fullscreen(gpu, pass);
        let full = |encoder: &mut PassEncoder<'_>, pipeline, reads: &[Resource], write| {
            self.full(gpu, encoder, pass.id, (pipeline, reads), (write, Load::Clear));
        };
        match pass.id {
            PassId::GBuffer
            | PassId::Specular
            | PassId::Overdraw
            | PassId::Emission
            | PassId::Transparency
            | PassId::Edges => self.geometry(gpu, encoder, pass.id, frame, (list, groups, ground), counters),
            PassId::Caps => {
                if let (Some(depth), Some(normal)) = (self.targets.view(Depth), self.targets.view(Normal)) {
                    self.pipelines.caps(gpu).record(gpu, encoder, &self.frame_buffer, &normal, &depth);
                }
            }
            PassId::Occlusion => self.occlusion(gpu, encoder, pass, accumulated),
            PassId::OcclusionBlur if pass.reads(OcclusionHalf) => {
                full(encoder, p(FullscreenPass::Upsample), &[Depth, OcclusionHalf], Occlusion);
            }
            PassId::OcclusionBlur => {
                let raw = if pass.reads(OcclusionMean) { OcclusionMean } else { OcclusionRaw };
                full(encoder, p(FullscreenPass::Blur), &[Depth, raw], Occlusion);
            }
            // Already recorded while the frame was planned.
            PassId::ShadowMaps => {}
            PassId::Sunlight => self.sunlight(gpu, encoder),
            PassId::Lighting => {
                let [occlusion, shadows, specular] =
                    [Occlusion, Sunlight, Resource::Specular].map(|resource| pass.reads(resource));
                // Absent inputs are not read, but their binding must be filled: any texture will do.
                let or = |there, resource| if there { resource } else { Albedo };
                let reads = [Depth, Normal, Albedo, or(occlusion, Occlusion), or(shadows, Sunlight)];
                let pipeline = p(FullscreenPass::Lighting { occlusion, shadows, specular });
                self.lit(gpu, encoder, pass.id, (pipeline, &reads), Some(specular));
            }
            PassId::PunctualLights => {
                let counted = frame.settings.debug_view == DebugView::PunctualLights;
                self.punctual_lights(gpu, encoder, counted, pass.reads(Resource::Specular));
            }
            PassId::DepthPyramid => {
                if let Some(depth) = self.targets.view(Depth) {
                    self.tracer.build(gpu, encoder, p(FullscreenPass::DepthPyramid), &depth);
                }
            }
            PassId::Reflections => {
                let [occlusion, by_cells, specular] =
                    [Occlusion, Pyramid, Resource::Specular].map(|resource| pass.reads(resource));
                let pipeline = p(FullscreenPass::Reflections { occlusion, by_cells, specular });
                self.reflections(gpu, encoder, pipeline, [occlusion, specular]);
            }
            PassId::Water => self.water(gpu, encoder, pass.reads(Lit).then_some(pass.reads(Pyramid))),
            PassId::Bloom => {
                let share = frame.settings.bloom.and_then(Bloom::share);
                if let (Some(picture), Some(share)) = (self.targets.view(Radiance), share) {
                    self.bloom.draw(gpu, encoder, self.pipelines.bloom(gpu), &picture, share);
                }
            }
            #[cfg(any(test, feature = "methods"))]
            PassId::Strokes => {
                if let (Some(depth), Some(into)) =
                    (self.targets.view(Depth), self.targets.view(Resource::Strokes))
                {
                    let of_frame = (&self.frame_group, &self.frame_buffer);
                    self.ink.draw(gpu, encoder, self.pipelines.ink(gpu), of_frame, &depth, &into);
                }
            }
            #[cfg(any(test, feature = "methods"))]
            PassId::Ink => self.ink(gpu, encoder),
            #[cfg(not(any(test, feature = "methods")))]
            PassId::Strokes | PassId::Ink => {}
            PassId::Wireframe => {
                let over = (Radiance, Load::Keep);
                self.full(gpu, encoder, pass.id, (p(FullscreenPass::Wireframe), &[Resource::Edges]), over);
            }
            PassId::Patches => {
                if let Some(settings) = frame.settings.curves(gpu) {
                    let pipelines = self.pipelines.patches(gpu, settings, false);
                    let ranges = list.batches.iter().map(Batch::range);
                    self.patches.record((gpu, pipelines), encoder, pass.id, &self.frame_group, ranges);
                }
            }
            PassId::Motion => self.motion(gpu, encoder, frame, moving, counters),
            PassId::Temporal => {
                let view = |resource| self.targets.view(resource);
                if let (Some(radiance), Some(depth)) = (view(Radiance), view(Depth)) {
                    let motion = view(Resource::Motion).filter(|_| !moving.is_empty());
                    let seen = (&radiance, &depth, motion.as_ref());
                    self.temporal.resolve(gpu, encoder, &self.frame_buffer, seen);
                }
            }
            PassId::Floor => {
                let views = [Depth, Radiance].map(|resource| self.targets.view(resource));
                if let (Some(floor), [Some(depth), Some(into)]) = (&self.floor, views) {
                    let pipelines = self.pipelines.floor(gpu);
                    floor.draw(gpu, (pipelines, encoder), &self.frame_buffer, (&depth, &into));
                }
            }
            PassId::Sky => self.lit(gpu, encoder, pass.id, (p(FullscreenPass::Sky), &[]), None),
            PassId::ToneMap if pass.writes(Display) => {
                full(encoder, p(FullscreenPass::ToneMapDisplay), &[Radiance], Display);
            }
            PassId::ToneMap if pass.writes(Resource::Smoothed) => {
                full(encoder, p(FullscreenPass::ToneMapDisplay), &[Radiance], Resource::Smoothed);
            }
            PassId::AntiAlias if pass.writes(Resource::Smoothed) => {
                full(encoder, p(FullscreenPass::AntiAliasSmall), &[Display], Resource::Smoothed);
            }
            PassId::Enlarge => {
                let pipeline = p(FullscreenPass::Enlarge);
                let between = (BETWEEN, wgpu::BindingResource::Sampler(self.pipelines.between()));
                let group = self.inputs_and(gpu, pipeline, &[Resource::Smoothed], &[between]);
                fullscreen(encoder, pass.id, pipeline, &group, &Target { depth: None, ..*target });
            }
            PassId::AntiAlias => {
                let pipeline = p(FullscreenPass::AntiAlias);
                let group = self.inputs(gpu, pipeline, &[Display]);
                fullscreen(encoder, pass.id, pipeline, &group, &Target { depth: None, ..*target });
            }
            PassId::ToneMap => {
                let temporal = pass.reads(Resource::History);
                let pipeline =
                    p(if temporal { FullscreenPass::ToneMapTemporal } else { FullscreenPass::ToneMap });
                let read = if temporal { Resource::History } else { Radiance };
                let group = self.inputs(gpu, pipeline, &[read]);
                fullscreen(encoder, pass.id, pipeline, &group, &Target { depth: None, ..*target });
            }
            PassId::Debug => {
                let settings = &frame.settings;
                // The plan has no pass for absent inputs.
                let ran = |pass| counters.passes.contains(&pass);
                let occlusion = pass.reads(Occlusion);
                let there =
                    [occlusion, ran(PassId::Sunlight), ran(PassId::PunctualLights), ran(PassId::Motion)];
                let Some((shown, reads)) = debug::shown(settings.debug_view, there) else { return };
                let Some(pipeline) = self.debug.get(shown, target) else { return };
                // Inputs that the view does not use are not read, but their bindings must be filled.
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

    fn meshes(&self, gpu: &Gpu, frame: &Frame<'_>) -> Option<Meshes<'_>> {
        let of_meshes = (&self.instances, &self.patches, &self.calls, &self.texture_tiles);
        super::meshes(gpu, frame, &self.pipelines, of_meshes)
    }

    /// Draws motion vectors of moving objects.
    fn motion(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        frame: &Frame<'_>,
        moving: &DrawGroups<'_>,
        counters: &mut Counters,
    ) {
        let view = |resource| self.targets.view(resource);
        let (Some(depth), Some(motion), Some(meshes), Some(before)) =
            (view(Resource::Depth), view(Resource::Motion), self.meshes(gpu, frame), self.temporal.before())
        else {
            return;
        };
        // Undrawn pixels do not move: the clear colour is `STANDS` of motion.wgsl.
        let stands = wgpu::Color { r: 6e4, ..wgpu::Color::TRANSPARENT };
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some(PassId::Motion.name()),
            color_attachments: &[Some(attachment(&motion, wgpu::LoadOp::Clear(stands)))],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        };
        let mut pass = encoder.begin(PassId::Motion, &descriptor);
        pass.set_bind_group(0, &self.frame_group, &[]);
        moving.motion(gpu, &mut pass, meshes, before, counters);
    }

    /// Estimates occlusion, for one frame or into the accumulated mean.
    fn occlusion(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pass: Pass,
        AccumulationStep { method, normals, number, .. }: AccumulationStep,
    ) {
        use Resource::{Depth, Normal, OcclusionHalf, OcclusionMean, OcclusionRaw};
        let (estimated, written) = if pass.writes(OcclusionMean) {
            (OcclusionOutput::Mean, OcclusionMean)
        } else if pass.writes(OcclusionHalf) {
            (OcclusionOutput::Half, OcclusionHalf)
        } else {
            (OcclusionOutput::Frame, OcclusionRaw)
        };
        let mean = estimated == OcclusionOutput::Mean;
        // If the G-buffer's normals are not read, their binding must be filled all the same.
        let reads = [Depth, if pass.reads(Normal) { Normal } else { Depth }];
        let view = |resource| self.targets.view(resource);
        let (Some(normal), Some(into)) = (view(reads[1]), view(written)) else {
            return;
        };
        // The first frame of a mean replaces the content.
        let share = mean.then(|| 1.0 / f64::from(number));
        #[cfg(any(test, feature = "methods"))]
        if let (true, Some(depth)) = (method.is_layered(), view(Depth)) {
            let from = (&self.frame_buffer, &depth, &normal);
            self.layers.draw(gpu, encoder, self.pipelines.layers(gpu, normals), from, (&into, share));
            return;
        }
        let estimate = FullscreenPass::Occlusion(OcclusionVariant { method, normals, into: estimated });
        let pipeline = self.pipelines.fullscreen(gpu, estimate);
        let group =
            self.inputs_and(gpu, pipeline, &[Depth], &[(3, wgpu::BindingResource::TextureView(&normal))]);
        let load = if mean { Load::Keep } else { Load::Clear };
        let target = Target { load, ..Target::colour(&into, (0, 0)) };
        blended(encoder, pass.id, pipeline, &group, &target, share.unwrap_or(1.0));
    }

    /// Shadow lookup for each pixel.
    fn sunlight(&self, gpu: &Gpu, encoder: &mut PassEncoder<'_>) {
        let pipeline = self.pipelines.fullscreen(gpu, FullscreenPass::Sunlight);
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

    /// A fullscreen pass from intermediate textures (bindings 1, 2, …) into another, or blended over it.
    fn full(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        id: PassId,
        (pipeline, reads): (&wgpu::RenderPipeline, &[Resource]),
        (write, load): (Resource, Load),
    ) {
        if let Some(target) = self.targets.view(write) {
            let group = self.inputs(gpu, pipeline, reads);
            fullscreen(encoder, id, pipeline, &group, &Target { load, ..Target::colour(&target, (0, 0)) });
        }
    }

    /// Culls punctual lights and adds their light to the picture, or shows their number in its place.
    fn punctual_lights(&self, gpu: &Gpu, encoder: &mut PassEncoder<'_>, counted: bool, specular: bool) {
        let view = |resource| self.targets.view(resource);
        let (Some(depth), Some(normal), Some(albedo), Some(into)) =
            (view(Resource::Depth), view(Resource::Normal), view(Resource::Albedo), view(Resource::Radiance))
        else {
            return;
        };
        self.punctual_lights.cull(
            gpu,
            &mut encoder.begin_compute(PassId::PunctualLights),
            &self.frame_buffer,
            &depth,
        );
        let mut pass = encoder.begin(
            PassId::PunctualLights,
            &wgpu::RenderPassDescriptor {
                label: Some("punctual_lights"),
                color_attachments: &[Some(attachment(&into, wgpu::LoadOp::Load))],
                depth_stencil_attachment: None,
                timestamp_writes: None,
                occlusion_query_set: None,
                multiview_mask: None,
            },
        );
        let specular = specular.then(|| view(Resource::Specular)).flatten();
        let surfaces = (&[depth, normal, albedo], specular.as_ref());
        self.punctual_lights.light(gpu, &mut pass, &self.frame_buffer, surfaces, counted);
    }

    /// Copies the lit picture, and adds reflections of the copy.
    fn reflections(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pipeline: &wgpu::RenderPipeline,
        [occlusion, specular]: [bool; 2],
    ) {
        let texture = |resource| self.targets.texture(resource);
        let (Some(from), Some(to), Some(into)) =
            (texture(Resource::Radiance), texture(Resource::Lit), self.targets.view(Resource::Radiance))
        else {
            return;
        };
        encoder.encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), from.size());
        use Resource::{Albedo, Depth, Lit, Normal, Occlusion};
        // Absent inputs are not read, but their binding must be filled: any texture will do.
        let reads = [Depth, Normal, Albedo, if occlusion { Occlusion } else { Albedo }, Lit];
        let Some(cells) = self.tracer.pyramid().or_else(|| self.targets.view(Depth)) else { return };
        let [_, lobes, split_sum] = self.sky.views();
        let view = |binding, view| (binding, wgpu::BindingResource::TextureView(view));
        let more = [
            view(6, &cells),
            (7, self.tracer.binding()),
            view(11, &lobes),
            (12, wgpu::BindingResource::Sampler(self.sky.sampler())),
            view(13, &split_sum),
        ];
        let specular = specular.then(|| self.targets.view(Resource::Specular)).flatten();
        let specular = specular.as_ref().map(|specular| view(SPECULAR, specular));
        let more: Vec<_> = more.into_iter().chain(specular).collect();
        let group = self.inputs_and(gpu, pipeline, &reads, &more);
        let over = Target { load: Load::Keep, ..Target::colour(&into, (0, 0)) };
        fullscreen(encoder, PassId::Reflections, pipeline, &group, &over);
    }

    #[cfg(any(test, feature = "methods"))]
    /// Copies the lit picture, and redraws it with quantised light and strokes.
    fn ink(&self, gpu: &Gpu, encoder: &mut PassEncoder<'_>) {
        use Resource::{Albedo, Depth, Lit, Radiance, Strokes};
        let texture = |resource| self.targets.texture(resource);
        let (Some(from), Some(to), Some(into), Some(uniform)) =
            (texture(Radiance), texture(Lit), self.targets.view(Radiance), self.ink.uniform())
        else {
            return;
        };
        encoder.encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), from.size());
        let pipeline = &self.pipelines.ink(gpu).mixed;
        let more = [(5, uniform.as_entire_binding())];
        let group = self.inputs_and(gpu, pipeline, &[Lit, Depth, Albedo, Strokes], &more);
        fullscreen(encoder, PassId::Ink, pipeline, &group, &Target::colour(&into, (0, 0)));
    }

    /// Draws water over the lit picture; `by_cells` selects the search of screen-space reflections, if there are any.
    fn water(&self, gpu: &Gpu, encoder: &mut PassEncoder<'_>, by_cells: Option<bool>) {
        let view = |resource| self.targets.view(resource);
        if let (Some(depth), Some(into), Some(light)) =
            (view(Resource::Depth), view(Resource::Radiance), self.light(gpu, false))
        {
            let lit = by_cells.and_then(|_| view(Resource::Lit));
            let cells = by_cells.filter(|&cells| cells).and_then(|_| self.tracer.pyramid());
            let mirrored = lit.as_ref().map(|lit| (lit, cells.as_ref().unwrap_or(&depth), &self.tracer));
            let pipelines = self.pipelines.water(gpu, by_cells);
            self.water.draw(gpu, encoder, pipelines, &light, (&depth, mirrored), &into);
        }
    }

    /// A fullscreen pass into radiance that samples the sky; only surfaces sample the reflection maps, and the specular
    /// reflection of dielectrics if it is `true`.
    fn lit(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        id: PassId,
        (pipeline, reads): (&wgpu::RenderPipeline, &[Resource]),
        surfaces: Option<bool>,
    ) {
        if let Some(target) = self.targets.view(Resource::Radiance) {
            let specular = surfaces.filter(|specular| *specular);
            let specular_map = specular.and_then(|_| self.targets.view(Resource::Specular));
            let [seen, lobes, split_sum] = self.sky.views();
            let view = |binding, view| (binding, wgpu::BindingResource::TextureView(view));
            let sampler = (12, wgpu::BindingResource::Sampler(self.sky.sampler()));
            let more = [view(11, &lobes), view(13, &split_sum)].into_iter().filter(|_| surfaces.is_some());
            let specular = specular_map.as_ref().map(|specular| view(SPECULAR, specular));
            let entries: Vec<_> =
                [view(10, &seen), sampler].into_iter().chain(more).chain(specular).collect();
            let group = self.inputs_and(gpu, pipeline, reads, &entries);
            fullscreen(encoder, id, pipeline, &group, &Target::colour(&target, (0, 0)));
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
        let views: Vec<_> = reads
            .iter()
            .filter_map(|r| self.intermediate(*r))
            .map(|texture| texture.create_view(&Default::default()))
            .collect();
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

    /// The passes that draw triangles: surfaces; emission, transparency and edges over the lit picture; overdraw.
    fn geometry(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        id: PassId,
        frame: &Frame<'_>,
        (list, groups, ground): (&DrawList<'_>, &DrawGroups<'_>, Option<&TileList<'_>>),
        counters: &mut Counters,
    ) {
        let view = |r| self.targets.view(r);
        let Some(depth) = view(Resource::Depth) else { return };
        let colours: &[Resource] = match id {
            PassId::GBuffer => &[Resource::Normal, Resource::Albedo],
            PassId::Specular => &[Resource::Specular],
            PassId::Overdraw => &[Resource::Overdraw],
            PassId::Edges => &[Resource::Edges],
            _ => &[Resource::Radiance],
        };
        let views: Vec<_> = colours.iter().copied().filter_map(view).collect();
        let over = !matches!(id, PassId::GBuffer | PassId::Overdraw);
        let load = match id {
            PassId::Emission | PassId::Transparency => wgpu::LoadOp::Load,
            PassId::Specular => {
                let [usual, no_coat] = [u32::from_le_bytes(Specular::default().bytes()), 0xffff_f000];
                let [r, g] = [usual, no_coat].map(f64::from);
                wgpu::LoadOp::Clear(wgpu::Color { r, g, ..wgpu::Color::TRANSPARENT })
            }
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
        let (meshes, relief) = (self.meshes(gpu, frame), frame.settings.relief);
        if let Some(meshes) = meshes {
            match id {
                PassId::Emission => groups.emission(gpu, &mut pass, meshes, counters),
                PassId::Specular => groups.specular(gpu, &mut pass, meshes, counters),
                PassId::Transparency => {
                    let punctual_lights = counters.passes.contains(&PassId::PunctualLights);
                    if let Some(light) = self.light(gpu, punctual_lights) {
                        pass.set_bind_group(0, &light, &[]);
                        list.transparent(gpu, &mut pass, meshes, punctual_lights, counters);
                    }
                }
                PassId::Edges => groups.wires(gpu, &mut pass, meshes, counters),
                PassId::Overdraw => groups.overdraw(gpu, &mut pass, meshes, false, counters),
                _ => {
                    let Settings { relief_method: method, relief_in_depth: in_depth, .. } = frame.settings;
                    let way = relief.then_some(Relief { method, in_depth });
                    groups.surfaces(gpu, &mut pass, meshes, way, counters);
                }
            }
        }
        // After the assets, which occlude much of it.
        if let (Some(ground), Some(tiles)) = (ground, self.tiles.buffer())
            && let Some(pipeline) = self.pipelines.terrain(gpu).of(gpu, id, relief)
        {
            ground.draw(&mut pass, pipeline, tiles, counters);
        }
        if let (PassId::Overdraw, Some(meshes)) = (id, meshes)
            && frame.settings.transparency
        {
            groups.overdraw(gpu, &mut pass, meshes, true, counters);
        }
    }

    /// Group 0 of forward-lit surfaces: frame, sun, sky and, if there are some, punctual lights.
    fn light(&self, gpu: &Gpu, punctual_lights: bool) -> Option<wgpu::BindGroup> {
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
        let lit_by = if punctual_lights { Some(self.punctual_lights.bindings()?) } else { None };
        self.shadow_maps.bindings(|maps| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("light"),
                layout: self.pipelines.meshes.light_layout(gpu, punctual_lights),
                entries: &std::iter::once(frame)
                    .chain(maps)
                    .chain(sky)
                    .chain(lit_by.into_iter().flatten())
                    .collect::<Vec<_>>(),
            })
        })
    }
}
