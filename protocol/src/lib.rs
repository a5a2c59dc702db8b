//! Messages, framing, limits, sans-IO sessions, selection and scheduling.
//!
//! The crate is pure: it opens no file and no socket, reads no clock and spawns no thread. Time comes
//! in as an argument ([`Time`]), bytes and messages go in and out by `handle_…` and `poll_…` calls in
//! the shape of quinn-proto, so that a server, a viewer and a simulator in virtual time drive the same
//! state machines.
//!
//! | module | idea |
//! |---|---|
//! | [`blob`] | names of the things that are sent: base meshes, index pages, chunks, texture levels |
//! | [`scene`] | the scene description, paged, and the description of one asset |
//! | [`shared`] | textures that assets have in common |
//! | [`terrain`] | what a scene says of its terrain |
//! | [`punctual_lights`] | what a scene says of the lights that stand in it |
//! | [`view`] | the camera that everything is judged by |
//! | [`select`] | which blobs a view wants, in which order, and which applied chunks it can do without |
//! | [`message`], [`frame`], [`limits`] | control messages, their bytes, and the bounds on both |
//! | [`stream`] | how frames and blobs map onto QUIC streams and WebSocket messages |
//! | [`server`], [`client`] | the two session state machines |
//! | [`scheduler`], [`limiter`], [`shared_rate_limit`] | what is sent next, and when |

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

pub mod asset;
pub mod blob;
pub mod client;
pub mod frame;
pub mod limiter;
pub mod limits;
pub mod message;
pub mod pose;
pub mod punctual_lights;
pub mod scene;
pub mod scheduler;
pub mod select;
pub mod server;
pub mod shared;
pub mod shared_rate_limit;
pub mod source;
pub mod stream;
pub mod terrain;
pub mod time;
pub mod view;

mod coding;
#[cfg(test)]
mod pair;
#[cfg(test)]
mod testing;

pub use blob::{BlobId, BlobPart, PunctualLightBlob, TerrainBlob};
pub use time::Time;
pub use view::View;
