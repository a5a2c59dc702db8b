//! Scenarios: a plan of scenes, links and camera paths, run in virtual time, and what each run came to.

pub mod camera_path;
mod csv;
#[cfg(test)]
mod extremes;
pub mod ledger;
mod outcome;
pub mod parallel;
pub mod percentiles;
pub mod plan;
pub mod report;
pub(crate) mod run;
pub mod scene;
#[cfg(test)]
mod tests;
pub mod timeline;
mod viewer;

pub use parallel::run;
