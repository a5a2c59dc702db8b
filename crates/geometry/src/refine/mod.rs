//! Refinement: a mesh on which chunks are applied and undone.

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

mod active;
mod applied;
mod apply;
mod compact;
mod delta;
mod dirty_slots;
mod error;
mod marks;
mod owners;
mod raycast;
mod render;
mod slots;
mod snapshot;

pub(crate) use owners::Owners;

pub use active::ActiveMesh;
pub use delta::{ChunkDelta, Id, MovedVertex, NewFace, NewVertex, NewWedge, Origin, Repoint};
pub use dirty_slots::DirtySlots;
pub use error::{ChunkError, RefineError};
pub use raycast::FaceHit;
pub use render::RenderVertex;
pub use snapshot::Snapshot;
