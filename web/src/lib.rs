//! The client in a browser tab, as WebAssembly: [`Streamer`] runs in a worker and turns a server's frames into steps of
//! changes, `Viewer` runs on the page's thread and draws them with WebGPU. Both are instances of this one module; the
//! page's scripts (`web/page`) own sockets and events, and pass steps from one to the other as bytes ([`steps`]). With the
//! feature `deltas`, [`Streamer`] also gives the changes as JavaScript objects, for pages that draw by other means.
//!
//! Times are milliseconds since the page's navigation, on the same clock in page and worker.

#[cfg(feature = "checks")]
mod checks;
#[cfg(all(target_family = "wasm", feature = "viewer"))]
mod clips;
#[cfg(target_family = "wasm")]
mod console;
#[cfg(feature = "threads")]
mod decoders;
#[cfg(feature = "deltas")]
mod deltas;
mod part_names;
mod parts;
mod pictures;
mod ranges;
mod stats;
pub mod steps;
mod streamer;
mod streams;
#[cfg(all(target_family = "wasm", feature = "viewer"))]
mod viewer;

#[cfg(feature = "checks")]
pub use checks::{PackCheck, TerrainCheck};
#[cfg(feature = "threads")]
pub use decoders::decode_on_this_worker;
pub use streamer::Streamer;
#[cfg(all(target_family = "wasm", feature = "viewer"))]
pub use viewer::Viewer;

use std::time::Duration;

use lodestream_protocol::time::Time;

/// A time in milliseconds as the core's time; not before its start.
fn time(ms: f64) -> Time {
    Time::from(Duration::try_from_secs_f64(ms / 1e3).unwrap_or_default())
}
