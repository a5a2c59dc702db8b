//! Edge adjacency of a mesh's triangles, computed on the device, which alone has the vertices.

use super::pipelines::InkPipelines;
use crate::resources::buffer::room;
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::pages::PageRange;
use crate::scene::asset::AssetGpu;

/// Invocations of a workgroup, and of a whole dispatch.
const GROUP: u64 = 256;
pub(super) const MOST_INVOCATIONS: u64 = 65_535 * GROUP;
/// Bytes of a job; any device can bind a buffer at a multiple of this offset.
pub(super) const JOB_BYTES: u64 = 256;

/// Number of workgroups for at most [`MOST_INVOCATIONS`] invocations.
pub(super) fn groups(invocations: u64) -> u32 {
    invocations.min(MOST_INVOCATIONS).div_ceil(GROUP) as u32
}

/// Edges of a mesh in GPU memory: 24 bytes a face slot, rounded up.
#[derive(Debug)]
pub(super) struct Adjacency {
    /// Stamp of the geometry.
    stamp: u64,
    /// Three sides per face slot.
    pub(super) sides: u64,
    corners: Option<wgpu::Buffer>,
    rings: Option<wgpu::Buffer>,
}

impl Adjacency {
    pub(super) const NONE: Self = Self { stamp: u64::MAX, sides: 0, corners: None, rings: None };

    /// Whether it is up to date.
    pub(super) fn is_of(&self, asset: &AssetGpu) -> bool {
        self.stamp == asset.stamp()
    }

    /// For each side its start vertex, and the next side of the same edge.
    pub(super) fn buffers(&self) -> Option<[&wgpu::Buffer; 2]> {
        Some([self.corners.as_ref()?, self.rings.as_ref()?])
    }
}

/// Scratch hash tables, reused for each mesh.
#[derive(Debug, Default)]
pub(super) struct Tables {
    owners: Option<wgpu::Buffer>,
    heads: Option<wgpu::Buffer>,
}

/// A planned extraction of one mesh's edges.
#[derive(Debug)]
pub(super) struct EdgeExtraction {
    /// Bind group and number of sides of each part.
    parts: Vec<(wgpu::BindGroup, u64)>,
    vertices: u64,
    sides: u64,
    cells: u64,
}

/// Size of the extraction for a mesh.
struct Extent {
    vertices: u64,
    sides: u64,
    /// Cells of the tables.
    cells: u64,
}

impl Extent {
    fn of(asset: &AssetGpu) -> Self {
        let (vertices, sides) = (asset.slots(), faces(asset).map(|(_, faces)| 3 * u64::from(faces)).sum());
        // If every side is an edge of its own, three of four cells are occupied.
        let cells = (vertices * 2).max(sides * 4 / 3).max(GROUP).next_power_of_two();
        Self { vertices, sides, cells }
    }

    /// Whether the device's limits suffice.
    fn fits(&self, gpu: &Gpu, vertices: &PageRange) -> bool {
        let most = gpu.device.limits().max_storage_buffer_binding_size;
        let most_invocations = self.vertices.max(self.sides);
        most_invocations <= MOST_INVOCATIONS && 4 * self.cells <= most && vertices.bytes() <= most
    }
}

/// Faces with strokes. Alpha-tested materials have contours that their mesh does not describe.
fn faces(asset: &AssetGpu) -> impl Iterator<Item = (&PageRange, u32)> {
    let parts = asset.draws().into_iter().flat_map(|(_, parts)| parts);
    parts.filter(|part| !part.material.features.mask).map(|part| (part.indices, part.faces))
}

