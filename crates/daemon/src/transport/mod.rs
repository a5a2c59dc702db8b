//! Transports: QUIC, WebSocket, TLS, certificates and listeners.

pub(crate) mod advertised_addresses;
pub mod certificate;
pub mod congestion;
pub(crate) mod listen;
pub mod quic;
pub(crate) mod quic_scenes;
pub(crate) mod quic_stream;
pub mod renewal;
pub mod tls;
pub(crate) mod websocket;
