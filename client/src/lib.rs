//! Streaming client core, renderer and viewer.

pub mod core;
pub mod image_compare;
pub mod net;
pub mod render;
