//! Packs on disk: opened read-only, every blob checked against its hash when it is read.

mod asset;
mod error;
mod file;
mod handles;
mod lru;
mod scene;
#[cfg(test)]
mod tests;

pub use asset::LoadedAsset;
pub use error::StoreError;
pub use file::PackFile;
pub use scene::{DEFAULT_CACHE_BYTES, SceneStore};
