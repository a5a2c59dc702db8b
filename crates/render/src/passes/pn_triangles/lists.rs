//! Patch lists: triangles sorted by tessellation level, built on the device, which alone has the vertices.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::OnceLock;

use super::grid::{Grids, STEPS};
use super::pipelines::PatchPipelines;
use super::settings::PnTriangles;
use crate::frame::graph::PassId;
use crate::frame::timing::PassEncoder;
use crate::resources::buffer::room;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::pages::PageRange;

/// Name of the buffers in errors.
const LISTS: &str = "patch lists";
/// Invocations of a workgroup.
const GROUP: u64 = 64;
/// Most triangles listed per frame and its shadow maps, instances included; further ones are drawn flat.
const MAX_LISTED: u64 = 1 << 21;
/// Bytes per triangle of a list and of its levels, and per workgroup of its counts.
const LISTED_BYTES: u64 = 12;
const STEPS_BYTES: u64 = 4;
const COUNTS_BYTES: u64 = 4 * STEPS as u64;
/// `Job` of pn_list.wgsl, in words; any device can bind a buffer at a multiple of its bytes.
const JOB_WORDS: usize = 64;
const JOB_BYTES: u64 = 4 * JOB_WORDS as u64;
/// Offset in words of the host's part, after draws and starts.
const JOB_HEAD: usize = 42;

/// A list: the faces of one material in some instances.
#[derive(Debug)]
struct Job {
    groups: u32,
    /// Byte offset of its draws in the buffer of jobs.
    at: u64,
    make: wgpu::BindGroup,
    draw: wgpu::BindGroup,
}

/// Key of a list: its first instance in the frame, and the index of its part among those with faces.
type Key = (u32, usize);

/// Buffers for all lists of a frame.
#[derive(Debug, Default)]
struct Memory {
    jobs: Option<wgpu::Buffer>,
    listed: Option<wgpu::Buffer>,
    steps: Option<wgpu::Buffer>,
    counts: Option<wgpu::Buffer>,
}

/// Patch lists of a frame.
#[derive(Debug, Default)]
pub(crate) struct PatchLists {
    grids: OnceLock<Grids>,
    memory: Memory,
    jobs: BTreeMap<Key, Job>,
}

/// Inputs shared by all lists: settings, and the instances of this and the previous frame.
#[derive(Clone, Copy)]
pub(crate) struct PatchInputs<'a> {
    pub(crate) settings: PnTriangles,
    pub(crate) instances: &'a wgpu::Buffer,
    pub(crate) before: Option<&'a wgpu::Buffer>,
}

/// Faces of a part that may be drawn as patches.
pub(crate) struct PatchListItem<'a> {
    /// Vertices of the mesh.
    pub(crate) vertices: &'a PageRange,
    pub(crate) indices: &'a PageRange,
    /// Index among its asset's parts with faces, and number of faces.
    pub(crate) part: usize,
    pub(crate) faces: u32,
    /// Range in the frame's instances.
    pub(crate) instances: Range<u32>,
    /// Each instance has its own list and draw.
    pub(crate) alone: bool,
    /// Triangles outside the view are left out.
    pub(crate) in_view: bool,
}

/// A planned list: its input and its offsets in the buffers.
struct Plan<'a> {
    key: Key,
    vertices: &'a PageRange,
    indices: &'a PageRange,
    faces: u32,
    instances: u32,
    in_view: bool,
    groups: u32,
    listed: u64,
    steps: u64,
    counts: u64,
}

impl PatchLists {
    /// Discards all lists: everything is drawn flat.
    pub(crate) fn clear(&mut self) {
        self.jobs.clear();
    }

