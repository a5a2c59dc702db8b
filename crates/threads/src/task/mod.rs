//! A computation beside the calling thread.

#[cfg(target_family = "wasm")]
mod deferred;
#[cfg(not(target_family = "wasm"))]
mod thread;

#[cfg(target_family = "wasm")]
pub use deferred::Task;
#[cfg(not(target_family = "wasm"))]
pub use thread::Task;
