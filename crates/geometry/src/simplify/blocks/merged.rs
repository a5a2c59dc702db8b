//! The merged result of blocks, from which simplification continues.

use crate::mesh::{QuantisedMesh, Wedge};
use crate::simplify::blocks::names::Names;
use crate::simplify::inherited::Inherited;

/// The remaining mesh of all blocks before their last levels.
#[derive(Debug)]
pub(crate) struct Merged {
    pub(crate) mesh: QuantisedMesh,
    /// The input's ids.
    pub(crate) names: Names,
    /// Per vertex: error accumulated by the levels of blocks.
    pub(crate) inherited: Inherited,
    /// Further wedges, added by the blocks' last levels.
    pub(super) also: Vec<Wedge>,
    /// Number of levels of blocks before this mesh.
    pub(super) levels: usize,
    /// Wedges added by the blocks' collapses, in the input's ids, numbered after its own.
    pub(crate) added: Vec<Wedge>,
    /// Error of regions that vanished.
    pub(crate) stray_error: f64,
}
