//! Refinement: a mesh to which chunks are applied, and from which they are undone.

mod active;
mod applied;
mod apply;
mod delta;
mod error;
mod marks;
mod owners;
mod render;
mod slots;
mod snapshot;

pub(crate) use owners::Owners;

pub use active::ActiveMesh;
pub use delta::{ChunkDelta, Id, Moved, NewFace, NewVertex, NewWedge, Repoint};
pub use error::{ChunkError, RefineError};
pub use render::{RenderVertex, Touched};
pub use snapshot::Snapshot;
