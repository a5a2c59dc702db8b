//! PN triangles (Vlachos et al. 2001) without tessellation shaders: each triangle is an instance of a barycentric
//! grid, whose vertices the vertex stage moves onto the patch. Design and guarantees: `docs/design/pn-triangles.md`.

mod grid;
mod lists;
mod makers;
mod pipelines;
mod settings;
mod tessellate;

pub(crate) use lists::{PatchInputs, PatchListItem, PatchLists};
pub(crate) use pipelines::PatchPipelines;
pub use settings::{MAX_PN_LEVEL, PnTriangles};
