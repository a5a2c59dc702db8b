//! What simplification goes on with behind blocks.

use crate::mesh::{QuantisedMesh, Wedge};
use crate::simplify::blocks::names::Names;
use crate::simplify::inherited::Inherited;

/// What is left of all blocks but for their last levels, as a mesh to go on with.
#[derive(Debug)]
pub(crate) struct Merged {
    pub(crate) mesh: QuantisedMesh,
    /// The input's ids.
    pub(crate) names: Names,
    /// By vertex, what the levels of blocks have cost around it.
    pub(crate) inherited: Inherited,
    /// Wedges of the mesh that the blocks' last levels add, behind its own.
    pub(super) also: Vec<Wedge>,
    /// Levels of blocks that the mesh lies behind.
    pub(super) levels: usize,
    /// Wedges that the blocks' collapses added, as the input has them: numbered behind its own.
    pub(crate) added: Vec<Wedge>,
    /// Error of regions that vanished.
    pub(crate) stray_error: f64,
}
