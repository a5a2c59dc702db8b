//! Packs and scenes, in files of this machine or as objects of a store. Every blob is checked against its hash when it is
//! read.

mod cache;
mod error;
mod file;
mod handles;
mod loaded;
mod lru;
mod object_pack;
mod objects;
mod pack;
mod scene;
mod scene_object;
mod table;
#[cfg(test)]
mod tests;

pub use cache::BlobCache;
pub use error::StoreError;
pub use file::PackFile;
pub use loaded::LoadedAsset;
pub use objects::{ObjectEntry, Objects, retries};
pub use scene::{DEFAULT_CACHE_BYTES, SceneStore, describe};
pub use scene_object::{MAX_SCENE_OBJECT_BYTES, PackName, SceneObject};
