//! A scene of three kinds of blobs, all of them chunks of one asset: bulk, one for the cold start, and urgent ones.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_daemon::MemoryScene;
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::description::{SceneHeader, ScenePage};
use lodestream_scene::{BlobId, BlobPart};

/// Length of the blob requested at the cold start.
pub(super) const COLD_BYTES: u32 = 1_000_000;
/// Number of urgent blobs: two a second for ten seconds.
pub(super) const URGENT_BLOBS: u32 = 20;
const URGENT_BYTES: u32 = 8_000;
/// Length of a bulk blob, equal to a large chunk.
const BULK_BYTES: u32 = 32_000;
/// Number of bulk blobs: 15 s at 16 Mbit/s.
const BULK_BLOBS: u32 = 1000;
/// Length of the base mesh that the server pushes.
const BASE_BYTES: u32 = 500;

/// Chunk numbers by kind.
const COLD: u32 = BULK_BLOBS;
const URGENT: u32 = COLD + 1;

/// All bulk blobs.
pub(super) fn bulk() -> Vec<BlobId> {
    (0..BULK_BLOBS).map(|number| BlobId::chunk(0, number)).collect()
}

/// The blob of the cold start.
pub(super) fn cold() -> BlobId {
    BlobId::chunk(0, COLD)
}

/// An urgent blob; `number` is below [`URGENT_BLOBS`].
pub(super) fn urgent(number: u32) -> BlobId {
    BlobId::chunk(0, URGENT + number)
}

/// The scene. Its blobs cannot be decoded.
#[derive(Debug)]
pub(super) struct BulkScene {
    scene: MemoryScene,
}

impl BulkScene {
    pub(super) fn new() -> Self {
        Self { scene: MemoryScene::new(1, BASE_BYTES, 0) }
    }
}

impl SceneSource for BulkScene {
    fn header(&self) -> &SceneHeader {
        self.scene.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.scene.page(page)
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        let BlobId::Asset { asset: 0, part: BlobPart::Chunk(number) } = *id else {
            return self.scene.blob_len(id);
        };
        match number {
            0..COLD => Some(BULK_BYTES),
            COLD => Some(COLD_BYTES),
            _ if number < URGENT + URGENT_BLOBS => Some(URGENT_BYTES),
            _ => self.scene.blob_len(id),
        }
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        let length = self.blob_len(id).ok_or(SourceError::NotFound(*id))?;
        Ok(MemoryScene::contents(id, length))
    }
}
