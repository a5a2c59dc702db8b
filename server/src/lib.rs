//! The server's program: its command line, and the catalogue of the scenes that it serves.
//!
//! The daemon is `lodestream-daemon`, preparation `lodestream-bake`, packs and object stores `lodestream-store`.

pub mod catalogue;
pub mod cli;
