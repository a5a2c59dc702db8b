//! Fuzz targets: one function per reader of untrusted bytes.
//!
//! A target takes any bytes and panics on a *finding*: a panic of the code under test, a broken invariant, or a cost
//! above the target's limit ([`meter`]). It returns whether the input was accepted. The functions are plain, so that
//! tests replay the committed corpora with the stable toolchain (`tests/suite/replay.rs`); the binaries in
//! `fuzz_targets/` pass them to libFuzzer. README.md has the commands.

#[allow(clippy::unwrap_used, reason = "helpers of tests")]
#[path = "../../crates/geometry/tests/suite/common/mod.rs"]
mod common;
mod compressed;
pub mod fixtures;
mod glb;
pub mod input;
pub mod meter;
pub mod seeds;
pub mod targets;