    /// Plans lists in order of priority; [`PatchLists::record`] builds them.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] where the device cannot hold them.
    pub(crate) fn plan<'a>(
        &mut self,
        gpu: &Gpu,
        pipelines: &PatchPipelines,
        inputs: PatchInputs<'_>,
        parts: impl Iterator<Item = PatchListItem<'a>>,
    ) -> Result<(), RenderError> {
        self.jobs.clear();
        self.grids.get_or_init(|| Grids::new(gpu));
        let makers = pipelines.makers(gpu);
        let most_bytes = gpu.device.limits().max_storage_buffer_binding_size;
        let plans = plans(parts, most_bytes);
        let Some(last) = plans.last() else { return Ok(()) };
        let ends = [
            plans.len() as u64 * JOB_BYTES,
            last.listed + bytes_of(last, LISTED_BYTES),
            last.steps + bytes_of(last, STEPS_BYTES),
            last.counts + aligned(u64::from(last.groups) * COUNTS_BYTES),
        ];
        let storage = wgpu::BufferUsages::STORAGE;
        let Memory { jobs, listed, steps, counts } = &mut self.memory;
        let drawn = storage | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST;
        let jobs = room(gpu, jobs, LISTS, ends[0], drawn)?;
        let listed = room(gpu, listed, LISTS, ends[1], storage)?;
        let steps = room(gpu, steps, LISTS, ends[2], storage)?;
        let counts = room(gpu, counts, LISTS, ends[3], storage)?;
        let mut heads = vec![0_u32; plans.len() * JOB_WORDS];
        for ((number, plan), head) in (0..).zip(&plans).zip(heads.chunks_exact_mut(JOB_WORDS)) {
            let PatchInputs { settings, .. } = inputs;
            let (most, error) = (settings.most_step(), settings.error().to_bits());
            let in_view = u32::from(plan.in_view);
            let host = [plan.faces, plan.key.0, plan.instances, plan.groups, most, error, in_view];
            head[JOB_HEAD..JOB_HEAD + host.len()].copy_from_slice(&host);
            let at = number * JOB_BYTES;
            let instances = inputs.instances.as_entire_buffer_binding();
            let of_mesh = [plan.vertices.binding(), plan.indices.binding(), instances];
            let of_mesh = of_mesh.map(wgpu::BindingResource::Buffer);
            let of_mesh = (1..).zip(of_mesh);
            let of_mesh: Vec<_> = of_mesh.collect();
            let job = (0, part(jobs, at, JOB_BYTES));
            let list = (4, part(listed, plan.listed, bytes_of(plan, LISTED_BYTES)));
            let own = [
                job.clone(),
                list.clone(),
                (5, part(steps, plan.steps, bytes_of(plan, STEPS_BYTES))),
                (6, part(counts, plan.counts, aligned(u64::from(plan.groups) * COUNTS_BYTES))),
            ];
            let before = (5, inputs.before.unwrap_or(inputs.instances).as_entire_binding());
            let make = group(gpu, &makers.layout, of_mesh.iter().chain(&own));
            let draw = group(gpu, &pipelines.list_layout, of_mesh.iter().chain(&[job, list, before]));
            self.jobs.insert(plan.key, Job { groups: plan.groups, at, make, draw });
        }
        gpu.queue.write_buffer(jobs, 0, bytemuck::cast_slice(&heads));
        Ok(())
    }

    /// Records the building of the lists of some ranges of instances, as part of a pass.
    pub(crate) fn record(
        &self,
        (gpu, pipelines): (&Gpu, &PatchPipelines),
        encoder: &mut PassEncoder<'_>,
        pass: PassId,
        frame: &wgpu::BindGroup,
        ranges: impl Iterator<Item = Range<u32>>,
    ) {
        let jobs: Vec<&Job> =
            ranges.flat_map(|of| self.jobs.range((of.start, 0)..(of.end, 0))).map(|(_, job)| job).collect();
        if jobs.is_empty() {
            return;
        }
        let makers = pipelines.makers(gpu);
        let mut pass = encoder.begin_compute(pass);
        pass.set_bind_group(0, frame, &[]);
        // Stage by stage over all lists, so that there are three barriers rather than three per list.
        for (pipeline, alone) in [(&makers.measure, false), (&makers.arrange, true), (&makers.list, false)] {
            pass.set_pipeline(pipeline);
            for job in &jobs {
                pass.set_bind_group(3, &job.make, &[]);
                pass.dispatch_workgroups(if alone { 1 } else { job.groups }, 1, 1);
            }
        }
    }

    /// Whether a part has a list that starts at an instance.
    pub(crate) fn has(&self, first: u32, part: usize) -> bool {
        self.jobs.contains_key(&(first, part))
    }

    /// Draws a list.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, first: u32, part: usize) {
        let (Some(job), Some(jobs), Some(grids)) =
            (self.jobs.get(&(first, part)), &self.memory.jobs, self.grids.get())
        else {
            return;
        };
        pass.set_bind_group(3, &job.draw, &[]);
        pass.set_vertex_buffer(0, grids.vertices.slice(..));
        pass.set_index_buffer(grids.indices.slice(..), wgpu::IndexFormat::Uint16);
        for step in 0..u64::from(STEPS) {
            pass.draw_indexed_indirect(jobs, job.at + step * 20);
        }
    }
}

/// Plans the lists within the frame's limits. Meshes larger than a storage binding have none.
fn plans<'a>(parts: impl Iterator<Item = PatchListItem<'a>>, most_bytes: u64) -> Vec<Plan<'a>> {
    let (mut plans, mut all): (Vec<Plan<'_>>, u64) = (Vec::new(), 0);
    let [mut listed, mut steps, mut counts] = [0; 3];
    for PatchListItem { vertices, indices, part, faces, instances, alone, in_view } in parts {
        let triangles = u64::from(faces) * instances.len() as u64;
        if all + triangles > MAX_LISTED || vertices.bytes().max(indices.bytes()) > most_bytes {
            continue;
        }
        all += triangles;
        let each = if alone { 1 } else { instances.len() };
        for first in instances.step_by(each.max(1)) {
            let count = each as u32;
            let groups = (u64::from(faces) * u64::from(count)).div_ceil(GROUP) as u32;
            let key = (first, part);
            let plan = Plan {
                key,
                vertices,
                indices,
                faces,
                instances: count,
                in_view,
                groups,
                listed,
                steps,
                counts,
            };
            listed += bytes_of(&plan, LISTED_BYTES);
            steps += bytes_of(&plan, STEPS_BYTES);
            counts += aligned(u64::from(groups) * COUNTS_BYTES);
            plans.push(plan);
        }
    }
    plans
}

/// Bytes of a list with `each` bytes per triangle.
fn bytes_of(plan: &Plan<'_>, each: u64) -> u64 {
    aligned(u64::from(plan.faces) * u64::from(plan.instances) * each)
}

/// Rounds up, so that the next range can be bound by itself.
fn aligned(bytes: u64) -> u64 {
    bytes.next_multiple_of(JOB_BYTES)
}

/// A part of a buffer.
fn part(buffer: &wgpu::Buffer, offset: u64, size: u64) -> wgpu::BindingResource<'_> {
    let size = wgpu::BufferSize::new(size);
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size })
}

fn group<'a>(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    bindings: impl Iterator<Item = &'a (u32, wgpu::BindingResource<'a>)>,
) -> wgpu::BindGroup {
    let entries: Vec<_> = bindings
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("list of patches"),
        layout,
        entries: &entries,
    })
}
