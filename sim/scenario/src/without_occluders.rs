//! A scene without occluders, so that no occlusion is tested.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_protocol::source::{Reading, SceneSource, SourceError};
use lodestream_scene::BlobId;
use lodestream_scene::animation::AnimationTable;
use lodestream_scene::description::{SceneHeader, ScenePage};
use lodestream_scene::parts::PartTable;
use lodestream_scene::punctual_lights::PunctualLights;

/// Another scene, without its occluders.
pub(crate) struct WithoutOccluders(pub(crate) Arc<dyn SceneSource>);

impl SceneSource for WithoutOccluders {
    fn header(&self) -> &SceneHeader {
        self.0.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.0.page(page)
    }

    fn punctual_lights(&self) -> Option<&PunctualLights> {
        self.0.punctual_lights()
    }

    fn parts(&self) -> Option<PartTable> {
        self.0.parts()
    }

    fn animations(&self) -> Option<AnimationTable> {
        self.0.animations()
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.0.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        self.0.read(id)
    }

    fn try_read(&self, id: &BlobId) -> Result<Reading, SourceError> {
        self.0.try_read(id)
    }
}
