//! Buffers for gathering a region.

use crate::refine::Id;

/// A face at the vertex whose star is being gathered.
#[derive(Clone, Copy)]
pub(crate) struct IncidentFace {
    pub(crate) id: Id,
    pub(crate) face: u32,
    /// Slots of its vertices, and their local numbers at the time of collection ([`u32::MAX`] for none).
    pub(crate) vertices: [u32; 3],
    pub(crate) corners: [u32; 3],
}

/// Buffers of gathering, reused from chunk to chunk.
#[derive(Default)]
pub(crate) struct GatherBuffers {
    /// Interior vertices: local number and slot.
    pub(crate) queue: Vec<(u32, u32)>,
    pub(crate) incident_faces: Vec<IncidentFace>,
}

impl GatherBuffers {
    /// Memory held, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.queue.capacity() * size_of::<(u32, u32)>()
            + self.incident_faces.capacity() * size_of::<IncidentFace>()
    }
}
