//! The HTTP port: WebSocket upgrades, health, metrics, and the administration port.

pub mod admin;
pub mod origin;
pub mod proxy;
pub mod server;
