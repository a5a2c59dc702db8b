//! Stand-in for `pn_triangles` without the feature `methods`: all triangles are flat, so there are neither settings nor
//! pipelines of patches.

use std::ops::Range;

use crate::frame::graph::PassId;
use crate::frame::timing::PassEncoder;
use crate::resources::gpu::Gpu;
use crate::scene::material_bindings::MaterialBindings;

/// Has no value.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PnTriangles {}

impl PnTriangles {
    /// A number that differs between settings.
    pub(crate) fn key(self) -> u64 {
        match self {}
    }
}

/// Has no value.
#[derive(Debug)]
pub(crate) enum PatchPipelines {}

impl PatchPipelines {
    pub(crate) fn new(
        _: &Gpu,
        settings: PnTriangles,
        _: (&MaterialBindings, &wgpu::BindGroupLayout),
        _: bool,
    ) -> Self {
        match settings {}
    }

    /// Of any type, because it never returns; naming `MeshPipelines` would import in a circle.
    pub(crate) fn meshes<T>(&self) -> &T {
        match *self {}
    }

    pub(crate) fn compile_makers(&self, _: &Gpu) {
        match *self {}
    }
}

/// No patch lists.
#[derive(Debug, Default)]
pub(crate) struct PatchLists {}

impl PatchLists {
    pub(crate) fn record(
        &self,
        _: (&Gpu, &PatchPipelines),
        _: &mut PassEncoder<'_>,
        _: PassId,
        _: &wgpu::BindGroup,
        _: impl Iterator<Item = Range<u32>>,
    ) {
    }

    /// Whether a part has a list.
    pub(crate) fn has(&self, _first: u32, _part: usize) -> bool {
        false
    }

    pub(crate) fn draw(&self, _: &mut wgpu::RenderPass<'_>, _first: u32, _part: usize) {}
}
