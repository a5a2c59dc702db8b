//! Import, preparation, pack store and the streaming daemon.

pub mod import;
pub mod scene;
pub mod texture;
