//! Transports: QUIC, WebTransport, WebSocket, TLS, certificates and listeners.

pub(crate) mod advertised_addresses;
pub(crate) mod certificate;
pub(crate) mod congestion;
pub(crate) mod development_certificate;
pub(crate) mod listen;
pub(crate) mod live_certificate;
pub(crate) mod quic;
pub(crate) mod quic_scenes;
pub(crate) mod quic_stream;
pub(crate) mod tls;
pub(crate) mod web_session;
pub(crate) mod web_streams;
pub(crate) mod web_transport;
pub(crate) mod websocket;
