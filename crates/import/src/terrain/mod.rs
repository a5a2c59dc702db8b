//! Input of terrain: features as JSON, height maps as images, and the settings of generation.

pub mod features;
pub mod height_map;
mod setting;

pub use setting::{ErosionPasses, FinestLevel, Roughness, SpikeLimit, Talus, TalusSlope};
