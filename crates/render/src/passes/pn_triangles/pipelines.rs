//! Pipelines of PN triangles, each compiled on first use.

use std::sync::OnceLock;

use super::grid::GRID_VERTICES;
use super::makers::{PatchListPipelines, list_layout};
use crate::passes::mesh_pipelines::MeshPipelines;
use crate::resources::gpu::Gpu;
use crate::scene::material_bindings::MaterialBindings;

/// Pipelines that draw meshes as patches, and those that build the patch lists.
#[derive(Debug)]
pub(crate) struct PatchPipelines {
    meshes: MeshPipelines,
    frame_layout: wgpu::BindGroupLayout,
    pub(super) list_layout: wgpu::BindGroupLayout,
    makers: OnceLock<PatchListPipelines>,
}

impl PatchPipelines {
    /// Creates the layouts; compiles nothing. Only settings of PN triangles need it. `cut`: by section planes.
    pub(crate) fn new(
        gpu: &Gpu,
        _: super::PnTriangles,
        (kit, frame_layout): (&MaterialBindings, &wgpu::BindGroupLayout),
        cut: bool,
    ) -> Self {
        let list_layout = list_layout(gpu);
        Self {
            meshes: MeshPipelines::curved(gpu, (kit, frame_layout), &GRID_VERTICES, list_layout.clone(), cut),
            frame_layout: frame_layout.clone(),
            list_layout,
            makers: OnceLock::new(),
        }
    }

    /// Pipelines that draw patches.
    pub(crate) fn meshes(&self) -> &MeshPipelines {
        &self.meshes
    }

    /// Compiles the pipelines that build lists, unless it has been done.
    pub(crate) fn compile_makers(&self, gpu: &Gpu) {
        self.makers(gpu);
    }

    /// Pipelines that build lists.
    pub(super) fn makers(&self, gpu: &Gpu) -> &PatchListPipelines {
        self.makers.get_or_init(|| PatchListPipelines::new(gpu, &self.frame_layout))
    }
}
