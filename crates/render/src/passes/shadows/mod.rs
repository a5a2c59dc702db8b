//! Shadows of the sun: cascaded shadow maps and their lookup.

mod cascades;
mod casters;
mod maps;
mod mesh_casters;
mod sunlight;

use cascades::cascades;

use crate::frame::draw::DrawList;
use crate::frame::settings::{Frame, Shadows};
use crate::scene::terrain;

pub(crate) use cascades::Cascade;
pub(crate) use casters::Casters;
pub(crate) use maps::{ShadowMaps, Sun};
pub(crate) use sunlight::{SunlightUniform, map_from_world};

/// The cascades of a frame; `list` holds its visible instances.
pub(crate) fn of_frame(frame: &Frame<'_>, list: &DrawList<'_>, shadows: Shadows) -> Vec<Cascade> {
    let mut seen = list.receivers;
    if let Some(terrain) = &frame.terrain {
        terrain::receivers(terrain, frame.camera.eye, &mut seen);
    }
    cascades(frame.camera.eye, frame.environment.to_sun, seen, shadows)
}
