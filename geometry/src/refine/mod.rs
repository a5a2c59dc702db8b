//! Refinement: a mesh to which chunks are applied, and from which they are undone.

mod active;
mod delta;
mod places;
mod render;
mod slots;
mod snapshot;

pub use active::{ActiveMesh, RefineError};
pub use delta::{ChunkDelta, Id, Moved, NewFace, NewVertex, NewWedge, Repoint};
pub use render::{RenderVertex, Touched};
pub use snapshot::Snapshot;
