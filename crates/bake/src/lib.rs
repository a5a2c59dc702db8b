//! Baking: from model files and scene files to packs and a scene's description.
//!
//! | module | contents |
//! |---|---|
//! | [`preparation_settings`] | how a model is prepared: each setting one type with one range |
//! | [`scene`] | scene files, and scenes of bare models |
//! | [`prepare`] | a model to a pack: cache, checkpoints, progress, threads |
//! | [`compose`] | a prepared scene's description, as it is sent |
//! | [`mapped`] | an allocator that maps large lists to files, for models larger than memory |
//! | [`compare`], [`inspect`], [`export_obj`] | what a pack holds, against its model or by itself |
//! | [`stderr`] | lines for people |

pub mod compare;
pub mod compose;
pub mod export_obj;
pub mod inspect;
pub mod mapped;
pub mod preparation_settings;
pub mod prepare;
pub mod scene;
pub mod stderr;
