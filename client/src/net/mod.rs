//! Network: addresses, transports, and the loop that drives a [`ClientCore`](crate::core::ClientCore) over them.
//!
//! [`Streaming`](crate::streaming::Streaming) connects, and reconnects, over real sockets on its own threads. With the
//! feature `runtime` a host uses its own tokio runtime, in virtual time too: `stream` works like `Streaming`,
//! `stream_quic` and `stream_websocket` use transports that the host opens, and `run_quic` and `run_websocket` run one
//! session over an open transport.

mod address;
#[cfg(any(feature = "quic", feature = "websocket"))]
mod addresses;
#[cfg(any(feature = "quic", feature = "websocket"))]
mod connect;
#[cfg(any(feature = "quic", feature = "websocket"))]
#[cfg_attr(
    not(feature = "runtime"),
    allow(unreachable_pub, reason = "re-exported with the feature `runtime`")
)]
mod drive;
mod pin;
#[cfg(feature = "http")]
#[cfg_attr(
    not(feature = "runtime"),
    allow(unreachable_pub, reason = "re-exported with the feature `runtime`")
)]
mod published;
#[cfg(feature = "quic")]
#[cfg_attr(
    not(feature = "runtime"),
    allow(unreachable_pub, reason = "re-exported with the feature `runtime`")
)]
mod quic;
#[cfg(feature = "quic")]
#[cfg_attr(
    not(feature = "runtime"),
    allow(unreachable_pub, reason = "re-exported with the feature `runtime`")
)]
mod quic_open;
#[cfg(feature = "quic")]
mod quic_sender;
#[cfg(any(feature = "quic", feature = "websocket"))]
#[cfg_attr(
    not(feature = "runtime"),
    allow(unreachable_pub, reason = "re-exported with the feature `runtime`")
)]
mod reconnect;
#[cfg(any(feature = "quic", feature = "websocket"))]
mod server;
#[cfg(any(feature = "quic", feature = "websocket"))]
mod steps;
#[cfg(all(test, feature = "websocket"))]
mod tests;
#[cfg(feature = "tls")]
mod tls;
#[cfg(any(feature = "quic", feature = "tls"))]
mod trust;
#[cfg(feature = "websocket")]
#[cfg_attr(
    not(feature = "runtime"),
    allow(unreachable_pub, reason = "re-exported with the feature `runtime`")
)]
mod websocket;

pub use address::{Address, AddressError, Scheme};
#[cfg(all(feature = "runtime", any(feature = "quic", feature = "websocket")))]
pub use drive::Host;
#[cfg(any(feature = "quic", feature = "websocket"))]
pub use lodestream_transport::Clock;
pub use pin::{Pin, PinError};
#[cfg(all(feature = "runtime", feature = "http"))]
pub use published::{Fetch, Report, Reports, run_published};
#[cfg(all(feature = "runtime", feature = "quic"))]
pub use quic::{QuicSetupError, client_config, endpoint, run_quic};
#[cfg(all(feature = "runtime", feature = "quic"))]
pub use quic_open::{QuicConnection, QuicOpenError};
#[cfg(all(feature = "runtime", any(feature = "quic", feature = "websocket")))]
pub use reconnect::stream;
#[cfg(all(feature = "runtime", feature = "quic"))]
pub use reconnect::stream_quic;
#[cfg(all(feature = "runtime", feature = "websocket"))]
pub use reconnect::stream_websocket;
#[cfg(any(feature = "quic", feature = "websocket"))]
pub use reconnect::{End, Retry};
#[cfg(any(feature = "quic", feature = "websocket"))]
pub use server::Server;
#[cfg(any(feature = "quic", feature = "tls"))]
pub use trust::{Authorities, AuthoritiesError, Trust};
#[cfg(all(feature = "runtime", feature = "websocket"))]
pub use websocket::{ByteCounter, CountingStream, WebSocketConnection, run_websocket};

#[cfg(all(not(feature = "runtime"), any(feature = "quic", feature = "websocket")))]
pub(crate) use {drive::Host, reconnect::stream};
