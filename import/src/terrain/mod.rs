//! Terrain from files: features as JSON, height maps as pictures.

pub mod features;
pub mod height_map;
