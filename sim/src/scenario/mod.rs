//! Scenarios: a plan of scenes, links and camera paths, run in virtual time, and what each run came to.

pub mod camera_path;
mod csv;
#[cfg(test)]
mod extremes;
pub mod ledger;
pub(crate) mod outcome;
pub mod parallel;
pub mod percentiles;
pub mod plan;
pub mod report;
pub(crate) mod run;
pub mod scene;
#[cfg(test)]
pub(crate) mod tests;
pub mod timeline;
pub(crate) mod viewer;

pub use parallel::{run, run_with};
