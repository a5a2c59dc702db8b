//! Streaming client: session, cache, selection, refinement, network.

pub mod core;
pub mod net;
pub mod streaming;
