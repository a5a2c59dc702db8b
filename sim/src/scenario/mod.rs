//! Scenarios: a plan of scenes and links, run in virtual time, and what each run came to.

pub mod plan;
pub mod report;
pub mod run;
pub mod scene;
#[cfg(test)]
mod tests;
mod viewer;

pub use run::run;
