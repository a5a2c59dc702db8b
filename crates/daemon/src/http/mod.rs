//! The HTTP port with its WebSocket upgrade, and the administration port.

pub(crate) mod admin;
pub(crate) mod responses;
pub(crate) mod server;
pub(crate) mod upgrade;
