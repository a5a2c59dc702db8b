//! The client's network: addresses, transports, and the loop that drives a [`ClientCore`] over them.
//!
//! [`run_quic`] and [`run_websocket`] run one session over a transport that is open; both work on any
//! tokio runtime, also in virtual time over simulated endpoints and streams. [`stream`] connects over
//! real sockets, again and again, as a viewer does.

mod address;
mod drive;
mod pin;
mod quic;
mod quic_open;
mod quic_sender;
mod reconnect;
#[cfg(test)]
mod tests;
mod websocket;

pub use address::{Address, AddressError, Scheme};
pub use drive::{Clock, Host};
pub use pin::{Pin, PinError};
pub use quic::{QuicSetupError, client_config, endpoint, run_quic};
pub use quic_open::{QuicConnection, QuicOpenError};
pub use reconnect::{End, Retry, stream};
pub use websocket::run_websocket;

#[allow(unused_imports)] // named in the documentation above
use crate::core::ClientCore;
