//! Groups of draws with the same material and pages, each recorded by one call where the device draws indirectly.

use std::collections::HashMap;
use std::ops::Range;

use crate::frame::batch::{Batch, Meshes};
use crate::frame::counters::Counters;
use crate::frame::draw_calls::{DrawArguments, DrawCalls};
use crate::passes::mesh_pipelines::MeshPipelines;
use crate::passes::pn_triangles::PatchLists;
use crate::scene::asset::PartDraw;
use crate::scene::bound_material::BoundMaterial;

/// Draws of one material from one page of vertices and one of faces.
#[derive(Debug)]
pub(crate) struct DrawGroup<'a> {
    pub(crate) material: &'a BoundMaterial,
    vertices: &'a wgpu::Buffer,
    indices: &'a wgpu::Buffer,
    /// Range in the frame's arguments.
    arguments: Range<u32>,
    /// Number of triangles.
    pub(crate) triangles: u64,
}

impl DrawGroup<'_> {
    /// Number of draws.
    pub(crate) fn draws(&self) -> u32 {
        self.arguments.end - self.arguments.start
    }
}

/// A part that is drawn as patches.
#[derive(Debug)]
struct ListedPart<'a> {
    /// Without arguments.
    group: DrawGroup<'a>,
    /// Starts of its lists: one, or one for each instance of a transparent part.
    lists: Range<u32>,
    part: usize,
}

/// The draws of some batches. Groups are in the order of their first draws, and the draws of a group in the order of the
/// batches: near ones first, independent of whether the device draws indirectly.
#[derive(Debug, Default)]
pub(crate) struct DrawGroups<'a> {
    groups: Vec<DrawGroup<'a>>,
    listed: Vec<ListedPart<'a>>,
}

/// Arguments for a part of a batch, or of single instances of it.
fn arguments(batch: &Batch<'_>, part: &PartDraw<'_>, instances: &Range<u32>) -> DrawArguments {
    let vertices = batch.asset().draws().map_or(0, |(vertices, _)| vertices.first());
    DrawArguments {
        index_count: part.faces * 3,
        instance_count: instances.end - instances.start,
        // Pages are far below 2³¹ elements, and other ranges begin at 0.
        first_index: (part.indices.first() * 3) as u32,
        base_vertex: vertices as i32,
        first_instance: instances.start,
    }
}

