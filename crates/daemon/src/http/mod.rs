//! The HTTP port with its WebSocket upgrade, and the administration port.

pub(crate) mod admin;
pub(crate) mod server;
