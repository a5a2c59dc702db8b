//! Packs and scenes, in local files or in object stores. Every blob is verified by its hash when it is read.

mod cache;
mod description;
mod error;
mod file;
mod file_pool;
mod loaded;
mod object_pack;
mod objects;
mod pack;
mod pack_contents;
mod part_blobs;
mod punctual_light_blobs;
mod scene;
mod scene_object;
mod table;
mod terrain_blobs;

pub use cache::BlobCache;
pub use description::SceneDescription;
pub use error::StoreError;
pub use file::PackFile;
pub use file_pool::FilePool;
pub use loaded::LoadedAsset;
pub use objects::{ObjectEntry, Objects, retries};
pub use part_blobs::{PartBlobs, PartBlobsError};
pub use punctual_light_blobs::{PunctualLightBlobs, PunctualLightBlobsError};
pub use scene::{DEFAULT_CACHE_BYTES, SceneStore};
pub use scene_object::{MAX_SCENE_OBJECT_BYTES, SceneObject, SceneObjectError};
pub use terrain_blobs::{TerrainBlobs, TerrainBlobsError};
