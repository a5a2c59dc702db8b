//! The passes of a frame, one file or folder each.

pub(crate) mod bloom;
pub(crate) mod caps;
pub(crate) mod debug;
pub(crate) mod floor;
pub(crate) mod gbuffer;
#[cfg(any(test, feature = "methods"))]
pub(crate) mod ink;
pub(crate) mod mesh_pipelines;
pub(crate) mod occlusion;
pub(crate) mod occlusion_kernel;
#[cfg(any(test, feature = "methods"))]
pub(crate) mod occlusion_layers;
#[cfg(any(test, feature = "methods"))]
pub(crate) mod pn_triangles;
#[cfg(not(any(test, feature = "methods")))]
#[path = "no_pn_triangles.rs"]
pub(crate) mod pn_triangles;
pub(crate) mod reflections;
pub(crate) mod shadows;
pub(crate) mod sky;
pub(crate) mod temporal;
pub(crate) mod water;
