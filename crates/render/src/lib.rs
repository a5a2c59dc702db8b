//! Deferred renderer on wgpu: assets in GPU memory, a small frame graph, pictures.
//!
//! What a caller does, in order:
//! 1. [`Gpu::headless`], [`Gpu::for_surface`], or [`Gpu::from_parts`] of a program that has a device: the device.
//! 2. [`Renderer::new`] for the format of the target that will be drawn into.
//! 3. [`Renderer::create_asset`] per asset; then [`AssetGpu::update_vertices`],
//!    [`AssetGpu::update_indices`] and [`AssetGpu::update_texture`] as data arrives.
//! 4. [`Renderer::record`] per frame, into a [`Target`], with a [`Frame`]: camera, instances per asset, settings, time.
//!
//! With the feature `client`, `SceneView` does 3 and 4 from the changes that a client reports.
//!
//! The feature `methods` adds ink, PN triangles, further estimators of occlusion and further searches of relief
//! mapping; `reference` adds CPU references of the shaders, reference rays and comparison of pictures. Both are for
//! tests and figures.
//!
//! [`Headless`] does 2 and 4 into its own texture and reads pictures back.
//!
//! Conventions: right-handed world; view space looks along −z with y up; reversed depth
//! (1 at the near plane, 0 at infinity); colours are linear unless a name says sRGB; all passes
//! work relative to the eye, so that f32 suffices on the GPU wherever the scene lies in f64 space.
//! Surfaces are drawn from both sides: scanned meshes may be open, so nothing is culled, and the
//! normal of a back face is flipped in the fragment shader.

#[cfg(any(test, feature = "reference"))]
pub mod cpu_reference;
mod frame;
#[cfg(any(test, feature = "reference"))]
pub mod image_compare;
mod passes;
#[cfg(any(test, feature = "reference"))]
pub mod rays;
mod renderer;
mod resources;
mod scene;

#[cfg(test)]
mod tests;

pub use frame::camera::clip_from_view;
pub use frame::compiler::Compiler;
pub use frame::counters::Counters;
pub use frame::graph::PassId;
pub use frame::headless::Headless;
pub use frame::settings::{
    AntiAliasing, DebugView, Drawable, Frame, MAP_SIDES, MAP_STEPS, MAX_ANISOTROPY, MAX_CASCADES, MAX_FILTER,
    MAX_RELIEF_STEPS, MIN_RENDER_SCALE, ReliefMethod, Settings, Shadows, ToneMapping,
};
pub use frame::target::{Load, Target};
pub use frame::timing::{PassTime, Timings};
pub use lodestream_scene::asset::{Alpha, ClearCoat, Material, Specular, TextureKind, Wrap};
pub use lodestream_scene::placement::Placement;
pub use lodestream_scene::pose::Pose;
pub use lodestream_scene::punctual_lights::{PunctualLight, Spot};
pub use lodestream_scene::section::{MAX_SECTION_PLANES, SectionPlane, SectionPlanes};
pub use passes::bloom::Bloom;
#[cfg(any(test, feature = "methods"))]
pub use passes::ink::{Ink, MAX_INK_BLUR, MAX_INK_LEVELS, MAX_INK_WIDTH};
pub use passes::occlusion::{
    AmbientOcclusion, MAX_SAMPLES, OcclusionMethod, OcclusionNormals, OcclusionRadius, STILL_FRAMES,
};
#[cfg(any(test, feature = "methods"))]
pub use passes::pn_triangles::{MAX_PN_LEVEL, PnTriangles};
pub use passes::reflections::{
    MAX_REFLECTION_STEPS, PYRAMID_LEVELS as REFLECTION_LEVELS, REFLECTION_THICKNESS, ReflectionMethod,
    Reflections,
};
pub use passes::sky::SkyMaps;
pub use passes::water::Water;
pub use renderer::Renderer;
pub use resources::gpu::{Gpu, RenderError};
pub use resources::readback::TargetCopy;
#[cfg(feature = "client")]
pub use resources::staging::{MAX_WAITING_STEPS, upload_budget};
pub use resources::texture::Texture;
pub use resources::texture_data::TextureData;
pub use resources::texture_shape::TextureShape;
pub use resources::texture_tiles::TextureTileUse;
#[cfg(any(test, feature = "methods"))]
pub use resources::vertex::mark_smooth;
pub use resources::vertex::{HostMesh, MAX_PARTS, PackedVertex};
pub use scene::asset::AssetGpu;
pub use scene::environment::{Atmosphere, Environment, GradientSky, Haze, Sky, Studio};
#[cfg(feature = "client")]
pub use scene::held_texels::Texels;
pub use scene::lights::{LIGHT_TILES, LightCulling, MAX_LIGHTS};
pub use scene::part_states::{InstanceStates, PartState, PartStates, Tint};
#[cfg(feature = "client")]
pub use scene::scene_parts::HiddenParts;
#[cfg(feature = "client")]
pub use scene::scene_view::SceneView;
pub use scene::terrain::{
    MAX_DRAWN_HEIGHT, TERRAIN_SLOTS, TerrainAppearance, TerrainFrame, TerrainGpu, TerrainPart,
};
pub use scene::terrain_renderer::{TerrainMeasurementTask, TerrainRenderer, TileSource};
pub use scene::vertical_exaggeration::{
    MAX_VERTICAL_EXAGGERATION, VerticalExaggeration, VerticalExaggerationError,
};

/// Computes the tables that every program shares: scattering in the atmosphere, reflectance of surfaces and ground
/// textures. Takes some hundredths of a second. Optional: without it, the first use computes them. A program may call
/// it while it waits, as while a device is opened.
pub fn compute_tables() {
    passes::sky::compute_tables();
    scene::terrain::compute_textures();
}

/// Background of a window without a scene, sRGB.
pub const EMPTY_WINDOW: [u8; 3] = [18, 20, 26];
