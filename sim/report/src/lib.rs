//! Reports of runs: CSV tables, plots, pictures, an HTML page, and the reproduction of the benchmarks' figures.

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
