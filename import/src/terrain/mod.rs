//! Terrain as people say it: features as JSON, height maps as pictures, and the knobs of what is between.

pub mod features;
pub mod height_map;
mod knob;

pub use knob::{ErosionPasses, FinestLevel, Roughness, SpikeLimit, Talus, TalusSlope};
