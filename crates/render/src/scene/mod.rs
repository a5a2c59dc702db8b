//! Scene data in GPU memory: assets, instances, materials, lights, environment and terrain.

#[cfg(feature = "client")]
pub(crate) mod animated_placements;
pub(crate) mod asset;
pub(crate) mod attribute_table;
pub(crate) mod bound_material;
#[cfg(feature = "client")]
pub(crate) mod drawn_placements;
pub(crate) mod environment;
#[cfg(feature = "client")]
pub(crate) mod held_texels;
pub(crate) mod index_set;
pub(crate) mod lights;
pub(crate) mod material_bindings;
pub(crate) mod mesh_pools;
pub(crate) mod part_states;
pub(crate) mod part_table;
pub(crate) mod part_words;
pub(crate) mod placement;
#[cfg(any(test, feature = "methods"))]
pub(crate) mod relief_acceleration;
#[cfg(not(any(test, feature = "methods")))]
#[path = "no_relief_acceleration.rs"]
pub(crate) mod relief_acceleration;
#[cfg(feature = "client")]
pub(crate) mod scene_parts;
#[cfg(feature = "client")]
pub(crate) mod scene_view;
#[cfg(feature = "client")]
pub(crate) mod streamed_mesh;
pub(crate) mod terrain;
#[cfg(feature = "client")]
pub(crate) mod terrain_anchored;
pub(crate) mod terrain_renderer;
pub(crate) mod tile_generator;
pub(crate) mod vertex_tables;
pub(crate) mod vertical_exaggeration;
