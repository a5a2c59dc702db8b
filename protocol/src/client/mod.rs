//! The client's side of a session, sans-IO.
//!
//! The session tracks requests, assembles pieces and decides how many of the wanted blobs to request now. It does not
//! interpret blobs: the caller selects, caches and applies them.

mod backoff;
mod config;
mod downloads;
mod early;
mod estimate;
mod event;
mod keepalive;
mod session;
#[cfg(test)]
mod tests;
mod view_updates;

pub use backoff::Backoff;
pub use config::{ClientConfig, Resume};
pub use downloads::DownloadError;
pub use estimate::Estimate;
pub use event::{ClientEvent, ClientStats};
pub use session::ClientSession;
