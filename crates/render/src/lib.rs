//! Deferred renderer on wgpu: assets in GPU memory, a small frame graph, pictures.
//!
//! What a caller does, in order:
//! 1. [`Gpu::headless`], [`Gpu::for_surface`], or [`Gpu::from_parts`] of a program that has a device: the device.
//! 2. [`Renderer::new`] for the format of the target that will be drawn into.
//! 3. [`Renderer::create_asset`] per asset; then [`AssetGpu::update_vertices`],
//!    [`AssetGpu::update_indices`] and [`AssetGpu::update_texture`] as data arrives.
//! 4. [`Renderer::record`] per frame, into a [`Target`], with a [`Frame`]: camera, instances per asset, settings, time.
//!
//! With the feature `client`, `SceneView` does 3 and 4 from what a client hands over.
//!
//! [`Headless`] does 2 and 4 into a texture and reads pictures back.
//!
//! Conventions: right-handed world; view space looks along −z with y up; reversed depth
//! (1 at the near plane, 0 at infinity); colours are linear unless a name says sRGB; all passes
//! work relative to the eye, so that f32 suffices on the GPU wherever the scene lies in f64 space.
//! Surfaces are drawn from both sides: scanned meshes may be open, so nothing is culled, and the
//! normal of a back face is flipped in the fragment shader.

mod accumulation;
mod asset;
mod bloom;
mod buffer;
mod camera;
mod compiler;
mod composite;
mod counters;
pub mod cpu_reference;
mod debug;
mod draw;
mod environment;
mod fullscreen;
mod gbuffer;
mod gpu;
mod graph;
mod headless;
pub mod image_compare;
mod ink;
mod instance;
mod layers;
mod lights;
mod material;
mod material_kit;
mod mesh_pipelines;
mod occlusion;
mod pipelines;
mod pn_triangles;
pub mod rays;
mod readback;
mod receivers;
#[cfg(feature = "client")]
mod refining;
mod reflections;
mod relief_acceleration;
mod renderer;
mod scene;
#[cfg(feature = "client")]
mod scene_view;
mod shadows;
mod sky;
#[cfg(feature = "client")]
mod staging;
mod target;
mod targets;
mod temporal;
mod terrain;
#[cfg(feature = "client")]
mod terrain_anchored;
mod terrain_renderer;
mod texture;
mod tile_generator;
mod timing;
mod uniforms;
#[cfg(feature = "client")]
mod uploads;
mod vertex;
mod vertical_exaggeration;
mod water;

#[cfg(test)]
mod tests;

pub use asset::AssetGpu;
pub use bloom::Bloom;
pub use camera::clip_from_view;
pub use compiler::Compiler;
pub use counters::Counters;
pub use environment::{Atmosphere, Environment, GradientSky, Haze, Sky};
pub use gpu::{Gpu, RenderError};
pub use graph::PassId;
pub use headless::Headless;
pub use ink::{Ink, MAX_INK_BLUR, MAX_INK_LEVELS, MAX_INK_WIDTH};
pub use instance::Instance;
pub use lights::{LIGHT_TILES, Light, LightCulling, MAX_LIGHTS, Spot};
pub use lodestream_scene::pose::Pose;
pub use material::{Alpha, Material, Wrap};
pub use occlusion::{
    AmbientOcclusion, MAX_SAMPLES, OcclusionMethod, OcclusionNormals, OcclusionRadius, STILL_FRAMES,
};
pub use pn_triangles::{MAX_PN_LEVEL, PnTriangles};
pub use readback::TargetCopy;
pub use reflections::{
    MAX_REFLECTION_STEPS, PYRAMID_LEVELS as REFLECTION_LEVELS, REFLECTION_THICKNESS, ReflectionMethod,
    Reflections,
};
pub use renderer::Renderer;
pub use scene::{
    AntiAliasing, DebugView, Drawable, Frame, MAP_SIDES, MAP_STEPS, MAX_ANISOTROPY, MAX_CASCADES, MAX_FILTER,
    MAX_RELIEF_STEPS, MIN_RENDER_SCALE, ReliefMethod, Settings, Shadows, ToneMapping,
};
#[cfg(feature = "client")]
pub use scene_view::SceneView;
pub use sky::SkyMaps;
#[cfg(feature = "client")]
pub use staging::{MAX_WAITING_STEPS, upload_budget};
pub use target::{Load, Target};
pub use terrain::{MAX_DRAWN_HEIGHT, TERRAIN_SLOTS, TerrainFrame, TerrainGpu, TerrainLook, TerrainPart};
pub use terrain_renderer::{TerrainMeasurementTask, TerrainRenderer, TileSource};
pub use texture::{Texture, TextureData, TextureKind, TextureShape};
pub use timing::{PassTime, Timings};
pub use vertex::{HostMesh, PackedVertex, mark_smooth};
pub use vertical_exaggeration::{MAX_VERTICAL_EXAGGERATION, VerticalExaggeration, VerticalExaggerationError};
pub use water::Water;

/// Computes what is the same in every program, which takes some hundredths of a second: tables of the air and of what
/// surfaces reflect, and the ground's textures. Who needs them first computes them else; a program with time to spare, as
/// while a device is opened, may call this before.
pub fn compute_tables() {
    sky::compute_tables();
    terrain::compute_textures();
}

/// What a window shows while there is no scene in it: sRGB.
pub const EMPTY_WINDOW: [u8; 3] = [18, 20, 26];
