//! The ground of a studio: unseen but for the shadows on it. In a picture of the ground, redrawn when the objects
//! change, are the key light's shadow, softened by the distance of what casts it, and the darkness around contacts. Each
//! frame darkens the background by it.

mod pass;
mod place;

pub(crate) use pass::{FloorPass, FloorPipelines};
pub(crate) use place::FloorPlace;
#[cfg(test)]
pub(crate) use place::FloorUniform;
