//! GPU resources: device, buffers, textures, uploads and readback.

pub(crate) mod buffer;
pub(crate) mod descriptors;
pub(crate) mod gpu;
pub(crate) mod paged_buffer;
pub(crate) mod pages;
pub(crate) mod readback;
#[cfg(feature = "client")]
pub(crate) mod staging;
pub(crate) mod stamp;
pub(crate) mod texture;
pub(crate) mod texture_data;
pub(crate) mod texture_shape;
pub(crate) mod texture_tiles;
#[cfg(feature = "client")]
pub(crate) mod uploads;
pub(crate) mod vertex;
