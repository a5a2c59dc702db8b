//! Streaming client core, renderer and viewer.

pub mod core;
pub mod image_compare;
pub mod net;
pub mod render;
pub mod report;
pub mod scene_view;
pub mod streaming;
pub mod terrain;
pub mod viewer;
pub mod window;
