//! The server's program as people run it. Out-of-core preparation changes limits of the whole process, so it is a
//! binary of its own (`out_of_core.rs`).

#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests are tests, whatever the lint thinks of functions without #[test]"
)]

mod cli;
mod compressed;
mod killed;
#[path = "../landscape/mod.rs"]
mod landscape;
#[cfg(unix)]
mod packaging;
mod process;
mod serve;
#[cfg(unix)]
mod stores;
mod terrain;
