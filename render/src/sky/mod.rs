//! The sky: an atmosphere, the light that it comes to, and the maps in which shaders look it up.

mod atmosphere;
mod gpu;
mod map;
mod table;

pub(crate) use gpu::{SkyGpu, SkyLight};

#[cfg(test)]
mod tests;
