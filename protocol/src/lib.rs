//! Messages, framing, sans-IO sessions, scheduling and rate limits.
//!
//! The crate is pure: it opens no file and no socket, reads no clock and spawns no thread. Time comes
//! in as an argument ([`Time`]), bytes and messages go in and out by `handle_…` and `poll_…` calls in
//! the shape of quinn-proto, so that a server, a viewer and a simulator in virtual time drive the same
//! state machines.
//!
//! | module | idea |
//! |---|---|
//! | [`message`], [`frame`] | control messages and their bytes |
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

pub mod client;
pub mod frame;
pub mod limiter;
pub mod message;
pub mod scheduler;
pub mod server;
pub mod shared_rate_limit;
pub mod source;
pub mod stream;
pub mod time;

mod coding;
#[cfg(test)]
mod pair;
#[cfg(test)]
mod testing;

pub use time::Time;
