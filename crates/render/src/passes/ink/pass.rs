//! The ink pass: extracts the strokes of a frame, draws them into a texture and blends it over the lit picture.

use std::collections::BTreeMap;

use super::adjacency::{Adjacency, EdgeExtraction, JOB_BYTES, Jobs, MOST_INVOCATIONS, Tables, bound, groups};
use super::pipelines::InkPipelines;
use super::settings::{Ink, InkUniform};
use crate::frame::batch::Batch;
use crate::frame::fullscreen::attachment;
use crate::frame::graph::PassId;
use crate::frame::settings::Frame;
use crate::frame::timing::PassEncoder;
use crate::resources::buffer::room;
use crate::resources::gpu::{Gpu, RenderError};

/// Most strokes of a frame; further ones are omitted.
const MOST_STROKES: u64 = 1 << 18;
const STROKE_BYTES: u64 = 32;
/// Most triangle sides examined per frame, instances included; farther meshes have no strokes.
const MOST_SIDES: u64 = 1 << 25;
/// `Drawn` of `ink_list.wgsl`: six vertices a stroke, no stroke yet.
const DRAWN: [u32; 4] = [6, 0, 0, 0];

/// Edges to be tested against the frame's camera.
#[derive(Debug)]
struct StrokeListing {
    group: wgpu::BindGroup,
    invocations: u64,
}

/// State kept between frames, and the strokes of the current one.
#[derive(Debug, Default)]
pub(crate) struct InkPass {
    /// By asset number.
    meshes: BTreeMap<u64, Adjacency>,
    tables: Tables,
    jobs: Option<wgpu::Buffer>,
    strokes: Option<wgpu::Buffer>,
    drawn: Option<wgpu::Buffer>,
    uniform: Option<wgpu::Buffer>,
    finding: Vec<EdgeExtraction>,
    listing: Vec<StrokeListing>,
    /// Number of meshes whose edges were extracted.
    #[cfg(test)]
    pub(crate) found: u32,
}

/// Geometry that strokes are extracted from.
pub(crate) struct StrokeInputs<'a> {
    pub(crate) frame: &'a Frame<'a>,
    /// Nearest first.
    pub(crate) batches: &'a [Batch<'a>],
    pub(crate) instances: Option<&'a wgpu::Buffer>,
}

impl InkPass {
    /// Discards all state.
    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }

    /// Plans a frame's strokes; extracts edges of changed meshes again.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] where the device cannot hold them.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        pipelines: &InkPipelines,
        ink: &Ink,
        seen: &StrokeInputs<'_>,
    ) -> Result<(), RenderError> {
        let uniform_usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let bytes = size_of::<InkUniform>() as u64;
        let uniform = room(gpu, &mut self.uniform, "ink", bytes, uniform_usage)?;
        gpu.queue.write_buffer(uniform, 0, bytemuck::bytes_of(&ink.uniform(seen.frame.camera.eye)));
        self.finding.clear();
        self.listing.clear();
        let held = |number: u64| seen.frame.drawables.iter().any(|d| d.asset.number() == number);
        self.meshes.retain(|number, _| held(*number));
        let (Some(instances), true) = (seen.instances, ink.has_strokes()) else { return Ok(()) };

        let storage = wgpu::BufferUsages::STORAGE;
        let most = MOST_STROKES * STROKE_BYTES;
        let strokes = room(gpu, &mut self.strokes, "strokes", most, storage)?;
        let usage = storage | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST;
        let drawn = room(gpu, &mut self.drawn, "strokes", size_of_val(&DRAWN) as u64, usage)?;
        gpu.queue.write_buffer(drawn, 0, bytemuck::cast_slice(&DRAWN));

        let runs: usize = seen.batches.iter().map(|batch| 1 + EdgeExtraction::jobs(batch.asset())).sum();
        let bytes = JOB_BYTES * runs.max(1) as u64;
        let mut jobs = Jobs {
            buffer: room(gpu, &mut self.jobs, "ink", bytes, uniform_usage)?,
            bytes: Vec::with_capacity(bytes as usize),
        };
        let (mut left, crease) = (MOST_SIDES, ink.crease_cosine().to_bits());
        for batch in seen.batches {
            let asset = batch.asset();
            let mesh = self.meshes.entry(asset.number()).or_insert(Adjacency::NONE);
            if !mesh.is_of(asset) {
                self.finding.extend(self.tables.plan(gpu, pipelines, asset, mesh, &mut jobs)?);
                #[cfg(test)]
                {
                    self.found += 1;
                }
            }
            let (Some((vertices, _)), Some([corners, rings])) = (asset.draws(), mesh.buffers()) else {
                continue;
            };
            let range = batch.range();
            let room = left.min(MOST_INVOCATIONS) / mesh.sides.max(1);
            let count = (range.len() as u64).min(room);
            let invocations = count * mesh.sides;
            if invocations == 0 {
                continue;
            }
            left -= invocations;
            let words = [mesh.sides as u32, range.start, count as u32, MOST_STROKES as u32, crease];
            let Some(job) = jobs.add(&words) else { continue };
            let whole = [corners, rings, instances, drawn, strokes];
            let whole = whole.map(|buffer| buffer.as_entire_buffer_binding());
            let buffers = [vertices.binding()].into_iter().chain(whole);
            let group = bound(gpu, &pipelines.list_layout, job, buffers);
            self.listing.push(StrokeListing { group, invocations });
        }
        gpu.queue.write_buffer(jobs.buffer, 0, &jobs.bytes);
        Ok(())
    }

    /// Extracts the strokes and draws those that `depth` does not hide.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        pipelines: &InkPipelines,
        (frame, frame_buffer): (&wgpu::BindGroup, &wgpu::Buffer),
        depth: &wgpu::TextureView,
        into: &wgpu::TextureView,
    ) {
        if let Some(last) = self.listing.last() {
            let mut pass = encoder.begin_compute(PassId::Strokes);
            self.finding.iter().for_each(|finding| finding.record(&mut pass, pipelines));
            pass.set_bind_group(0, frame, &[]);
            pass.set_pipeline(&pipelines.list);
            for StrokeListing { group, invocations } in &self.listing {
                pass.set_bind_group(1, group, &[]);
                pass.dispatch_workgroups(groups(*invocations), 1, 1);
            }
            pass.set_pipeline(&pipelines.bound);
            pass.set_bind_group(1, &last.group, &[]);
            pass.dispatch_workgroups(1, 1, 1);
        }
        let attachments = [Some(attachment(into, wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT)))];
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some(PassId::Strokes.name()),
            color_attachments: &attachments,
            ..Default::default()
        };
        let mut pass = encoder.begin(PassId::Strokes, &descriptor);
        let (Some(strokes), Some(drawn), Some(uniform), false) =
            (&self.strokes, &self.drawn, &self.uniform, self.listing.is_empty())
        else {
            return;
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("strokes"),
            layout: &pipelines.strokes.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: frame_buffer.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(depth) },
                wgpu::BindGroupEntry { binding: 2, resource: strokes.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 3, resource: uniform.as_entire_binding() },
            ],
        });
        pass.set_pipeline(&pipelines.strokes);
        pass.set_bind_group(0, &group, &[]);
        pass.draw_indirect(drawn, 0);
    }

    /// Uniform buffer of the composition.
    pub(crate) fn uniform(&self) -> Option<&wgpu::Buffer> {
        self.uniform.as_ref()
    }
}
