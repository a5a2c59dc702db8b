//! Groups of draws with the same material and pages, each recorded by one call where the device draws indirectly.

use std::collections::HashMap;
use std::ops::Range;

use crate::frame::batch::{Batch, Meshes};
use crate::frame::counters::Counters;
use crate::frame::draw_calls::{DrawArguments, DrawCalls};
use crate::frame::placed::{PartCall, PlacedInstances};
use crate::passes::mesh_pipelines::MeshPipelines;
use crate::passes::pn_triangles::PatchLists;
use crate::scene::bound_material::BoundMaterial;

/// Groups that are searched one by one.
const FEW: usize = 32;

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

impl<'a> DrawGroup<'a> {
    /// Without draws, of a part of a batch's asset.
    fn of(batch: &Batch<'a>, number: usize) -> Option<Self> {
        let (vertices, mut parts) = batch.asset().draws()?;
        let part = parts.nth(number)?;
        let (vertices, indices) = (vertices.buffer(), part.indices.buffer());
        Some(Self { material: part.material, vertices, indices, arguments: 0..0, triangles: 0 })
    }

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

/// The draws of some batches. Materials are in the order of their first draws, as are a material's groups, and the draws
/// of a group in the order of the batches: near ones first, independent of whether the device draws indirectly.
#[derive(Debug, Default)]
pub(crate) struct DrawGroups<'a> {
    groups: Vec<DrawGroup<'a>>,
    listed: Vec<ListedPart<'a>>,
}

impl<'a> DrawGroups<'a> {
    /// Groups the draws of batches, with their arguments added to `calls`; parts that have patch lists are drawn by
    /// these. Cost: a look-up per draw.
    pub(crate) fn new(
        batches: &[Batch<'a>],
        placed: &PlacedInstances,
        lists: Option<&PatchLists>,
        calls: &mut DrawCalls,
    ) -> Self {
        let mut this = Self::default();
        // Only looked up in.
        let mut numbers: HashMap<(u64, u32, u32), usize> = HashMap::new();
        let (mut keys, mut last) = (Vec::new(), None);
        let mut draws: Vec<(usize, DrawArguments)> = Vec::with_capacity(batches.len());
        for batch in batches {
            let instances = batch.range();
            let count = instances.end - instances.start;
            let Some(placed) = placed.drawable(batch.drawable()) else { continue };
            for (number, part) in placed.parts.iter().enumerate() {
                let triangles = u64::from(part.index_count / 3) * u64::from(count);
                if lists.is_some_and(|lists| lists.has(instances.start, number)) {
                    let Some(group) = DrawGroup::of(batch, number) else { continue };
                    let end = if group.material.features.blend { instances.end } else { instances.start + 1 };
                    this.listed.push(ListedPart {
                        group: DrawGroup { triangles, ..group },
                        lists: instances.start..end,
                        part: number,
                    });
                    continue;
                }
                let known = match last {
                    Some((same, at)) if same == part.key => Some(at),
                    // A few are found faster one by one than by their hash.
                    _ if keys.len() <= FEW => keys.iter().position(|key| *key == part.key),
                    _ => numbers.get(&part.key).copied(),
                };
                let at = match known {
                    Some(at) => at,
                    None => {
                        let Some(group) = DrawGroup::of(batch, number) else { continue };
                        this.groups.push(group);
                        numbers.insert(part.key, keys.len());
                        keys.push(part.key);
                        this.groups.len() - 1
                    }
                };
                last = Some((part.key, at));
                this.groups[at].triangles += triangles;
                this.groups[at].arguments.end += 1;
                let &PartCall { index_count, first_index, base_vertex, .. } = part;
                let (instance_count, first_instance) = (count, instances.start);
                let draw =
                    DrawArguments { index_count, instance_count, first_index, base_vertex, first_instance };
                draws.push((at, draw));
            }
        }
        // Counting sort by group.
        let mut next = calls.arguments.len() as u32;
        calls.arguments.resize(calls.arguments.len() + draws.len(), DrawArguments::default());
        // Those of a material follow one another, so that the order of different materials does not depend on pages.
        let mut firsts: HashMap<u64, usize> = HashMap::new();
        let mut order: Vec<(usize, usize)> = Vec::with_capacity(this.groups.len());
        for (at, group) in this.groups.iter().enumerate() {
            order.push((*firsts.entry(group.material.number).or_insert(at), at));
        }
        order.sort_unstable();
        for (_, at) in order {
            let group = &mut this.groups[at];
            let end = next + group.arguments.end;
            group.arguments = next..next;
            next = end;
        }
        for (at, arguments) in draws {
            let end = &mut this.groups[at].arguments.end;
            calls.arguments[*end as usize] = arguments;
            *end += 1;
        }
        this.groups.sort_unstable_by_key(|group| group.arguments.start);
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
        pass.set_bind_group(2, meshes.tiles, &[]);
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

/// Records the parts of one instance of a batch that `steps` has pipelines for, by each of them.
pub(crate) fn draw_instance<'p>(
    batch: &Batch<'_>,
    instance: u32,
    pass: &mut wgpu::RenderPass<'_>,
    meshes: Meshes<'p>,
    counters: &mut Counters,
    steps: impl Fn(&'p MeshPipelines, &BoundMaterial) -> Option<&'p [wgpu::RenderPipeline]>,
) {
    let Some((vertices, parts)) = batch.asset().draws() else { return };
    let one = instance..instance + 1;
    for (number, part) in parts.enumerate() {
        let listed = meshes.curved.filter(|(_, lists)| lists.has(instance, number));
        let pipelines = listed.map_or(meshes.plain, |(patches, _)| patches.meshes());
        let Some(steps) = steps(pipelines, part.material) else { continue };
        pass.set_bind_group(1, &part.material.group, &[]);
        counters.draws += steps.len() as u32;
        counters.calls += steps.len() as u32;
        counters.triangles += u64::from(part.faces) * steps.len() as u64;
        if let Some((_, lists)) = listed {
            for pipeline in steps {
                pass.set_pipeline(pipeline);
                lists.draw(pass, instance, number);
            }
            continue;
        }
        pass.set_vertex_buffer(0, vertices.buffer().slice(..));
        pass.set_vertex_buffer(1, meshes.instances.slice(..));
        pass.set_index_buffer(part.indices.buffer().slice(..), wgpu::IndexFormat::Uint32);
        // As in [`crate::frame::placed::PartCall`].
        let first = (part.indices.first() * 3) as u32;
        for pipeline in steps {
            pass.set_pipeline(pipeline);
            pass.draw_indexed(first..first + part.faces * 3, vertices.first() as i32, one.clone());
        }
    }
}
