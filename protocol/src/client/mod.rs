//! The client's side of a session, sans-IO.
//!
//! The session keeps the books of what has been asked for, puts pieces together, and decides how much of
//! what the selection wants is asked for now. It does not know what a chunk is: the caller selects,
//! caches and applies.

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
pub use event::{ClientEvent, ClientStats};
pub use session::ClientSession;
