//! Sessions: their loop over a transport, and the state that they share.

pub(crate) mod admission_settings;
pub(crate) mod admit;
pub(crate) mod drive;
pub(crate) mod guard;
pub(crate) mod memory_scene;
pub(crate) mod reads;
pub(crate) mod scene_preview;
pub(crate) mod scene_watch;
pub(crate) mod scenes;
pub(crate) mod session_metrics;
pub(crate) mod settings;
pub(crate) mod state;
pub(crate) mod unreadable_blobs;
