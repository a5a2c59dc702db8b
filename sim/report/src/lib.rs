//! What is said of runs: tables as CSV, plots, pictures, a page, and the benchmarks' figures with one command.

mod csv_text;
mod files;
mod html;
pub mod image_error;
pub mod levels;
mod page;
pub mod percentiles;
pub mod pictures;
pub mod plots;
pub mod reproduce;
pub mod staging;
mod tables;
#[cfg(test)]
mod tests;
mod units;

pub use files::{write, write_drawn, write_json};
