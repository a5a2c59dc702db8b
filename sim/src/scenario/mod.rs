//! Scenarios: a plan of scenes, links and camera paths, run in virtual time, and what each run came to.

pub(crate) mod camera_drive;
pub mod camera_path;
mod csv;
#[cfg(test)]
mod extremes;
pub mod field;
pub mod ledger;
pub mod levels;
pub(crate) mod network;
pub(crate) mod outcome;
mod page;
pub mod parallel;
pub mod percentiles;
pub mod pictures;
pub mod plan;
pub mod plots;
pub mod report;
mod resume;
pub(crate) mod run;
pub mod scene;
#[cfg(test)]
pub(crate) mod tests;
pub mod timeline;
pub(crate) mod units;
pub(crate) mod viewer;

pub use parallel::{Equipment, run, run_with};