impl<'a> DrawGroups<'a> {
    /// Groups the draws of batches, with their arguments added to `calls`; parts that have patch lists are drawn by
    /// these. Cost: a look-up per draw.
    pub(crate) fn new(batches: &[Batch<'a>], lists: Option<&PatchLists>, calls: &mut DrawCalls) -> Self {
        let mut this = Self::default();
        // Only looked up in.
        let mut numbers: HashMap<(u64, u32, u32), usize> = HashMap::new();
        let mut last = None;
        let mut draws: Vec<(usize, DrawArguments)> = Vec::with_capacity(batches.len());
        for batch in batches {
            let Some((vertices, parts)) = batch.asset().draws() else { continue };
            let instances = batch.range();
            let count = u64::from(instances.end - instances.start);
            for (number, part) in parts.enumerate() {
                let group = || DrawGroup {
                    material: part.material,
                    vertices: vertices.buffer(),
                    indices: part.indices.buffer(),
                    arguments: 0..0,
                    triangles: 0,
                };
                let triangles = u64::from(part.faces) * count;
                if lists.is_some_and(|lists| lists.has(instances.start, number)) {
                    let end = if part.material.features.blend { instances.end } else { instances.start + 1 };
                    this.listed.push(ListedPart {
                        group: DrawGroup { triangles, ..group() },
                        lists: instances.start..end,
                        part: number,
                    });
                    continue;
                }
                let key = (part.material.number, vertices.page(), part.indices.page());
                let at = match last {
                    Some((same, at)) if same == key => at,
                    _ => *numbers.entry(key).or_insert_with(|| {
                        this.groups.push(group());
                        this.groups.len() - 1
                    }),
                };
                last = Some((key, at));
                this.groups[at].triangles += triangles;
                this.groups[at].arguments.end += 1;
                draws.push((at, arguments(batch, &part, &instances)));
            }
        }
        // Counting sort by group.
        let mut next = calls.arguments.len() as u32;
        calls.arguments.resize(calls.arguments.len() + draws.len(), DrawArguments::default());
        for group in &mut this.groups {
            let end = next + group.arguments.end;
            group.arguments = next..next;
            next = end;
        }
        for (at, arguments) in draws {
            let end = &mut this.groups[at].arguments.end;
            calls.arguments[*end as usize] = arguments;
            *end += 1;
        }
        this
    }

    /// Whether there is nothing to draw.
    pub(crate) fn is_empty(&self) -> bool {
        self.groups.is_empty() && self.listed.is_empty()
    }

    /// Records the draws. `prepare` selects groups and sets their pipelines; it counts draws where they are counted.
    pub(crate) fn draw<'p>(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        meshes: Meshes<'p>,
        counters: &mut Counters,
        mut prepare: impl FnMut(
            &mut wgpu::RenderPass<'_>,
            &'p MeshPipelines,
            &DrawGroup<'_>,
            &mut Counters,
        ) -> bool,
    ) {
        pass.set_vertex_buffer(1, meshes.instances.slice(..));
        let mut set = [None; 2];
        for group in &self.groups {
            if !prepare(pass, meshes.plain, group, counters) {
                continue;
            }
            pass.set_bind_group(1, &group.material.group, &[]);
            if set[0].replace(group.vertices) != Some(group.vertices) {
                pass.set_vertex_buffer(0, group.vertices.slice(..));
            }
            if set[1].replace(group.indices) != Some(group.indices) {
                pass.set_index_buffer(group.indices.slice(..), wgpu::IndexFormat::Uint32);
            }
            counters.calls += meshes.calls.draw(pass, &group.arguments);
        }
        let Some((patches, lists)) = meshes.curved else { return };
        for ListedPart { group, lists: firsts, part } in &self.listed {
            if prepare(pass, patches.meshes(), group, counters) {
                pass.set_bind_group(1, &group.material.group, &[]);
                for first in firsts.clone() {
                    lists.draw(pass, first, *part);
                    counters.calls += 1;
                }
            }
        }
    }
}

/// Records the parts of one instance of a batch that `pipeline` has a pipeline for.
pub(crate) fn draw_instance<'p>(
    batch: &Batch<'_>,
    instance: u32,
    pass: &mut wgpu::RenderPass<'_>,
    meshes: Meshes<'p>,
    counters: &mut Counters,
    pipeline: impl Fn(&'p MeshPipelines, &BoundMaterial) -> Option<&'p wgpu::RenderPipeline>,
) {
    let Some((vertices, parts)) = batch.asset().draws() else { return };
    let one = instance..instance + 1;
    for (number, part) in parts.enumerate() {
        let listed = meshes.curved.filter(|(_, lists)| lists.has(instance, number));
        let pipelines = listed.map_or(meshes.plain, |(patches, _)| patches.meshes());
        let Some(pipeline) = pipeline(pipelines, part.material) else { continue };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(1, &part.material.group, &[]);
        counters.draws += 1;
        counters.calls += 1;
        counters.triangles += u64::from(part.faces);
        if let Some((_, lists)) = listed {
            lists.draw(pass, instance, number);
            continue;
        }
        let draw = arguments(batch, &part, &one);
        pass.set_vertex_buffer(0, vertices.buffer().slice(..));
        pass.set_vertex_buffer(1, meshes.instances.slice(..));
        pass.set_index_buffer(part.indices.buffer().slice(..), wgpu::IndexFormat::Uint32);
        let indices = draw.first_index..draw.first_index + draw.index_count;
        pass.draw_indexed(indices, draw.base_vertex, one.clone());
    }
}
