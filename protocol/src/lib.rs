//! Messages, framing, sans-IO sessions, scheduling and rate limits.
//!
//! The crate does no I/O: it opens no file and no socket, reads no clock and spawns no thread. Time is an argument
//! ([`Time`]); messages and bytes enter and leave by `handle_…` and `poll_…` calls, as in quinn-proto. A server, a
//! viewer and a simulator in virtual time drive the same state machines.
//!
//! | module | contents |
//! |---|---|
//! | [`message`], [`frame`] | control messages and their encoding |
//! | [`stream`] | how frames and blobs map onto QUIC streams and WebSocket messages |
//! | [`server`], [`client`] | the two session state machines |
//! | [`scheduler`] | which blob is sent next |
//! | [`limiter`], [`shared_rate_limit`] | token buckets: when the next piece is sent |
//! | [`source`] | the scenes and blobs that a server session sends |

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
