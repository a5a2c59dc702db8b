//! The client without network, graphics and clock: session, scene, cache, selection and refinement.
//!
//! [`ClientCore`] has the interface of the protocol's sessions: `handle_…` takes frames and pieces,
//! [`ClientCore::poll_transmit`] gives messages to send, and time is an argument. The heavy part,
//! [`ClientCore::update`], selects, decodes and applies within a budget, so that a viewer can run it in slices between
//! network events and a simulator in virtual time.
//!
//! ```text
//! pieces -> session -> arrived -> cache -> decode -> ActiveMesh -> changes -> renderer
//!              ^ wants, cancels                |
//!              +------- selection <- states <--+
//! ```
//!
//! Drawn meshes change only from coarse to fine and back: an asset is drawn from its base mesh on, a chunk (or its part
//! up to a truncation point) is applied in one step, and chunks that the view does not need are undone, finest first,
//! while their bytes stay in a bounded cache. Chunks are decoded on threads that the host lends ([`Decoders`]) or on
//! the caller's.

mod animated_models;
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
mod moved_parts;
mod parts;
mod picking;
mod punctual_light_pages;
mod scene;
mod shared_textures;
mod stats;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
mod texture_file;
mod texture_header;

pub use changes::{Change, IndexRun, MeshChange, NewAsset, TextureChange, Vertex};
pub use client_core::{ClientCore, Progress};
pub use config::{Config, StartView};
pub use decoders::Decoders;
pub use milestones::{Milestone, Milestones, QUALITIES_PX};
pub use parts::{PartAbsence, PartAnswer};
pub use picking::{Hit, PartBounds, Ray};
pub use stats::{Connection, Received, Stats};
pub use texture_file::{TextureFileError, TextureFileFault, TexturePixels};
