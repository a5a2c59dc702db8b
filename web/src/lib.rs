//! The client in a browser tab, as WebAssembly: [`Streamer`] runs in a worker and turns a server's frames into steps of
//! changes, `Viewer` runs on the page's thread and draws them with WebGPU. Both are instances of this one module; the
//! page's scripts (`web/page`) own sockets and events, and pass steps from one to the other as bytes ([`steps`]).
//!
//! Times are milliseconds since the page's navigation, on the same clock in page and worker.

#[cfg(target_family = "wasm")]
mod console;
mod pictures;
mod stats;
pub mod steps;
mod streamer;
mod streams;
#[cfg(target_family = "wasm")]
mod viewer;

pub use streamer::Streamer;
#[cfg(target_family = "wasm")]
pub use viewer::Viewer;

use std::time::Duration;

use lodestream_protocol::time::Time;

/// A time in milliseconds as the core's time; not before its start.
fn time(ms: f64) -> Time {
    Time::from(Duration::try_from_secs_f64(ms / 1e3).unwrap_or_default())
}
