//! Sessions: the loop between a sans-IO session and its transport, and what sessions share.

pub(crate) mod damage;
pub(crate) mod drive;
pub mod memory_scene;
pub(crate) mod progress;
pub(crate) mod reads;
pub mod scene_watch;
pub mod scenes;
pub mod state;
