//! Memory of all meshes: vertices and faces in pages that small meshes share.

use crate::resources::gpu::Gpu;
use crate::resources::pages::{PagePool, PageSizes, PoolUse};
use crate::resources::vertex::PackedVertex;

/// Blocks of 64 vertices: pages of 0.2 to 6.8 MB; meshes from 16,384 vertices on have their own buffer.
const VERTEX_PAGES: PageSizes = PageSizes { first: 64, largest: 2048 };
/// Blocks of 64 faces: pages of 0.2 to 6.3 MB; lists from 65,536 faces on have their own buffer.
const FACE_PAGES: PageSizes = PageSizes { first: 256, largest: 8192 };

/// Pools of vertices and faces.
#[derive(Clone, Debug)]
pub(crate) struct MeshPools {
    pub(crate) vertices: PagePool,
    pub(crate) faces: PagePool,
}

impl MeshPools {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let read = gpu.curve_usage();
        let (vertex, face) = (size_of::<PackedVertex>(), size_of::<[u32; 3]>());
        let (vertices, faces) = (wgpu::BufferUsages::VERTEX | read, wgpu::BufferUsages::INDEX | read);
        Self {
            vertices: PagePool::new("vertex buffer", vertices, vertex, VERTEX_PAGES),
            faces: PagePool::new("index buffer", faces, face, FACE_PAGES),
        }
    }

    /// [`PagePool::begin_frame`].
    pub(crate) fn begin_frame(&self) {
        self.vertices.begin_frame();
        self.faces.begin_frame();
    }

    /// [`PagePool::evacuate`].
    #[cfg(feature = "client")]
    pub(crate) fn evacuate(&self) -> bool {
        // Both, whatever the first gives.
        self.vertices.evacuate() | self.faces.evacuate()
    }

    /// [`PagePool::end_evacuation`].
    #[cfg(feature = "client")]
    pub(crate) fn end_evacuation(&self) {
        self.vertices.end_evacuation();
        self.faces.end_evacuation();
    }

    /// Shared pages and memory of vertices and faces.
    pub(crate) fn used(&self) -> [PoolUse; 2] {
        [&self.vertices, &self.faces].map(PagePool::used)
    }
}
