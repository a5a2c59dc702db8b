//! Ink: contours, borders and creases of meshes as strokes, over light in a few levels with spattered borders. Why it is
//! done as it is: `docs/design/ink.md`.

mod adjacency;
mod pass;
mod pipelines;
mod settings;

pub(crate) use pass::{InkPass, Seen};
pub(crate) use pipelines::InkPipelines;
pub use settings::{Ink, MAX_INK_BLUR, MAX_INK_LEVELS, MAX_INK_WIDTH};
