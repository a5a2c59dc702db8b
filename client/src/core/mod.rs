//! What a client is without network, graphics and clock: session, scene, cache, selection, refinement.
//!
//! [`ClientCore`] is driven in the shape of the protocol's sessions: frames and pieces go in by
//! `handle_…`, messages come out of [`ClientCore::poll_transmit`], time comes in as an argument. The
//! heavy part, [`ClientCore::update`], selects, decodes and applies within a budget, so that a viewer can
//! run it in slices beside its network and a simulator in virtual time.
//!
//! ```text
//! pieces -> session -> arrived -> cache -> decode -> ActiveMesh -> changes -> renderer
//!              ^ wants, cancels                |
//!              +------- selection <- states <--+
//! ```
//!
//! What is drawn only ever goes from coarse to fine and back: an asset is drawn from its base mesh on, a
//! chunk is applied whole or not at all, and what no view needs is undone, finest first, its bytes kept
//! in a bounded cache. Chunks are decoded on threads that the host lends ([`Decoders`]), or on the caller's.

mod asset;
mod cache;
mod changes;
mod client_core;
mod config;
mod decoders;
mod failures;
mod height_overrides;
mod milestones;
mod motion;
mod punctual_light_pages;
mod scene;
mod shared;
mod stats;
#[cfg(not(feature = "zstd"))]
mod stored;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
mod texture_file;

pub use asset::uv_per_unit;
pub use changes::{Change, IndexRun, MeshChange, NewAsset, TextureChange, Vertex};
pub use client_core::{ClientCore, Progress};
pub use config::{Config, StartView};
pub use decoders::Decoders;
pub use milestones::{Milestone, Milestones, QUALITIES_PX};
pub use stats::{Connection, Received, Stats};
pub use texture_file::{TextureFileError, TexturePixels};
