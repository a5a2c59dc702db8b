//! Preparation of model files and scene files: packs and a scene description.
//!
//! | module | contents |
//! |---|---|
//! | [`preparation_settings`] | preparation settings, one type with a range for each |
//! | [`scene`] | scene files, and scenes of bare models |
//! | [`sources`] | model files read once, and memos of what was found in them |
//! | [`prepare`] | a model to a pack: cache, checkpoints, progress, threads |
//! | [`proxies`] | meshes that stand for many instances of a scene |
//! | [`whole_scene`] | a scene with all its packs, opened or published in a folder |
//! | `cluster` | coarse meshes by vertex clustering |
//! | [`compose`] | composition of a scene description from prepared models |
//! | [`mapping_allocator`] | an allocator that maps large lists to files, for models larger than memory |
//! | [`compare`], [`inspect`], [`export_obj`] | comparison of a pack with its model, statistics, export |
//! | [`stderr`], [`warnings`] | messages on standard error |

mod cluster;
pub mod compare;
pub mod compose;
pub mod export_obj;
pub mod inspect;
pub mod mapping_allocator;
pub mod preparation_settings;
pub mod prepare;
pub mod proxies;
pub mod scene;
pub mod sources;
pub mod stderr;
pub mod warnings;
pub mod whole_scene;
