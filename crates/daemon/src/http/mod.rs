//! The HTTP port with its WebSocket upgrade, and the administration port.

pub(crate) mod admin;
pub(crate) mod origin;
pub(crate) mod proxy;
pub(crate) mod responses;
pub(crate) mod server;
pub(crate) mod upgrade;
