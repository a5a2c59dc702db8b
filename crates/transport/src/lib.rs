//! The plumbing of QUIC and WebSocket that client and daemon share.
//!
//! Each side has a loop that runs its session over a connection: `drive` in the client's `net` and in the daemon's
//! `session`. Both see a connection as a [`Receiver`] and a [`Sender`]. The two ends of a WebSocket are the same
//! ([`websocket`]). Those of a QUIC connection are not: the server sends a stream for each blob and the client reads them
//! all, while the client sends one stream, as early data where it can. Only their streams of control frames and their
//! close codes are common ([`quic`]).

mod clock;
mod halves;
mod observed;

#[cfg(feature = "quic")]
pub mod quic;
#[cfg(feature = "websocket")]
pub mod websocket;

pub use clock::Clock;
pub use halves::{Incoming, Received, Receiver, SendError, Sender};
pub use observed::{ObservedStream, ReadObserver};
