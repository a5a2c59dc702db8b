//! Preparation, scenes, pack store and the streaming daemon.

pub mod catalogue;
pub mod cli;
pub mod compare;
pub mod compose;
pub mod daemon;
pub mod demo_scene;
pub mod export_obj;
pub mod inspect;
pub mod mapped;
pub mod prepare;
pub mod scene;
pub mod store;
mod tell;
