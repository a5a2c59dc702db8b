//! Memory that a client which requests and never reads can occupy in the server.
//!
//! ```sh
//! cargo test -p lodestream-fuzz --test suite client_that_never_reads -- --nocapture
//! ```
//!
//! Counted by the allocator (`lodestream_fuzz::meter`), so the figures are equal on every machine. Sockets and TLS are
//! not included.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_fuzz::meter::measure;
use lodestream_protocol::Time;
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_protocol::server::{ServerConfig, ServerSession};
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::description::{AssetEntry, Camera, Instance, SceneHeader, SceneLighting, ScenePage};
use lodestream_scene::{BlobId, BlobPart};

const CHUNKS: u32 = 10_000;
/// Memory limit of a session: 256 KiB of queued requests, 64 KiB of answers, and the session itself.
const MOST_BYTES: usize = 400 * 1024;

/// One asset with many chunks, none of which is ever read.
struct Unread {
    header: SceneHeader,
    page: Arc<ScenePage>,
}

impl Unread {
    fn new() -> Self {
        let asset = AssetEntry { base_bytes: 1000, chunk_count: CHUNKS, ..AssetEntry::default() };
        let header = SceneHeader {
            name: "unread".into(),
            fingerprint: [1; 16],
            asset_count: 1,
            instance_count: 1,
            page_count: 1,
            light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.1; 3] },
            background: [0.0; 3],
            terrain: None,
            camera: Camera { eye: [0.0, 0.0, 3.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 },
            root_slope: 0.0,
        };
        let page = ScenePage {
            assets: vec![asset],
            instances: vec![Instance::at(0, [0.0; 3])],
            ..ScenePage::default()
        };
        Self { header, page: Arc::new(page) }
    }
}

impl SceneSource for Unread {
    fn header(&self) -> &SceneHeader {
        &self.header
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        (page == 0).then(|| Arc::clone(&self.page))
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        match id {
            BlobId::Asset { asset: 0, part: BlobPart::Base } => Some(1000),
            BlobId::Asset { asset: 0, part: BlobPart::Chunk(chunk) } if *chunk < CHUNKS => Some(1000),
            _ => None,
        }
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        Err(SourceError::NotFound(*id))
    }
}

#[test]
fn a_client_that_never_reads_occupies_bounded_memory() {
    let source: Arc<dyn SceneSource> = Arc::new(Unread::new());
    let config = Arc::new(ServerConfig::websocket(None));
    let wants = |asset: u32, count: u32| {
        let all: Vec<Want> =
            (0..count).map(|chunk| Want::whole(BlobId::chunk(asset, chunk), 9 + chunk)).collect();
        all.chunks(1000).map(|some| ClientMessage::Want(some.to_vec())).collect::<Vec<_>>()
    };
    // Existing blobs, then missing ones: 60 kB on the wire.
    let messages = [wants(0, 3300), wants(7, 4000)].concat();
    let hello = ClientMessage::Hello(Hello::new(""));
    for (what, said) in [("3,300 wishes", 4), ("and 4,000 bogus ones", messages.len())] {
        let (_session, cost) = measure(|| {
            let mut session = ServerSession::new(Arc::clone(&config), Arc::clone(&source), 1, Time::ZERO);
            for message in std::iter::once(&hello).chain(&messages[..said]) {
                session.handle_message(Time::ZERO, message.clone());
            }
            session
        });
        println!("{what}: {} bytes at the peak", cost.peak_bytes);
        assert!(cost.peak_bytes <= MOST_BYTES, "{what}: {} bytes", cost.peak_bytes);
    }
}
