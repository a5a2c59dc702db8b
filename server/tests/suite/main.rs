//! Tests of the server's program. Out-of-core preparation changes limits of the whole process, so its tests are a
//! binary of their own (`out_of_core.rs`).

#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]

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
