//! The server's side of a session, sans-IO.
//!
//! A session begins to speak at once: `Welcome`, then scene pages and base meshes of the scene's start
//! view, so that on QUIC they travel in the handshake's second flight and on WebSocket with the upgrade's
//! answer. `Hello` brings the real view; what is not sent yet is ordered anew. Behind the base meshes go
//! index pages and first chunks, until the client's first `Want` of a chunk takes over.

mod coarse_textures;
mod config;
mod first_flight;
mod outbox;
mod pace;
mod places;
mod plans;
mod push;
mod refinement;
mod requests;
mod session;
#[cfg(test)]
mod tests;
mod timers;
mod transmit;

pub use config::ServerConfig;
pub use plans::Plans;
pub use session::{ServerSession, ServerStats};
pub use transmit::Transmit;
