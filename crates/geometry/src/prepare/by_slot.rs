//! The builder's ids of a growing mesh's elements.

/// Builder's ids of the elements of a growing [`ActiveMesh`](crate::refine::ActiveMesh), by slot.
pub(super) struct BySlot {
    pub(super) vertices: Vec<u32>,
    pub(super) wedges: Vec<u32>,
    pub(super) faces: Vec<u32>,
}
