//! Baselines: other techniques that deliver the same scene over the same link.
//!
//! A technique offers each asset as pieces ([`offer`]): nodes of a peer, levels of a chain, or one file. A loader
//! (`loader`) fetches them over the case's link by one selection rule (`select`): screen error of a bounding sphere,
//! frustum, most important first, parents before children. Techniques therefore differ only in what they offer.
//!
//! Assumptions in favour of the baselines: the scene description (assets, instances, errors of nodes and levels) is
//! known before the connection is opened. A request, and the header of a body, has 64 bytes over QUIC and 160 over TCP.
//! A child may be requested while its parent is on its way, but not before the index that lists it has arrived. Bodies
//! arrive in the order of the requests, one at a time. Textures are the same files, fetched by the same rule.
//!
//! A piece without children counts as exact, whatever error a peer states for it. Levels are ancestor-closed cuts of
//! our packs with the errors of our index. OBJ has as many decimals as the grid justifies, and normals only at creases.
//! At most six requests are in flight, one for the older system's JSON levels.
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
