//! Guarantees of the crate, tested through its public interface on generated meshes.
#![allow(clippy::unwrap_used, reason = "test helpers without #[test] may unwrap, as tests may")]

mod common;

mod allocation_limits;
mod attributes;
mod cancellation;
mod coarse_end;
mod codecs;
mod determinism;
mod errors;
mod extremes;
mod golden;
mod grids;
mod holes;
mod hostile;
mod invariants;
mod precision;
mod random_meshes;
mod render;
mod resuming;
mod sets;
mod skins;
mod touching;
mod two_uv_sets;
