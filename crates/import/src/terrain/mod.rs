//! Terrain as people say it: features as JSON, height maps as pictures, and the settings of what is between.

pub mod features;
pub mod height_map;
mod setting;

pub use setting::{ErosionPasses, FinestLevel, Roughness, SpikeLimit, Talus, TalusSlope};
