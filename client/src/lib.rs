//! Streaming client core, renderer and viewer.

pub mod image_compare;
pub mod render;
