//! Scenarios: plans of scenes, links and camera paths, run in virtual time, and their results.
//!
//! This crate draws nothing; pictures of a run are taken by an [`observer`].

mod bare_client;
mod bare_sender;
pub mod baseline;
pub(crate) mod camera_drive;
pub mod camera_path;
mod computing;
pub mod draco;
pub mod field;
pub mod goodput;
pub mod ledger;
pub mod load;
pub mod models;
pub mod mutate;
pub(crate) mod network;
pub mod observer;
pub(crate) mod outcome;
pub mod parallel;
pub mod peers;
pub mod picture;
pub mod plan;
mod process;
mod published_scene;
mod quality;
pub mod relay;
pub mod result;
mod resume;
pub mod run;
pub mod scene;
pub mod served;
mod static_host;
pub mod stopwatch;
pub mod technique;
#[cfg(any(test, feature = "testing"))]
#[expect(clippy::unwrap_used, reason = "tests call it")]
pub mod testing;
#[cfg(test)]
mod tests;
pub mod timeline;
pub mod truth;
pub mod untrusted_peers;
mod viewer;
mod without_occluders;

pub use parallel::{Equipment, run, run_with};
