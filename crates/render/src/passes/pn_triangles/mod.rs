//! Triangles drawn as curved patches, without tessellation shaders: each is one instance of a barycentric grid, whose vertices
//! the vertex stage puts onto the patch. What must be true of it: `docs/design/pn-triangles.md`.

mod grid;
mod lists;
mod makers;
mod settings;
#[cfg(any(test, feature = "reference"))]
mod tessellate;

pub(crate) use grid::GRID_VERTEX;
pub(crate) use lists::{Curving, PatchListItem, PatchLists};
pub(crate) use makers::{ListMakers, ReadOnlyLists};
pub use settings::{MAX_PN_LEVEL, PnTriangles};
