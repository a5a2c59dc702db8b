//! Where a server's scenes come from, and whither they are published: files, folders, stores.
//!
//! | module | idea |
//! |---|---|
//! | `place` | what the words of the command line stand for |
//! | `look` | scenes as they are now, opened again when they have changed |
//! | [`publish`] | a scene and its packs as objects |
//! | [`fetch`] | models from stores, with what they name |

pub mod fetch;
mod look;
mod place;
pub mod publish;

pub use look::Catalogue;
