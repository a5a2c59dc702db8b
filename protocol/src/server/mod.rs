//! The server's side of a session, sans-IO.
//!
//! A session sends at once, without waiting for the client: `Welcome`, then scene pages and base meshes for the
//! scene's start view. On QUIC they travel in the handshake's second flight, on WebSocket with the response to the
//! upgrade. `Hello` brings the client's view, and what is not sent yet is reordered for it. After the base meshes the
//! server pushes index pages and first chunks, until the client's first `Want` of a chunk.

mod coarse_textures;
mod config;
mod first_cut;
mod first_flight;
mod outbox;
mod pace;
mod plans;
mod push;
mod pushed_blob;
mod refinement;
mod requests;
mod scene_index;
mod session;
#[cfg(test)]
mod tests;
mod timers;
mod transmit;

pub use config::ServerConfig;
pub use plans::Plans;
pub use session::{ServerSession, ServerStats};
pub use transmit::Transmit;
