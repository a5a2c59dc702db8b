//! Ink: strokes along contours, borders and creases of meshes, over quantised light with noisy borders. The design is
//! in `docs/design/ink.md`.

mod adjacency;
mod pass;
mod pipelines;
mod settings;

pub(crate) use pass::{InkPass, StrokeInputs};
pub(crate) use pipelines::InkPipelines;
pub use settings::{Ink, MAX_INK_BLUR, MAX_INK_LEVELS, MAX_INK_WIDTH};