impl Tables {
    /// Plans the extraction of a mesh's edges; `jobs` must be written before it runs. `None` if the device cannot hold
    /// them or there are none.
    pub(super) fn plan(
        &mut self,
        gpu: &Gpu,
        pipelines: &InkPipelines,
        asset: &AssetGpu,
        into: &mut Adjacency,
        jobs: &mut Jobs<'_>,
    ) -> Result<Option<EdgeExtraction>, RenderError> {
        *into = Adjacency { stamp: asset.stamp(), sides: 0, ..std::mem::replace(into, Adjacency::NONE) };
        let Some((vertices, _)) = asset.draws() else { return Ok(None) };
        let extent = Extent::of(asset);
        if extent.sides == 0 {
            return Ok(None);
        }
        if !extent.fits(gpu, vertices) {
            tracing::warn!("a mesh of {} faces is too large for strokes", extent.sides / 3);
            return Ok(None);
        }
        let storage = wgpu::BufferUsages::STORAGE;
        let corners = room(gpu, &mut into.corners, "edges of meshes", 4 * extent.sides, storage)?;
        let rings = room(gpu, &mut into.rings, "edges of meshes", 4 * extent.sides, storage)?;
        let owners = room(gpu, &mut self.owners, "tables of edges", 4 * extent.cells, storage)?;
        let heads = room(gpu, &mut self.heads, "tables of edges", 4 * extent.cells, storage)?;
        let (mut parts, mut first) = (Vec::new(), 0);
        for (indices, faces) in faces(asset) {
            let sides = 3 * u64::from(faces);
            let words = [extent.vertices, first, sides, extent.sides, extent.cells - 1];
            let Some(job) = jobs.add(&words.map(|word| word as u32)) else { return Ok(None) };
            let whole = [&corners, &rings, &owners, &heads].map(|buffer| buffer.as_entire_buffer_binding());
            let buffers = [vertices.binding(), indices.binding()].into_iter().chain(whole);
            let group = bound(gpu, &pipelines.adjacency_layout, job, buffers);
            parts.push((group, sides));
            first += sides;
        }
        into.sides = extent.sides;
        let Extent { vertices, sides, cells } = extent;
        Ok(Some(EdgeExtraction { parts, vertices, sides, cells }))
    }
}

/// Parameters of all dispatches, in one buffer.
#[derive(Debug)]
pub(super) struct Jobs<'a> {
    pub(super) buffer: &'a wgpu::Buffer,
    pub(super) bytes: Vec<u8>,
}

impl<'a> Jobs<'a> {
    /// Adds the parameters of a dispatch, if there is room.
    pub(super) fn add(&mut self, words: &[u32]) -> Option<wgpu::BindingResource<'a>> {
        let offset = self.bytes.len() as u64;
        if offset + JOB_BYTES > self.buffer.size() {
            return None;
        }
        self.bytes.extend_from_slice(bytemuck::cast_slice(words));
        self.bytes.resize((offset + JOB_BYTES) as usize, 0);
        let size = wgpu::BufferSize::new(JOB_BYTES);
        Some(wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: self.buffer, offset, size }))
    }
}

/// Binds a job and then buffers at consecutive bindings.
pub(super) fn bound<'b>(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    job: wgpu::BindingResource<'b>,
    buffers: impl Iterator<Item = wgpu::BufferBinding<'b>>,
) -> wgpu::BindGroup {
    let buffers = buffers.map(wgpu::BindingResource::Buffer);
    let entries = (0..).zip(std::iter::once(job).chain(buffers));
    let entries: Vec<_> =
        entries.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("ink"), layout, entries: &entries })
}

impl EdgeExtraction {
    /// Number of jobs of a mesh.
    pub(super) fn jobs(asset: &AssetGpu) -> usize {
        faces(asset).count()
    }

    /// Records the extraction.
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>, pipelines: &InkPipelines) {
        let Some((all, _)) = self.parts.first() else { return };
        let stages = &pipelines.adjacency;
        let mut run = |pipeline, group, invocations| {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(groups(invocations), 1, 1);
        };
        run(&stages.clear, all, self.cells);
        run(&stages.places, all, self.vertices);
        for (group, sides) in &self.parts {
            run(&stages.corners, group, *sides);
        }
        run(&stages.clear, all, self.cells);
        run(&stages.edges, all, self.sides);
        run(&stages.rings, all, self.sides);
    }
}
