//! Visible instances of an asset, and the inputs of the passes that draw them.

use std::ops::Range;

use crate::frame::draw_calls::DrawCalls;
use crate::passes::mesh_pipelines::MeshPipelines;
#[cfg(any(test, feature = "methods"))]
use crate::passes::pn_triangles::PatchListItem;
use crate::passes::pn_triangles::{PatchLists, PatchPipelines};
use crate::scene::asset::AssetGpu;

/// The visible instances of one asset: a range of the frame's instance buffer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Batch<'a> {
    pub(super) asset: &'a AssetGpu,
    /// Index among the frame's drawables.
    pub(super) drawable: usize,
    pub(super) first: u32,
    pub(super) end: u32,
    /// Whether any material is transparent.
    pub(super) blends: bool,
}

impl<'a> Batch<'a> {
    pub(crate) fn asset(&self) -> &'a AssetGpu {
        self.asset
    }

    pub(crate) fn drawable(&self) -> usize {
        self.drawable
    }

    /// Range in the frame's instance buffer.
    pub(crate) fn range(&self) -> Range<u32> {
        self.first..self.end
    }

    /// Whether any material is transparent.
    pub(crate) fn blends(&self) -> bool {
        self.blends
    }

    #[cfg(any(test, feature = "methods"))]
    /// Parts that may be drawn as PN triangles, all or those in view: not those whose faces are flat. Transparent parts have a list per instance.
    pub(crate) fn listed(&self, in_view: bool) -> impl Iterator<Item = PatchListItem<'a>> {
        let instances = self.range();
        let draws = self.asset.draws().into_iter();
        let parts = draws.flat_map(|(vertices, parts)| parts.enumerate().map(move |part| (vertices, part)));
        let parts = parts.filter(|(_, (_, part))| !part.material.features.flat);
        parts.map(move |(vertices, (number, part))| PatchListItem {
            vertices,
            indices: part.indices,
            part: number,
            faces: part.faces,
            instances: instances.clone(),
            alone: part.material.features.blend,
            in_view,
        })
    }
}

/// Pipelines and buffers of meshes: flat, and as PN triangles where there are patch lists.
#[derive(Clone, Copy)]
pub(crate) struct Meshes<'a> {
    pub(crate) plain: &'a MeshPipelines,
    pub(crate) instances: &'a wgpu::Buffer,
    pub(crate) curved: Option<(&'a PatchPipelines, &'a PatchLists)>,
    /// Arguments of the frame's draws.
    pub(crate) calls: &'a DrawCalls,
    /// Group 2: tiles of textures.
    pub(crate) tiles: &'a wgpu::BindGroup,
}
