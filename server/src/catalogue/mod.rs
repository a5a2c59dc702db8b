//! The catalogue: sources of a server's scenes (files, folders, stores), and publishing to them.
//!
//! | module | idea |
//! |---|---|
//! | `place` | the sources that the command line names |
//! | `look` | the catalogue of open scenes, reopened when they change |
//! | [`publish`] | a scene and its packs as objects |
//! | [`fetch`] | download of models with the files that they name |

pub mod fetch;
mod look;
mod place;
pub mod publish;

pub use look::Catalogue;
