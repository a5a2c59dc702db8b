//! Baselines: what other techniques take to show the same scene over the same link.
//!
//! A technique offers each asset as pieces ([`offer`]): nodes of a peer, levels of a chain, or one file. A
//! loader (`loader`) fetches them over the link of the case by the project's own selection rule
//! (`select`): the screen error of a bounding sphere, frustum, most important first, parents before children.
//! So techniques differ by what they offer alone.
//!
//! What is given to them: the scene description (which assets stand where, and how large a node's or a
//! level's error is) is known before the connection is asked for; one request is 64 bytes over QUIC and 160
//! over TCP, and so is what comes before a body; a child may be asked for while its parent is under way (but nothing
//! that an index names before the index is here);
//! bodies come in the order of the requests, none shares the link with a later one. Textures are fetched as
//! ours are: the same files, by the same rule.
//!
//! What has no children counts as exact, whatever error a peer states for it. Levels are ancestor-closed cuts of our packs, with
//! the errors that our index states. OBJ has no more decimals than the grid is worth, and normals only at creases. At
//! most six requests are under way, one for the older system's JSON levels.
//!
//! Over QUIC a request is a bidirectional stream, as in HTTP/3, between quinn endpoints with the certificate
//! and the congestion control of the project's server; over TCP requests are pipelined on one connection, as
//! HTTP/1.1 allows it, without TLS.

pub mod diamond_square;
mod levels;
pub mod library;
mod loader;
pub mod mesh_text;
pub mod nodes;
mod octave;
pub mod offer;
mod run;
pub mod seed_models;
pub mod seed_table;
mod select;
pub mod terrain_table;
#[cfg(test)]
mod tests;
mod wire;

pub use library::{Library, lacks_something_here};
pub(crate) use run::run_case;
